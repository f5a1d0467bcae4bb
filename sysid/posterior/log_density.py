"""Log-density of the global parameters: the least-squares residuals with all other unknowns integrated out.

Motions of the runs and clocks of their loggers are integrated out along the columns that they have at the optimum
(:mod:`sysid.estimation.residuals.set_misfits`), and so are masses, departures, model error and undecided laws
(:mod:`sysid.estimation.uncertainty.integrated_unknowns`).  Residuals are tempered by their variance inflation, sensor
offsets and gains are eliminated inside them, and the Gaussian priors of the log parameters are added:

    log p(x) = -1/2 [ sum over runs (r'r - b'N^-1 b) / f - |W'r / f + c|^2 ] - 1/2 |P^1/2 (x - m)|^2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.arrays import Parameters, ParametersByParameters
from sysid.estimation.fit.state import FitState
from sysid.estimation.residuals.fewer_samples import with_fewer_samples
from sysid.estimation.residuals.larger_steps import with_larger_steps
from sysid.estimation.residuals.run_clocks import run_clocks
from sysid.estimation.residuals.set_misfits import GroupInputs, group_inputs, group_misfits
from sysid.estimation.uncertainty.allowance_columns import allowance_columns
from sysid.estimation.uncertainty.allowances import Allowances
from sysid.estimation.uncertainty.integrated_unknowns import nothing_integrated
from sysid.estimation.uncertainty.residual_columns import ResidualColumns
from sysid.estimation.uncertainty.run_scores import own_columns, own_priors
from sysid.vehicle_model.engines.protocol import Columns

#: Description of the likelihood, for the user.
LIKELIHOOD = (
    "Gaussian residuals, heavy tails by weights of single readings; scale per run and channel from the least-squares "
    "residuals; residuals correlated in time are tempered by their variance inflation; run motions, clocks, tolerances "
    "of declared masses, departures from the model and model error (a sandwich over blocks of channel and case) "
    "integrated out, sensor offset and gain eliminated"
)


class LogDensity:
    """Vectorised log-posterior density of the global log parameters, up to a constant.

    Calling it with (n, p) returns (n,); a set whose simulation is not finite gets -inf.
    """

    def __init__(self, state: FitState, allowances: Allowances | None = None):
        """`allowances` are those of the state, where they are known already."""
        point = state.point
        self._state, self._model, self._point = state, state.model, point
        self._allowances = allowances
        self.names = state.parameters.names
        self.centre = np.asarray(point.log_parameters, float)
        self._rows, self._targets = state.parameters.prior_rows()
        self._integrated = point.integrated or nothing_integrated(self.centre.size)
        # A linear term that makes up for larger integration steps.
        self._tilt = np.zeros_like(self.centre)
        self._inputs = self._prepared()

    def _prepared(self) -> list[GroupInputs]:
        """Columns of everything that is integrated out, for every group of runs."""
        state, point, directions = self._state, self._point, self._integrated.directions
        problem, clocks, count = state.problem(), run_clocks(state.campaign), self.centre.size
        vector = problem.vector(self.centre)
        kinds: tuple[Sequence[ResidualColumns], ...] = ()
        if len(directions) > count:
            self._allowances = self._allowances or state.allowances
            known_of = self._allowances, point.weights, self.centre, point.motion, point.amounts
            kinds = allowance_columns(state.model, *known_of)
        inputs = []
        for position in range(len(state.model.groups)):
            lin = problem.linearise_one(vector, position)
            shared = Columns(np.zeros((*lin.residual.shape, 1)), np.zeros((*lin.gain_residual.shape, 1)))
            if directions.any():
                own = ResidualColumns(*(np.asarray(j)[..., :count] for j in (lin.residual_jacobian, lin.gain_jacobian)))
                shared = _along([own, *(of_kind[position] for of_kind in kinds)], directions)
            columns = own_columns(problem, position, lin, clocks)
            priors = own_priors(problem, point.motion, position, clocks)
            inputs.append(group_inputs(state.model, point.weights, point.motion, position, columns, priors, shared))
        return inputs

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
        other = LogDensity(replace(self._state, model=model, point=replace(point, weights=weights)), self._allowances)
        sides = _principal_axes(np.asarray(point.covariance, float))
        sets = np.concatenate([self.centre[None], self.centre + sides, self.centre - sides])
        other._tilt = _common_slope(other(sets) - self(sets), sides)
        return other

    def __call__(self, log_parameters: Parameters) -> np.ndarray:
        """Log-density (n,) of parameter sets (n, p)."""
        points = np.atleast_2d(np.asarray(log_parameters, float))
        followed = self._integrated.followed(points - self.centre)
        change = self._integrated.simulated(followed)
        directions = self._integrated.directions
        squares, products = np.zeros(len(points)), np.zeros((directions.shape[1], len(points)))
        for inputs, shape in zip(self._inputs, self._model.shapes, strict=True):
            of_group, of_shared = group_misfits(inputs, (self.centre + change).T, shape=shape)
            squares, products = squares + of_group, products + of_shared
        density = self._integrated.log_density(squares, products, followed)
        density -= 0.5 * (self._off_prior(points) ** 2).sum(axis=1) + (points - self.centre) @ self._tilt
        return np.asarray(np.where(np.isfinite(density), density, -np.inf))

    def _off_prior(self, points: np.ndarray) -> np.ndarray:
        # Not by a matrix product, whose rounding depends on how many points there are.
        return np.asarray((points[:, None, :] * self._rows).sum(axis=-1) - self._targets)


def _along(kinds: Sequence[ResidualColumns], directions: np.ndarray) -> Columns:
    """Columns along combinations of unknowns: columns of n_1, n_2, ... times `directions` (n_1 + n_2 + ..., K)."""
    residual, gain, first = 0.0, 0.0, 0
    for of_kind in kinds:
        part = directions[first : first + of_kind.gain.shape[-1]]
        residual, gain, first = residual + of_kind.residual @ part, gain + of_kind.gain @ part, first + len(part)
    return Columns(np.asarray(residual), np.asarray(gain))


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
