"""Levenberg-Marquardt: how a search ends, and what it says; its accuracy is tested in test_nist_strd.py."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sysid.errors import SysidError
from sysid.estimation.fit import minimiser
from sysid.estimation.fit.minimiser import Minimum, minimise, promised_fall, unknowns_at_corners


def quadratic(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return point - 1.0, np.eye(point.size)


def test_a_linear_problem_ends_at_once():
    found = minimise(quadratic, np.array([3.0, -2.0]))
    np.testing.assert_allclose(found.point, 1.0, rtol=1e-8)
    assert found.converged
    assert found.iterations < 15


@pytest.mark.parametrize(("rows", "count"), [(200, 57), (40, 57), (97, 64), (5, 1)])
def test_a_step_sees_the_squares_and_products_of_the_residuals(rows: int, count: int):
    """In one of few sizes; also with fewer residuals than unknowns."""
    random = np.random.default_rng(4)
    residual, jacobian, scale = random.normal(size=rows), random.normal(size=(rows, count)), random.random(count) + 0.1
    r, j = minimiser._small(residual, jacobian, scale)
    wide = 32 * -(-count // 32)
    assert (r.shape, j.shape) == ((wide + 1,), (wide + 1, wide))
    scaled = jacobian * scale
    np.testing.assert_allclose(r @ r, residual @ residual, rtol=1e-13)
    np.testing.assert_allclose((j.T @ r)[:count], scaled.T @ residual, atol=1e-12 * np.abs(scaled.T @ residual).max())
    np.testing.assert_allclose((j.T @ j)[:count, :count], scaled.T @ scaled, atol=1e-12 * rows)
    assert not j[:, count:].any()


@pytest.mark.parametrize(("most", "converged"), [(3, False), (21, True)])
def test_at_the_limit_of_iterations_only_a_minimum_is_convergence(most: int, converged: bool):
    """Without a limit the search ends after 23 evaluations; the last two do not move any more."""

    def rosenbrock(b: jax.Array) -> jax.Array:
        return jnp.stack([1.0 - b[0], 10.0 * (b[1] - b[0] ** 2), jnp.asarray(0.1)])

    jacobian = jax.jacfwd(rosenbrock)
    start = np.array([-1.2, 1.0])
    found = minimise(lambda b: (np.asarray(rosenbrock(b)), np.asarray(jacobian(b))), start, max_iterations=most)
    assert found.converged == converged
    assert found.iterations == most
    assert "limit" in found.message


@pytest.mark.parametrize(("second", "chosen"), [(2.0, 1.0), (0.5, 0.5), (1.0, 1.0)])
def test_a_second_search_counts_only_if_it_ends_as_low(monkeypatch, second: float, chosen: float):
    """The first did not converge; the second, with other units, ends at a minimum."""
    ends = [Minimum(np.zeros(2), 1.0, False, 5, "first"), Minimum(np.ones(2), second, True, 5, "second")]
    monkeypatch.setattr(minimiser, "_search", lambda *unused: ends.pop(0))
    monkeypatch.setattr(minimiser, "_to_the_end", lambda evaluate, found, *rest: found)
    found = minimise(quadratic, np.array([3.0, -2.0]))
    assert (found.cost, found.converged) == (chosen, second <= 1.0)


def test_a_search_that_ended_in_a_valley_goes_on_to_the_minimum():
    """(y - 1)^2 + (3 y - 2)^2 + 1e4: 1e4 + 0.05 / 2 at y = 0.7, by hand."""

    def valley(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.array([point[0] - 1.0, 3.0 * point[0] - 2.0, 100.0]), np.array([[1.0], [3.0], [0.0]])

    early = Minimum(np.array([0.2]), 0.5 * (0.8**2 + 1.4**2 + 1e4), False, 7, "early")
    found = minimiser._to_the_end(valley, early, np.ones(1), (1e-7, 1e-9))
    assert found.converged
    assert found.point == pytest.approx(0.7, abs=1e-6)
    assert found.iterations > 7


@pytest.mark.parametrize(("slope", "converged"), [(0.02, True), (0.2, False)])
def test_a_fall_that_no_step_keeps_is_no_fall_unless_it_is_large(slope: float, converged: bool):
    """y^2 + (1 + s |y|)^2 is least at 0, where a fall by s^2 of it is predicted: 4e-4 and 4e-2; 1e-4 is negligible."""

    def corner(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        y = point[0]
        return np.array([y, 1.0 + slope * abs(y)]), np.array([[1.0], [slope if y > 0.0 else -slope]])

    found = minimiser._to_the_end(corner, Minimum(np.zeros(1), 0.5, False, 7, "early"), np.ones(1), (1e-5, 1e-9))
    assert found.converged == converged


def test_the_cost_is_that_of_the_point():
    """A kink where a step is rejected although it lowers the cost a little: that cost is of no point that is kept."""

    def kinked(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        slope = -1.0 if point[0] < 1.0 else 0.98
        return np.array([1.0 + slope * (point[0] - 1.0)]), np.array([[slope]])

    for start in np.linspace(0.05, 0.995, 150)[90:96]:
        found = minimise(kinked, np.array([start]), max_iterations=30)
        assert found.cost == 0.5 * float(kinked(found.point)[0][0]) ** 2


def test_a_trial_outside_the_domain_is_only_a_rejected_step():
    """log x has no value below zero, where the first full Gauss-Newton step from 3 would land."""

    def evaluate(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.log(point) + 2.0, np.array([[1.0 / point[0]]])

    found = minimise(evaluate, np.array([3.0]), relative_tolerance=1e-14, step_tolerance=1e-12)
    assert found.point[0] == pytest.approx(np.exp(-2.0), rel=1e-8)


def test_a_start_without_a_finite_residual_is_said_in_words():
    with pytest.raises(SysidError, match="not finite at the start"):
        minimise(lambda p: (np.full(2, np.nan), np.eye(2)), np.ones(2))


def test_progress_is_reported():
    seen: list[tuple[int, float]] = []
    minimise(quadratic, np.array([3.0, -2.0]), on_iteration=lambda i, cost: seen.append((i, cost)))
    assert [i for i, _ in seen] == list(range(1, len(seen) + 1))
    assert [c for _, c in seen] == sorted((c for _, c in seen), reverse=True)
    assert seen[0][1] == pytest.approx(6.5)


def test_a_search_that_goes_on_begins_with_the_damping_of_the_one_before():
    """Columns that are nearly the same: with the first damping the way along their difference takes many steps."""
    jacobian = np.array([[1.0, 1.0], [0.0, 3e-3], [0.0, 0.0]])

    def evaluate(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return jacobian @ (point - 1.0) + np.array([0.0, 0.0, 0.1]), jacobian

    first = minimise(evaluate, np.array([3.0, -2.0]))
    again = minimise(evaluate, np.array([0.8, 1.5]))
    goes_on = minimise(evaluate, np.array([0.8, 1.5]), damping=first.damping)
    assert first.damping is not None
    assert goes_on.converged
    np.testing.assert_allclose(goes_on.point, 1.0, rtol=1e-6)
    assert goes_on.iterations <= again.iterations / 3


def test_a_search_that_has_not_converged_hands_on_no_damping():
    def evaluate(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.append(point - 1.0, 1.0), -np.eye(3, 2)

    assert minimise(evaluate, np.array([3.0, -2.0])).damping is None


def test_failed_trials_alone_are_no_convergence():
    """Derivatives of the wrong sign: every trial goes uphill and is rejected, but the slope has not vanished."""

    def evaluate(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.append(point - 1.0, 1.0), -np.eye(3, 2)

    found = minimise(evaluate, np.array([3.0, -2.0]))
    assert not found.converged
    np.testing.assert_array_equal(found.point, [3.0, -2.0])
    # Half of 2^2 + 3^2 of a cost of half of 2^2 + 3^2 + 1^2.
    assert "93 %" in found.message


def test_failed_trials_at_a_minimum_are_convergence():
    """A cost with a kink at its minimum: no smaller cost is found, and none is promised."""

    def evaluate(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.array([np.sqrt(2.0 * (5.0 + np.abs(point[0] - 1.0)))]), np.array([[0.0]])

    found = minimise(evaluate, np.array([1.0]))
    assert found.converged


def test_the_promised_fall_is_that_of_a_straight_line_through_four_points():
    """Least squares through (0, 0), (1, 2), (2, 1), (3, 3): slope 0.8, intercept 0.3, remaining squares 1.8 of 14."""
    x, y = np.arange(4.0), np.array([0.0, 2.0, 1.0, 3.0])
    design = np.stack([np.ones(4), x], axis=1)
    assert promised_fall(-y, 1e6 * design) == pytest.approx(0.5 * (14.0 - 1.8))
    left = 0.3 + 0.8 * x - y
    assert promised_fall(left, design) == pytest.approx(0.0, abs=1e-20)
    # A column of zeros promises nothing.
    assert promised_fall(-y, np.stack([np.ones(4), x, 0.0 * x], axis=1)) == pytest.approx(0.5 * (14.0 - 1.8))


MINIMISE = "minimise(lambda p: (p, np.eye(2)), np.ones(2))"
CAMPAIGN = "synthetic_campaign()"


@pytest.mark.parametrize("what", [MINIMISE, CAMPAIGN])
def test_without_64_bit_floats_fitting_stops_in_one_sentence(what: str):
    code = (
        "import numpy as np\n"
        "from synthetic_fit import synthetic_campaign\n"
        "from sysid.errors import SysidError\n"
        "from sysid.estimation.fit.minimiser import minimise\n"
        f"try:\n    {what}\n"
        "except SysidError as error:\n    print(error)\n"
    )
    folders = [os.getcwd(), str(Path(__file__).parents[1] / "support")]
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"JAX_ENABLE_X64": "0", "PYTHONPATH": os.pathsep.join(folders)},
    )
    assert done.stdout.strip() == (
        "Least squares needs 64-bit floats; call jax.config.update('jax_enable_x64', True) before the first use."
    )


def test_a_coarse_search_may_promise_as_much_as_its_tolerance_lets_go():
    """exp(-y) creeps to zero over a floor of cost 1/2; a search that stops at falls of 1 % has converged as asked."""

    def evaluate(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        slope = np.exp(-point[0])
        return np.array([1.0, slope]), np.array([[0.0], [-slope]])

    coarse = minimise(evaluate, np.array([0.0]), relative_tolerance=1e-2)
    residual, jacobian = evaluate(coarse.point)
    # The Gauss-Newton step promises all of exp(-2 y) / 2, far above the floor of 1e-5 of the cost.
    assert promised_fall(residual, jacobian) == pytest.approx(0.5 * np.exp(-2.0 * coarse.point[0]))
    assert promised_fall(residual, jacobian) > 1e-4 * coarse.cost
    assert coarse.converged


def bent(slopes: tuple[float, float]):
    """Residuals (y_0 - 1, 10 + s y_1): the slope s of the second jumps at y_1 = 0."""

    def evaluate(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        slope = slopes[0] if y[1] < 0.0 else slopes[1]
        return np.array([y[0] - 1.0, 10.0 + slope * y[1]]), np.array([[1.0, 0.0], [0.0, slope]])

    return evaluate


def test_a_corner_is_a_minimum_if_neither_side_goes_down():
    """On either side of y_1 = 0 the tangent promises the whole cost, and the cost rises."""
    evaluate = bent((-1.0, 1.0))
    start = np.array([1.2, 1e-5])
    assert not minimise(evaluate, start, max_iterations=200).converged
    corner = minimise(evaluate, start, corners=[1], max_iterations=200)
    assert corner.converged
    assert corner.message == "the least cost is where a run just reaches a stop"
    np.testing.assert_allclose(corner.point, [1.0, 0.0], atol=1e-4)


@pytest.mark.parametrize(("off", "height"), [(1e-7, 30.0), (0.1, 3.0)])
def test_the_other_unknowns_are_searched_to_their_end_at_a_corner(off: float, height: float):
    """Rosenbrock's valley beside a corner, whose damping makes the steps along the valley short."""

    def evaluate(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        slope = -1.0 if y[1] < 0.0 else 1.0
        residual = np.array([30.0 * (y[2] - y[0] ** 2), 1.0 - y[0], height + slope * y[1]])
        return residual, np.array([[-60.0 * y[0], 0.0, 30.0], [-1.0, 0.0, 0.0], [0.0, slope, 0.0]])

    found = minimise(evaluate, np.array([-1.2, off, 1.0]), corners=[1], relative_tolerance=1e-7, max_iterations=40)
    assert found.converged
    np.testing.assert_allclose(found.point, [1.0, 0.0, 1.0], atol=1e-3)


def test_an_unknown_that_can_still_fall_is_at_no_corner():
    """Of two travels one is at a corner, and the other on a slope: only the first is held, and the second found."""

    def evaluate(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        slope = -1.0 if y[1] < 0.0 else 1.0
        residual = np.array([y[0] - 1.0, 30.0 + slope * y[1], y[2] - 2.0])
        return residual, np.array([[1.0, 0.0, 0.0], [0.0, slope, 0.0], [0.0, 0.0, 1.0]])

    point = np.array([1.0, 0.0, 0.8])
    assert unknowns_at_corners(evaluate, point, *evaluate(point), [1, 2], 1e-4) == [1]
    found = minimise(evaluate, np.array([1.3, 1e-6, 0.8]), corners=[1, 2])
    assert found.converged
    np.testing.assert_allclose(found.point, [1.0, 0.0, 2.0], atol=1e-3)


@pytest.mark.parametrize("outside", [np.nan, np.inf])
def test_trials_that_are_not_finite_show_no_corner(outside: float):
    def evaluate(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.array([10.0 if y[0] == 0.0 else outside]), np.array([[1.0]])

    assert unknowns_at_corners(evaluate, np.zeros(1), *evaluate(np.zeros(1)), [0], 1e-4) == []


def test_without_unknowns_that_may_have_corners_there_are_none():
    evaluate = bent((-1.0, 1.0))
    point = np.array([1.0, 0.0])
    assert unknowns_at_corners(evaluate, point, *evaluate(point), [], 1e-4) == []
    assert unknowns_at_corners(bent((1.0, 1.0)), point, *bent((1.0, 1.0))(point), [1], 1e-4) == []
