"""Log-density of the global parameters: the least-squares residuals with the runs' own unknowns marginalised.

The motions of the runs are integrated out with the columns of the optimum
(:mod:`sysid.estimation.residuals.set_misfits`), so the sampler sees global parameters only. Residuals are tempered by
their variance inflation, sensor offsets and gains are eliminated inside them, and the Gaussian priors of the log
parameters are added.  Masses and departures stay where the fit ends: what they and model error add is given to the
draws afterwards (:mod:`sysid.estimation.uncertainty.spread`).  Footprint maps stay too, but changes of parameters are
taken as maps that follow the tires would act.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sysid.arrays import Parameters, ParametersByParameters
from sysid.estimation.fit.state import FitState
from sysid.estimation.residuals.fewer_samples import with_fewer_samples
from sysid.estimation.residuals.larger_steps import with_larger_steps
from sysid.estimation.residuals.linearisation import linearise_one
from sysid.estimation.residuals.run_motion import motion_prior
from sysid.estimation.residuals.set_misfits import group_inputs, group_misfits

#: Description of the likelihood, for the user.
LIKELIHOOD = (
    "Gaussian residuals, heavy tails by weights of single readings; scale per run and channel from the least-squares "
    "residuals; residuals correlated in time are tempered by their variance inflation; run motions marginalised, "
    "sensor offset and gain eliminated; tolerances of declared masses, departures from the model and model error (a "
    "sandwich over blocks of channel and case) add a normal deviation to every draw"
)


class LogDensity:
    """Vectorised log-posterior density of the global log parameters, up to a constant.

    Calling it with (n, p) returns (n,); a set whose simulation is not finite gets -inf.
    """

    def __init__(self, state: FitState):
        point = state.point
        self._state, self._model, self._point = state, state.model, point
        self.names = state.parameters.names
        self.centre = np.asarray(point.log_parameters, float)
        self._rows, self._targets = state.parameters.prior_rows()
        self._following = np.eye(self.centre.size) if point.following is None else np.asarray(point.following, float)
        # A linear term that makes up for larger integration steps.
        self._tilt = np.zeros_like(self.centre)
        expected = motion_prior(state.campaign.bump_runs)
        self._inputs = []
        for position in range(len(state.model.groups)):
            lin = linearise_one(state.model, point.weights, self.centre, point.motion, position)
            self._inputs.append(group_inputs(state.model, point.weights, point.motion, expected, position, lin))

    def with_larger_steps(self) -> LogDensity:
        """Nearly the same density with larger integration steps: less work.

        At the centre, records take up what larger steps change (:mod:`sysid.estimation.residuals.larger_steps`). Around
        it, a linear term does (:func:`_common_slope`). Readings that are closer to each other than such steps are
        joined (:mod:`sysid.estimation.residuals.fewer_samples`).
        """
        point = self._point
        fewer = with_fewer_samples(self._model, point.weights, self.centre, point.motion)
        model, weights = fewer or (with_larger_steps(self._model, self.centre, point.motion), point.weights)
        if model is self._model:
            return self
        other = LogDensity(replace(self._state, model=model, point=replace(point, weights=weights)))
        sides = _principal_axes(np.asarray(point.covariance, float))
        sets = np.concatenate([self.centre[None], self.centre + sides, self.centre - sides])
        other._tilt = _common_slope(other(sets) - self(sets), sides)
        return other

    def __call__(self, log_parameters: Parameters) -> np.ndarray:
        """Log-density (n,) of parameter sets (n, p)."""
        points = np.atleast_2d(np.asarray(log_parameters, float))
        sets = self._sets(points)
        misfit = np.zeros(points.shape[0])
        for inputs, shape in zip(self._inputs, self._model.shapes, strict=True):
            misfit = misfit + np.asarray(group_misfits(inputs, sets, shape=shape))
        return self._density(points, misfit)

    def _sets(self, points: np.ndarray) -> np.ndarray:
        """Parameter sets (p, n) that are simulated: as if the footprint maps followed the tires."""
        return np.asarray((self.centre + (points - self.centre) @ self._following.T).T)

    def _off_prior(self, points: np.ndarray) -> np.ndarray:
        # Not by a matrix product, whose rounding depends on how many points there are.
        return np.asarray((points[:, None, :] * self._rows).sum(axis=-1) - self._targets)

    def _density(self, points: np.ndarray, misfit: np.ndarray) -> np.ndarray:
        prior = (self._off_prior(points) ** 2).sum(axis=1)
        density = -0.5 * (misfit + prior) - (points - self.centre) @ self._tilt
        return np.asarray(np.where(np.isfinite(density), density, -np.inf))


def _principal_axes(covariance: ParametersByParameters) -> ParametersByParameters:
    """Principal axes (p, p) of a normal distribution, one per row and one standard deviation long.

    Parameters
    ----------
    covariance : (p, p) of the log parameters.
    """
    scale = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray((vectors * np.sqrt(np.maximum(values, np.finfo(float).eps * values[-1]))).T * scale)


def _common_slope(values: np.ndarray, axes: ParametersByParameters) -> Parameters:
    """Slope (p,) that a function has on both sides of a point: along each axis the smaller one, 0 if signs differ.

    Where a run just reaches a stop, the log-density has a corner, a little elsewhere for other integration steps.  The
    derivative of their difference can then be large on one side, over a distance of micrometres, and says nothing of
    what is beyond.

    Parameters
    ----------
    values : (1 + 2 p,) at the point, and at the ends of the axes forth and back.
    axes : (p, p), one per row, linearly independent.
    """
    count = len(axes)
    forth, back = values[1 : 1 + count] - values[0], values[0] - values[1 + count :]
    agree = np.isfinite(forth) & np.isfinite(back) & (forth * back > 0.0)
    smaller = np.where(np.abs(forth) < np.abs(back), forth, back)
    return np.asarray(np.linalg.solve(axes, np.where(agree, smaller, 0.0)))
