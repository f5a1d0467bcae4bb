"""Log-density of the global parameters: the least-squares residuals with the runs' own unknowns marginalised.

At the optimum the speed and start of a run move its residuals along the columns J_eta.  Integrating them out with
their Gaussian priors leaves, per run,

    -1/2 (r'r - b' N^-1 b),   b = J_eta' r + prior,   N = J_eta' J_eta + prior precision,

so the sampler sees global parameters only. Residuals are tempered by their variance inflation, the likelihood is
flattened around the optimum for model error and tolerances of masses (:mod:`sysid.estimation.sandwich`), and the
Gaussian priors of the log parameters are added.  Flattened about the optimum theta_hat, which the priors have pulled
off the data's own one, the likelihood would keep too much of that pull: its gradient g there becomes C' g, but a
likelihood of curvature C'HC about the data's optimum has C'C' g.  A linear term makes up the difference.  Sensor
offsets and gains are eliminated inside the residuals.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from sysid.campaign.records import Campaign
from sysid.estimation.bump_model import GroupArrays, GroupShape, group_residuals, simulate_group, wheel_road
from sysid.estimation.native_residuals import native_misfits
from sysid.estimation.objective import SPEED_UNIT, linearise, speed_prior
from sysid.estimation.problem import FitState
from sysid.vehicle_model.contact import RoadInput
from sysid.vehicle_model.engine import LocalColumns, WheelRoad
from sysid.vehicle_model.simulation import Motion

#: What the likelihood is, for people.
LIKELIHOOD = (
    "Gaussian residuals; scale per run and channel from the least-squares residuals; residuals correlated in time "
    "are tempered by their variance inflation; the likelihood is flattened for model error, departures from the "
    "model and tolerances of declared masses by a sandwich over blocks of channel and case (curvature adjustment); "
    "run speed and start marginalised, sensor offset and gain eliminated"
)


class _GroupInputs(NamedTuple):
    arrays: GroupArrays
    road: WheelRoad
    motion: Motion
    noise_sd: np.ndarray
    tempering: np.ndarray
    local_columns: np.ndarray
    gain_columns: np.ndarray
    local_offset: np.ndarray
    local_factor: np.ndarray


@partial(jax.jit, static_argnames=("shape",))
def _group_misfit(inputs: _GroupInputs, log_parameters: jax.Array, *, shape: GroupShape) -> jax.Array:
    """Sum over runs of r'r - b' N^-1 b for every parameter set, (S,)."""
    if not isinstance(inputs.road, RoadInput):
        local = LocalColumns(inputs.local_columns, inputs.gain_columns, inputs.local_offset, inputs.local_factor)
        weights = (inputs.noise_sd, inputs.tempering)
        return native_misfits(inputs.arrays, shape, inputs.road, weights, log_parameters, local).sum(axis=0)
    simulated = simulate_group(inputs.arrays, shape, log_parameters, inputs.motion, inputs.road)
    residual, gain = group_residuals(inputs.arrays, inputs.noise_sd, inputs.tempering, simulated)
    squares = (residual**2).sum(axis=(0, 2)) + (gain**2).sum(axis=1)
    projections = []
    for k in range(2):
        along = (residual * inputs.local_columns[..., k, None]).sum(axis=(0, 2))
        along = along + (gain * inputs.gain_columns[..., k, None]).sum(axis=1)
        projections.append(along + inputs.local_offset[:, k, None])
    b = jnp.stack(projections, axis=1)
    whitened = jnp.matmul(inputs.local_factor, b)
    return (squares - (whitened**2).sum(axis=1)).sum(axis=0)


class LogDensity:
    """Vectorised log-posterior density of the global log parameters, up to a constant.

    Calling it with (n, p) returns (n,); a set whose simulation is not finite gets -inf and is kept in
    `rejected` (at most 100 of them) with the number of such sets in `rejected_count`.
    """

    def __init__(self, campaign: Campaign, state: FitState):
        self._model = state.model
        self.names = state.model.parameters.names
        self.centre = np.asarray(state.log_parameters, float)
        self._adjustment = np.asarray(state.adjustment, float)
        self._rows, self._targets = state.model.parameters.prior_rows()
        # At the optimum the data pull as hard as the priors, the other way.
        pull = -self._rows.T @ (self._rows @ self.centre - self._targets)
        flat = self._adjustment.T
        self._tilt = (flat @ flat - flat) @ pull
        self.rejected: list[np.ndarray] = []
        self.rejected_count = 0
        expected = speed_prior(campaign.bump_runs)
        count = self.centre.size
        self._inputs = []
        lin = linearise(state.model, state.weights, self.centre, state.motion)
        for position, group in enumerate(state.model.groups):
            runs = list(group.runs)
            speed, start = state.motion.speed_m_s[runs], state.motion.start_s[runs]
            local = np.asarray(lin[position].residual_jacobian[..., count:])
            gain = np.asarray(lin[position].gain_jacobian[..., count:])
            nominal, sd = expected.speed_m_s[runs], expected.relative_sd[runs]
            prior = np.stack([SPEED_UNIT * speed / nominal / sd, np.zeros_like(speed)], axis=1)
            normal = np.einsum("trck,trcl->rkl", local, local) + np.einsum("rck,rcl->rkl", gain, gain)
            normal += np.einsum("rk,rl->rkl", prior, prior)
            pull = ((speed / nominal - 1.0) / sd)[:, None] * prior
            motion = Motion(jnp.asarray(speed)[:, None], jnp.asarray(start)[:, None])
            arrays, shape = state.model.arrays[position], state.model.shapes[position]
            road = wheel_road(arrays, state.model.roads[position], motion.speed, motion.start_s, shape)
            self._inputs.append(
                _GroupInputs(
                    arrays,
                    road,
                    motion,
                    state.weights.noise_sd[position],
                    state.weights.tempering[position],
                    local,
                    gain,
                    pull,
                    np.linalg.inv(np.linalg.cholesky(normal)),
                )
            )

    def __call__(self, log_parameters: np.ndarray) -> np.ndarray:
        """Log-density (n,) of parameter sets (n, p)."""
        points = np.atleast_2d(np.asarray(log_parameters, float))
        # The likelihood is flattened around the optimum; the priors are not.
        sets = jnp.asarray((self.centre + (points - self.centre) @ self._adjustment.T).T)
        misfit = np.zeros(points.shape[0])
        for inputs, shape in zip(self._inputs, self._model.shapes, strict=True):
            misfit = misfit + np.asarray(_group_misfit(inputs, sets, shape=shape))
        prior = ((points @ self._rows.T - self._targets) ** 2).sum(axis=1)
        density = -0.5 * (misfit + prior) - (points - self.centre) @ self._tilt
        bad = ~np.isfinite(density)
        if bad.any():
            self.rejected_count += int(bad.sum())
            self.rejected += list(points[bad][: max(0, 100 - len(self.rejected))])
            density = np.where(bad, -np.inf, density)
        return density
