"""Levenberg-Marquardt by optimistix over a residual function that lives on the host.

optimistix sees, at every trial point y_0, the affine function r(y_0) + J(y_0) (y - y_0): its value and forward-mode
Jacobian at y_0 are those of the true residuals, which is all that a Levenberg-Marquardt step uses.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from sysid.arrays import Residuals, ResidualsByUnknowns, UnknownsOfFit
from sysid.errors import DataRejectedError
from sysid.runtime import require_64_bit
from sysid.threads import one_blas_thread
from sysid.vehicle_model.device_arrays import HostOrDevice

#: Consecutive rejected trials after which the damping is so strong that nothing smaller will be found.
_PATIENCE = 20
#: Share of the predicted fall of the cost above which the damping is relaxed.
_GOOD_STEP = 0.75
#: Least damping with which a search begins: a smaller one changes no step of use.
_LEAST_DAMPING = 1e-6
#: A point is a minimum if the expected decrease by the linear model is not larger than this fraction of the cost, or
#: than this many times the decrease that ends the search. A search ends there only below the second limit.
_NEGLIGIBLE_FALL, _TOLERANCES = 1e-5, 10.0
#: Shares of its Gauss-Newton step, either way, of which none may lower the cost for an unknown at a corner.
_CORNER_SHARES = (1.0, 0.1, 0.01, 1e-3)
#: Share of a negligible fall of the cost that shows that an unknown is at no corner.
_STILL_FALLS = 0.1
#: Shares of the Gauss-Newton step at the end of a search, of which one that lowers the cost is where it goes on, and
#: how often; where none does, so many times a negligible fall may be predicted.
_SHARES, _GOES_ON, _UNKEPT = (1.0, 0.3, 0.1, 0.03, 0.01), 4, 10.0
#: Turns in which those at corners are held and then free, and iterations of each.
_CORNER_TURNS, _CORNER_ITERATIONS = 4, 40
#: Share of the tolerance down to which a search goes on while the linearised model predicts a further fall: in narrow
#: curved valleys, and after a start with strong damping, steps are short.
_SHORT_STEPS = 0.01

#: Unknowns of a step are padded with zeros to a multiple of this: a step is compiled for few sizes.
_COMPILED_SIZES = 32

#: What optimistix keeps between two steps has no public type.
_Solver: TypeAlias = "optx.LevenbergMarquardt[Any, Any, Any]"

Evaluation = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


class _Affine(NamedTuple):
    point: HostOrDevice
    residual: HostOrDevice
    jacobian: HostOrDevice


@dataclass(frozen=True)
class Minimum:
    """A least-squares minimum: `point` (p,), its `cost` = r'r / 2, and how the search went.

    `damping` is that of the last step, for unknowns scaled by the columns of the Jacobian at the start. It is None
    where the search has not converged, because the next one may need more, or was in other units.
    """

    point: UnknownsOfFit
    cost: float
    converged: bool
    iterations: int
    message: str
    damping: float | None = None


def promised_fall(residual: Residuals, jacobian: ResidualsByUnknowns) -> float:
    """Expected decrease of the cost r'r / 2 by a full Gauss-Newton step: half the square of r projected on J's columns.

    It vanishes with the gradient J'r. Unlike the gradient, it has the unit of the cost for any scales of the unknowns.

    Parameters
    ----------
    residual : (m,) r; jacobian : (m, p) J.
    """
    shift = jacobian @ _gauss_newton(residual, jacobian)
    return 0.5 * float(shift @ shift)


def _gauss_newton(residual: Residuals, jacobian: ResidualsByUnknowns) -> UnknownsOfFit:
    norms = np.linalg.norm(jacobian, axis=0)
    norms = np.where(norms > 0.0, norms, 1.0)
    return np.asarray(-np.linalg.lstsq(jacobian / norms, residual, rcond=None)[0] / norms)


def unknowns_at_corners(
    evaluate: Evaluation,
    point: UnknownsOfFit,
    residual: Residuals,
    jacobian: ResidualsByUnknowns,
    corners: Sequence[int],
    negligible: float,
) -> list[int]:
    """Unknowns of which each promises a fall alone that no step along it keeps.

    The derivative by such an unknown jumps where a run just reaches a stop. On one side it promises a fall, on the
    other it does not.

    Parameters
    ----------
    point : (p,); residual : (m,) and jacobian : (m, p) there; corners : unknowns whose derivatives may jump.
    negligible : fall of the cost that does not count; :data:`_STILL_FALLS` of it shows that an unknown can still move.
    """
    cost, held = 0.5 * float(residual @ residual), []
    for j in corners:
        column = jacobian[:, j]
        square, pull = float(column @ column), float(column @ residual)
        if square == 0.0 or 0.5 * pull**2 / square <= negligible:
            continue
        steps = [sign * share * pull / square for share in _CORNER_SHARES for sign in (-1.0, 1.0)]
        trials = [evaluate(point + step * np.eye(1, point.size, j)[0])[0] for step in steps]
        costs = np.array([0.5 * float(r @ r) for r in trials])
        if np.isfinite(costs).all() and costs.min() >= cost - _STILL_FALLS * negligible:
            held.append(j)
    return held


def _small(residual: Residuals, jacobian: ResidualsByUnknowns, scale: UnknownsOfFit) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (n + 1,) and Jacobian (n + 1, n) with the same r'r, J'r and J'J by unknowns in units of `scale` (p,).

    The rows are those of the triangular factor of [J r]; n is p rounded up, and the rest is zero.
    """
    factor = np.asarray(np.linalg.qr(np.column_stack([jacobian * scale, residual]), mode="r"))
    (rows, count), wide = (len(factor), scale.size), _padded(scale).size
    r, j = np.zeros(wide + 1), np.zeros((wide + 1, wide))
    r[:rows], j[:rows, :count] = factor[:, count], factor[:, :count]
    return r, j


