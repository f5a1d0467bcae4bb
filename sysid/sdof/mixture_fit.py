"""Least squares of one mixture of viscous, dry and quadratic damping on the free part of a record."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from sysid.sdof.decay_window import DecayWindow
from sysid.sdof.drop_results import DampingTerm
from sysid.sdof.ring_down import RingDown, ring_down
from sysid.sdof.whitening import whiten

#: Places of the parameters of :func:`ring_down`, and of each term's.
OMEGA, LEVEL, PLACE, RATE, STIFFENING = 0, 1, 2, 3, 7
OF_TERM = {"viscous": 4, "friction": 5, "quadratic": 6}


@dataclass(frozen=True)
class MixtureFit:
    """Least squares of one kind: `free` parameters, all `parameters` (8,), whitened residual and Jacobian."""

    terms: tuple[DampingTerm, ...]
    free: list[int]
    parameters: np.ndarray
    residual: np.ndarray
    whitened: np.ndarray
    jacobian: np.ndarray
    motion: RingDown

    @property
    def criterion(self) -> float:
        """Bayesian information criterion of normal residuals of unknown variance."""
        n = self.whitened.size
        return n * float(np.log(max(np.mean(self.whitened**2), 1e-300))) + len(self.free) * float(np.log(n))


def fit_mixture(
    window: DecayWindow,
    terms: tuple[DampingTerm, ...],
    whitener: np.ndarray,
    starts: list[np.ndarray],
    stiffening: bool = False,
    most: int = 1,
) -> MixtureFit | None:
    """Least squares of one mixture from the best of several starts, or from the `most` best of them.

    None where none ends in finite numbers.
    """
    problem = _problem(window, terms, whitener, stiffening)
    fits = (_fit_from(problem, start) for start in _best_starts(problem, starts)[:most])
    return min((f for f in fits if f is not None), key=lambda f: float(np.sum(f.whitened**2)), default=None)


@dataclass(frozen=True)
class _Problem:
    """Least squares of one mixture: `free` of the eight parameters in their `unit`, between `lower` and `upper`."""

    window: DecayWindow
    terms: tuple[DampingTerm, ...]
    whitener: np.ndarray
    free: list[int]
    unit: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    def inside(self, parameters: np.ndarray) -> np.ndarray:
        """Parameters (8,) over their units, those that are not free zero, the others within the bounds."""
        base = np.zeros(8)
        base[self.free] = np.clip(parameters / self.unit, self.lower + 1e-6, self.upper - 1e-6)[self.free]
        return base

    def whiten(self, value: np.ndarray) -> np.ndarray:
        """Rows of (m,) or (m, p) values without the part that the readings before predict."""
        return whiten(value, self.whitener, self.window.first_of_run)


def _problem(window: DecayWindow, terms: tuple[DampingTerm, ...], whitener: np.ndarray, stiffening: bool) -> _Problem:
    amplitude, omega = window.amplitude, float(window.start[OMEGA])
    unit = np.array(
        [omega, amplitude, amplitude, amplitude * omega, omega, amplitude, 1.0 / amplitude, 1.0 / amplitude**2]
    )
    free = [OMEGA, LEVEL, PLACE, RATE, *(OF_TERM[t] for t in terms), *([STIFFENING] if stiffening else [])]
    return _Problem(window, terms, whitener, free, unit, *_bounds(window.direction))


def _best_starts(problem: _Problem, starts: list[np.ndarray]) -> list[np.ndarray]:
    """Start values over their units, the one with the smallest sum of squares first."""
    rows = np.stack([problem.inside(start) for start in starts])
    if len(starts) == 1:
        return list(rows)
    window = problem.window
    with np.errstate(over="ignore", invalid="ignore"):
        value = ring_down(rows * problem.unit, window.time, window.direction).value
        cost = np.sum(problem.whiten((value - window.value).T) ** 2, axis=0)
    return [rows[i] for i in np.argsort(np.where(np.isfinite(cost), cost, np.inf), kind="stable")]


def _fit_from(problem: _Problem, base: np.ndarray) -> MixtureFit | None:
    """Least squares from one start (8,) over the units."""
    window, free, unit = problem.window, problem.free, problem.unit
    kept: dict[bytes, tuple[np.ndarray, np.ndarray, RingDown]] = {}

    def everything(p: np.ndarray) -> tuple[np.ndarray, np.ndarray, RingDown]:
        key = p.tobytes()
        if key not in kept:
            kept.clear()
            kept[key] = _residual_and_jacobian(window, base, unit, free, p)
        return kept[key]

    try:
        solution = least_squares(
            lambda p: problem.whiten(everything(p)[0]),
            base[free],
            jac=lambda p: problem.whiten(everything(p)[1]),
            bounds=(problem.lower[free], problem.upper[free]),
            x_scale="jac",
            xtol=1e-7,
            ftol=1e-7,
            gtol=1e-10,
            max_nfev=60,
        )
    except (ValueError, FloatingPointError, np.linalg.LinAlgError):
        return None
    residual, jacobian, motion = everything(solution.x)
    parameters = np.zeros(8)
    parameters[free] = solution.x * unit[free]
    amplitude = window.amplitude
    whitened = problem.whiten(residual) * amplitude
    scaled = problem.whiten(jacobian) * amplitude / unit[free]
    if not (np.all(np.isfinite(whitened)) and np.all(np.isfinite(scaled))):
        return None
    return MixtureFit(problem.terms, free, parameters, residual * amplitude, whitened, scaled, motion)


def _bounds(direction: float) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest parameters (8,) over their units."""
    lower, upper = np.full(8, -1e6), np.full(8, 1e6)
    lower[OMEGA], upper[OMEGA] = 0.75, 1.3
    lower[4:7], upper[4:7] = 0.0, (0.8, 0.6, 3.0)
    lower[STIFFENING], upper[STIFFENING] = -0.3, 0.5
    lower[RATE], upper[RATE] = (0.05, 1e6) if direction > 0 else (-1e6, -0.05)
    return lower, upper


