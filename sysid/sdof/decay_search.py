"""Most probable unknowns of several models of one decay at once, by damped least squares on readings and priors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.sdof.decay_models import BESIDE, Elements, Priors, beside, free, motion

_DIFFERENCE = 1e-5  # of a prior standard deviation, for the derivatives
_SETTLED = 0.01  # of the sum of squares: a step that gains less ends a search
_HOPELESS = 80.0  # of the sum of squares behind the best, for a search that gains less than
_SLOW = 0.05  # of it in a step, after
_TRIED = 7  # steps
_FAR = 1e6  # standard deviations: the residual of a motion that ran away


@dataclass(frozen=True)
class Readings:
    """Times (n,) [s] from the first on, readings (n,) [m] and the standard deviation of one [m]."""

    time_s: np.ndarray
    value: np.ndarray
    sd: float


@dataclass(frozen=True)
class Optimum:
    """The most probable unknowns x (u,) of one model, and what its evidence needs.

    - `squares`: sum of squared residuals [m^2]; `information` (u, u): J'J [m^2] of the curve;
    - `curve` (n,) [m]; `sd` of a reading with which the search was made.
    """

    model: Elements
    x: np.ndarray
    squares: float
    information: np.ndarray
    curve: np.ndarray

    def curvature(self, sd: float) -> np.ndarray:
        """Half the second derivative (u, u) of -2 log posterior, J'J / sd^2 + 1."""
        return np.asarray(self.information / sd**2 + np.eye(self.x.size))

    def evidence(self, sd: float) -> float:
        """Log of the integral of likelihood and priors by Laplace's method, up to a number common to all models."""
        penalty = self.squares / sd**2 + float(self.x @ self.x)
        return -0.5 * (penalty + float(np.linalg.slogdet(self.curvature(sd))[1]))


def search(
    readings: Readings, priors: Priors, starts: list[tuple[Elements, np.ndarray]], most: int = 25
) -> list[Optimum]:
    """Minimise sum ((curve - reading) / sd)^2 + sum x^2 for every model, all in one run of the integrator per step.

    Parameters
    ----------
    readings, priors
        Readings with their standard deviation; priors of the unknowns, in whose standard deviations x is.
    starts
        Models and the x (u,) at which their searches begin; a model may stand there more than once.
    most
        Number of steps.
    """
    freed = np.stack([free(model) for model, _ in starts])
    x = np.clip(np.stack([start for _, start in starts]), priors.lowest, priors.highest) * freed
    damping = np.full(len(starts), 1e-3)
    state = _linearised(x, readings, priors, freed)
    active, last = np.ones(len(starts), bool), np.zeros(len(starts), bool)
    for step in range(most):
        at = np.flatnonzero(active)
        if at.size == 0:
            break
        cost, _, gradient, curvature = (part[at] for part in state)
        diagonal = np.einsum("mii->mi", curvature)
        scaled = curvature + (damping[at, None] * diagonal)[:, :, None] * np.eye(x.shape[1])
        move = np.linalg.solve(scaled, gradient[:, :, None])[:, :, 0]
        trial = np.clip(x[at] - move * freed[at], priors.lowest, priors.highest)
        new = _linearised(trial, readings, priors, freed[at])
        better = new[0] < cost
        for part, fresh in zip((x, *state), (trial, *new), strict=True):
            part[at[better]] = fresh[better]
        damping[at] *= np.where(better, 0.1, 8.0)
        # The last step is undamped, so that what only the priors hold moves to where they want it.
        active[at[last[at] | (damping[at] > _FAR)]] = False
        settled = at[better & (cost - new[0] < _SETTLED)]
        last[settled], damping[settled] = True, 0.0
        if step >= _TRIED:
            behind = state[0][at] - state[0].min()
            active[at[(behind > _HOPELESS) & (np.where(better, cost - new[0], 0.0) < _SLOW * behind)]] = False
    cost, curve, _, curvature = state
    penalty = np.sum(x**2, axis=1)
    information = (curvature - np.eye(x.shape[1])) * readings.sd**2
    squares = (cost - penalty) * readings.sd**2
    return [Optimum(m, x[i], float(squares[i]), information[i], curve[i]) for i, (m, _) in enumerate(starts)]


def _linearised(
    x: np.ndarray, readings: Readings, priors: Priors, freed: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Sums of squares (m,), curves (m, n), half gradients (m, u) and curvatures (m, u, u) at x (m, u)."""
    models, count = x.shape
    time, sd = readings.time_s, readings.sd
    whose, which = np.nonzero(freed & (priors.sd > 0.0))
    # Differences are taken inwards at a bound.
    signed = np.where(x[whose, which] + _DIFFERENCE > priors.highest[which], -_DIFFERENCE, _DIFFERENCE)
    moved = x[whose]
    moved[np.arange(whose.size), which] += signed
    outside = np.isin(which, BESIDE)
    own = motion(priors.values(np.concatenate([x, moved[~outside]])), time)
    plain = beside(priors.values(x), time)
    slope = np.empty((whose.size, time.size))
    slope[~outside] = own[models:] - own[whose[~outside]]
    slope[outside] = beside(priors.values(moved[outside]), time) - plain[whose[outside]]
    slope /= signed[:, None] * sd
    curve = own[:models] + plain
    residual = np.clip(np.nan_to_num((curve - readings.value) / sd, nan=_FAR), -_FAR, _FAR)
    jacobian = np.zeros((models, count, time.size))
    jacobian[whose, which] = np.clip(np.nan_to_num(slope), -1e3 * _FAR, 1e3 * _FAR)
    curvature = jacobian @ jacobian.transpose(0, 2, 1) + np.eye(count)
    gradient = (jacobian @ residual[:, :, None])[:, :, 0] + x
    return np.sum(residual**2, axis=1) + np.sum(x**2, axis=1), curve, gradient, curvature