def _padded(unknowns: UnknownsOfFit) -> np.ndarray:
    return np.pad(unknowns, (0, -unknowns.size % _COMPILED_SIZES))


def _affine(y: jax.Array, args: _Affine) -> tuple[HostOrDevice, None]:
    return args.residual + args.jacobian @ (y - args.point), None


@eqx.filter_jit
def _init(solver: _Solver, point: jax.Array, args: _Affine) -> Any:
    # What a state holds beside arrays belongs to one trace: a state made without compiling would compile `_step` anew.
    struct = jax.ShapeDtypeStruct(args.residual.shape, jnp.float64)
    return solver.init(_affine, point, args, {}, struct, None, frozenset())


@eqx.filter_jit
def _step(solver: _Solver, point: jax.Array, args: _Affine, state: Any) -> Any:
    # Compiled once per padded size of the problem, not once per call of `minimise`.
    return solver.step(_affine, point, args, {}, state, frozenset())


@one_blas_thread()
def minimise(
    evaluate: Evaluation,
    start: UnknownsOfFit,
    *,
    relative_tolerance: float = 1e-9,
    step_tolerance: float = 1e-9,
    max_iterations: int = 60,
    on_iteration: Callable[[int, float], None] | None = None,
    corners: Sequence[int] = (),
    damping: float | None = None,
) -> Minimum:
    """Minimise r(y)'r(y) / 2 by Levenberg-Marquardt.

    The search has converged only if the Gauss-Newton step at its last point has a negligible expected decrease of the
    cost (:func:`promised_fall`). How it ended does not matter: trials may also fail because derivatives and residuals
    disagree.

    Parameters
    ----------
    evaluate : returns residuals (m,) and Jacobian (m, p) at y (p,), m the same at every call.
    start : (p,) start vector.
    relative_tolerance : an accepted step ends the search when it lowers the cost by less than this fraction; by less
        than a hundredth of it while the expected decrease is larger than ten times this fraction.
    step_tolerance : so does a proposed step that changes every component by less than this fraction.
    max_iterations : limit on evaluations of the Jacobian; unknowns at corners may take more.
    on_iteration : called with the number of the iteration and the best cost so far.
    corners : unknowns in which derivatives may jump, see :func:`unknowns_at_corners`.
    damping : that of the first step, where an earlier search of nearly the same residuals ended with it; None for a
        first step that is no longer than the start vector.

    Raises
    ------
    SysidError
        If 64-bit floats are off.
    DataRejectedError
        If the residuals at the start are not finite.
    """
    require_64_bit()
    start = np.asarray(start, float)
    here = residual, jacobian = evaluate(start)
    if not (np.isfinite(residual).all() and np.isfinite(jacobian).all()):
        raise DataRejectedError(
            "The simulation is not finite at the start values; check masses, tire stiffnesses, units and priors."
        )
    # Scaling by the columns of the first Jacobian makes the damping act alike on all unknowns.
    norms = np.linalg.norm(jacobian, axis=0)
    by_columns = 1.0 / np.where(norms > 0.0, norms, 1.0)
    report = on_iteration or (lambda iteration, cost: None)
    tolerances = relative_tolerance, step_tolerance
    better = _search(evaluate, start, here, by_columns, tolerances, max_iterations, report, damping)
    done = better.iterations
    if not better.converged and done < max_iterations:
        # An unknown that matters only away from the start was hardly damped: once more, in shares of the start.
        by_start = np.where(start != 0.0, np.abs(start), 1.0)
        again = _search(
            evaluate, start, here, by_start, tolerances, max_iterations - done, lambda i, cost: report(done + i, cost)
        )
        as_low = again.cost <= better.cost * (1.0 + relative_tolerance)
        if again.cost < better.cost or (again.converged and as_low):
            # Its damping is in other units.
            better = replace(again, damping=None)
        better = replace(better, iterations=done + again.iterations)
    if not better.converged and len(corners):
        better = _through_corners(evaluate, better, corners, by_columns, tolerances)
    if better.converged or better.iterations >= max_iterations:
        return better
    return _to_the_end(evaluate, better, by_columns, tolerances)