def _residual_and_jacobian(
    window: DecayWindow, base: np.ndarray, unit: np.ndarray, free: list[int], p: np.ndarray
) -> tuple[np.ndarray, np.ndarray, RingDown]:
    """Residual over the amplitude (n,), its forward differences (n, free) and the motion."""
    step = 1e-6
    rows = np.tile(base, (len(free) + 1, 1))
    rows[:, free] = p
    rows[np.arange(1, len(free) + 1), free] += step
    with np.errstate(over="ignore", invalid="ignore"):
        motion = ring_down(rows * unit, window.time, window.direction)
    value = motion.value / window.amplitude
    return value[0] - window.value / window.amplitude, (value[1:] - value[0]).T / step, motion


def price_of_leaving(full: MixtureFit, terms: tuple[DampingTerm, ...]) -> float:
    """Increase of the sum of squares over the variance when other terms than `terms` go, by the full fit's slopes."""
    gone, covariance = _without(full, terms)
    value = full.parameters[[full.free[i] for i in gone]]
    scale = np.sqrt(np.maximum(np.diagonal(covariance)[gone], 1e-300))
    correlation = covariance[np.ix_(gone, gone)] / np.outer(scale, scale)
    return float((value / scale) @ np.linalg.pinv(correlation) @ (value / scale))


def without_others(full: MixtureFit, terms: tuple[DampingTerm, ...]) -> np.ndarray:
    """Parameters (8,) that come nearest to the full fit without its other terms than `terms`, by its slopes."""
    gone, covariance = _without(full, terms)
    with_gone = covariance[:, gone]
    scale = np.sqrt(np.maximum(np.diagonal(covariance), 1e-300))
    correlation = covariance[np.ix_(gone, gone)] / np.outer(scale[gone], scale[gone])
    value = full.parameters[[full.free[i] for i in gone]] / scale[gone]
    moved = full.parameters.copy()
    moved[full.free] -= (with_gone / scale[gone]) @ np.linalg.pinv(correlation) @ value
    return moved


def _without(full: MixtureFit, terms: tuple[DampingTerm, ...]) -> tuple[list[int], np.ndarray]:
    """Places among the free parameters of the terms that go, and the covariance of all free parameters."""
    gone = [full.free.index(OF_TERM[t]) for t in full.terms if t not in terms]
    scale = np.maximum(np.linalg.norm(full.jacobian, axis=0), 1e-300)
    scaled = full.jacobian / scale
    covariance = np.linalg.pinv(scaled.T @ scaled, rcond=1e-12) * float(np.mean(full.whitened**2))
    return gone, covariance / np.outer(scale, scale)