def _to_the_end(
    evaluate: Evaluation,
    found: Minimum,
    scale: UnknownsOfFit,
    tolerances: tuple[float, float],
) -> Minimum:
    """The end of a search whose predicted fall was not negligible: further along its step, or no such fall is there.

    Trials that gain next to nothing end a search in a narrow valley.  A point at which no share of the Gauss-Newton
    step lowers the cost is a minimum: the cost has a corner there.
    """
    for _ in range(_GOES_ON):
        residual, jacobian = evaluate(found.point)
        negligible = max(_NEGLIGIBLE_FALL, _TOLERANCES * tolerances[0]) * found.cost
        step = _gauss_newton(residual, jacobian)
        trials = [evaluate(found.point + share * step) for share in _SHARES]
        costs = [0.5 * float(r @ r) if np.isfinite(r).all() and np.isfinite(j).all() else np.inf for r, j in trials]
        best = int(np.argmin(costs))
        if costs[best] > found.cost - _STILL_FALLS * negligible:
            if promised_fall(residual, jacobian) <= _UNKEPT * negligible:
                return replace(found, converged=True, message="no share of the predicted step lowers the cost")
            break
        start, before = found.point + _SHARES[best] * step, found.iterations
        found = _search(
            evaluate, start, trials[best], scale, tolerances, _CORNER_ITERATIONS, lambda iteration, cost: None
        )
        found = replace(found, iterations=before + found.iterations)
        if found.converged:
            break
    return found


def _through_corners(
    evaluate: Evaluation,
    found: Minimum,
    corners: Sequence[int],
    scale: UnknownsOfFit,
    tolerances: tuple[float, float],
) -> Minimum:
    """The end of a search that goes on with unknowns at corners held, then with all of them, in turn.

    It has also converged where no step along the unknowns at corners lowers the cost, and where the others, with these
    held, have converged.
    """
    negligible = max(_NEGLIGIBLE_FALL, _TOLERANCES * tolerances[0]) * found.cost

    def at_corners(point: UnknownsOfFit, among: Sequence[int]) -> list[int]:
        return unknowns_at_corners(evaluate, point, *evaluate(point), among, negligible)

    def searched(evaluate: Evaluation, before: Minimum) -> Minimum:
        start = before.point
        after = _search(evaluate, start, evaluate(start), scale, tolerances, _CORNER_ITERATIONS, lambda i, cost: None)
        return replace(after, iterations=before.iterations + after.iterations)

    for _ in range(_CORNER_TURNS):
        stuck = at_corners(found.point, corners)
        if not stuck:
            break

        def held(vector: np.ndarray, columns: list[int] = stuck) -> tuple[np.ndarray, np.ndarray]:
            residual, jacobian = evaluate(vector)
            jacobian = jacobian.copy()
            jacobian[:, columns] = 0.0
            return residual, jacobian

        # Damping that holds an unknown at its corner holds the others as well: they are searched without it.
        rest = searched(held, found)
        if rest.converged and at_corners(rest.point, stuck) == stuck:
            return replace(rest, message="the least cost is where a run just reaches a stop")
        # With the others elsewhere, a corner is elsewhere too.
        found = searched(evaluate, rest)
        if found.converged:
            break
    return found


def _search(
    evaluate: Evaluation,
    start: UnknownsOfFit,
    at_start: tuple[np.ndarray, np.ndarray],
    scale: UnknownsOfFit,
    tolerances: tuple[float, float],
    max_iterations: int,
    on_iteration: Callable[[int, float], None],
    damping: float | None = None,
) -> Minimum:
    """One search, with unknowns in units of `scale` (p,), from residuals and Jacobian `at_start`.

    `tolerances` are that of the cost and that of steps; `damping` that of the first step, in these units.
    """
    relative_tolerance, step_tolerance = tolerances
    residual, jacobian = at_start
    # Its own end of a search is not asked for: other tolerances would only compile the same step again.
    solver: _Solver = optx.LevenbergMarquardt(rtol=0.0, atol=0.0)
    solver = eqx.tree_at(lambda s: s.search, solver, optx.ClassicalTrustRegion(high_cutoff=_GOOD_STEP))
    count = start.size
    point = jnp.asarray(_padded(start / scale))
    args = _Affine(point, *_small(residual, jacobian, scale))
    state = _init(solver, point, args)
    if damping is None:
        # The first step is not longer than the start vector: a jump into a flat region would be accepted, and never
        # come back.
        reach, pull = float(np.linalg.norm(start / scale)), float(np.linalg.norm((jacobian * scale).T @ residual))
        damping = pull / reach if 0.0 < reach < pull else 1.0
    of_first = jnp.asarray(1.0 / max(damping, _LEAST_DAMPING))
    state = eqx.tree_at(lambda s: s.search_state.step_size, state, of_first)

    def ended(iteration: int, why: str) -> Minimum:
        fall = promised_fall(*here)
        # Below the rounding of the first cost, the expected decrease of a perfect fit is as large as its own cost.
        negligible = max(_NEGLIGIBLE_FALL, _TOLERANCES * relative_tolerance)
        converged = fall <= negligible * max(best, relative_tolerance**2 * first)
        if not converged:
            why += f", but the linearised model predicts a further fall by {100.0 * fall / best:.2g} %"
        last = 1.0 / float(state.search_state.step_size) if converged else None
        return Minimum(np.asarray(point)[:count] * scale, best, converged, iteration, why, last)

    best, rejections = np.inf, 0
    here, first = (residual, jacobian), 0.5 * float(residual @ residual)
    for iteration in range(1, max_iterations + 1):
        if iteration > 1:
            trial = np.asarray(state.y_eval)[:count] * scale
            residual, jacobian = evaluate(trial)
            # A trial that leaves the domain is rejected like any step that does not lower the cost.
            finite = np.isfinite(residual).all() and np.isfinite(jacobian).all()
            residual = residual if finite else np.full_like(residual, 1e150 / np.sqrt(residual.size))
            jacobian = jacobian if finite else np.zeros_like(jacobian)
            args = _Affine(state.y_eval, *_small(residual, jacobian, scale))
        cost = 0.5 * float(residual @ residual)
        point, state, _ = _step(solver, point, args, state)
        # A step is rejected also if it keeps little of its promise.
        gain, rejections = -np.inf, rejections + 1
        if np.array_equal(np.asarray(point), np.asarray(args.point)):
            here, gain, best, rejections = (residual, jacobian), best - cost, cost, 0
        on_iteration(iteration, best)
        proposed = np.abs(np.asarray(state.y_eval) - np.asarray(point))
        if 0.0 <= gain <= relative_tolerance * best:
            enough = promised_fall(*here) <= _TOLERANCES * relative_tolerance * best
            if enough or gain <= _SHORT_STEPS * relative_tolerance * best:
                return ended(iteration, "the cost no longer falls")
        if np.all(proposed <= step_tolerance * (np.abs(np.asarray(point)) + step_tolerance)):
            return ended(iteration, "the step has become negligible")
        if rejections >= _PATIENCE:
            return ended(iteration, "no smaller cost is found nearby")
    return ended(max_iterations, "the limit of iterations was reached")
