"""The least-squares objective: all residuals of a campaign and their exact Jacobian.

The unknowns are the global log parameters x (p,), and per run a relative speed change and a start shift in scaled
units.  A run's speed and start touch that run only, so p + 2 forward-mode tangents give the Jacobian of all runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from sysid.campaign.records import BumpRun
from sysid.estimation.bump_model import (
    BumpModel,
    GroupArrays,
    GroupShape,
    simulate_group,
    wheel_road,
)
from sysid.estimation.lane_laws import lane_laws
from sysid.threads import side_by_side
from sysid.vehicle_model.contact import EffectiveRoad
from sysid.vehicle_model.engine import WheelRoad
from sysid.vehicle_model.engines.protocol import Linearisation, Unknowns

#: One unit of the scaled local unknowns: relative speed change, and shift along the road [m].
SPEED_UNIT = 0.01
SHIFT_UNIT_M = 0.02


@dataclass(frozen=True)
class RunMotion:
    """Speed [m/s] and start [s] of every run, in the order of the campaign's bump runs; NaN for runs left out."""

    speed_m_s: np.ndarray
    start_s: np.ndarray


@dataclass(frozen=True)
class SpeedPrior:
    """Nominal speed [m/s] and relative standard deviation about it, per run in the order of the campaign."""

    speed_m_s: np.ndarray
    relative_sd: np.ndarray


def speed_prior(runs: Sequence[BumpRun]) -> SpeedPrior:
    """Prior of the runs' speeds as the campaign declares them."""
    return SpeedPrior(np.array([r.nominal_speed_m_s for r in runs]), np.array([r.speed_sd for r in runs]))


@dataclass(frozen=True)
class Weights:
    """Residual scale [SI] and tempering factor per group, each (R, C); `reading` weights (T, R, C), None for all 1."""

    noise_sd: tuple[np.ndarray, ...]
    tempering: tuple[np.ndarray, ...]
    reading: tuple[np.ndarray, ...] | None = None

    def on(self, arrays: Sequence[GroupArrays]) -> tuple[GroupArrays, ...]:
        """The arrays of all groups with the weights of single readings in them."""
        if self.reading is None:
            return tuple(arrays)
        pairs = zip(arrays, self.reading, strict=True)
        return tuple(a._replace(measured=a.measured * np.sqrt(w)) for a, w in pairs)


def linearise_group(
    arrays: GroupArrays,
    road: EffectiveRoad,
    noise_sd: jax.Array,
    tempering: jax.Array,
    log_parameters: jax.Array,
    speed: jax.Array,
    start: jax.Array,
    *,
    shape: GroupShape,
) -> Linearisation:
    """Residuals of one group and their derivatives at x (p,), speed and start (R,).

    The last two columns belong to each run's own speed and start in scaled units.
    """
    inputs = wheel_road(arrays, road, speed[:, None], start[:, None], shape)
    return _linearise(arrays, inputs, noise_sd, tempering, log_parameters, speed, shape=shape)


@partial(jax.jit, static_argnames=("shape",))
def _linearise(
    arrays: GroupArrays,
    road: WheelRoad,
    noise_sd: jax.Array,
    tempering: jax.Array,
    log_parameters: jax.Array,
    speed: jax.Array,
    *,
    shape: GroupShape,
) -> Linearisation:
    count = log_parameters.shape[0]
    columns = jnp.eye(count + 2)
    own = jnp.broadcast_to(columns[count:, None, :], (2, speed.shape[0], count + 2))
    unknowns = Unknowns(
        log_parameters,
        columns[:count],
        # Local unknowns are displacements along the road.
        speed=own[0] * SPEED_UNIT * speed[:, None],
        start_s=own[1] * SHIFT_UNIT_M / speed[:, None],
    )
    return road.engine.linearise(
        arrays.matrices,
        partial(lane_laws, arrays.laws),
        unknowns,
        road,
        shape.timing,
        shape.sensors,
        shape.recursion,
        arrays.readings(noise_sd, tempering),
    )


def linearise(
    model: BumpModel, weights: Weights, log_parameters: np.ndarray, motion: RunMotion
) -> tuple[Linearisation, ...]:
    """Linearisation of every group at global log parameters (p,) and run motions."""

    every = weights.on(model.arrays)

    def one(position: int) -> Linearisation:
        runs = list(model.groups[position].runs)
        return jax.block_until_ready(
            linearise_group(
                every[position],
                model.roads[position],
                weights.noise_sd[position],
                weights.tempering[position],
                jnp.asarray(log_parameters),
                jnp.asarray(motion.speed_m_s[runs]),
                jnp.asarray(motion.start_s[runs]),
                shape=model.shapes[position],
            )
        )

    # A compiled loop keeps one core busy; threads let the groups share the cores.
    return side_by_side(one, range(len(model.groups)))


@partial(jax.jit, static_argnames=("shape",))
def _group_signals(arrays, road: WheelRoad, log_parameters, *, shape: GroupShape) -> jax.Array:
    return simulate_group(arrays, shape, log_parameters[:, None], road)[..., 0]


def simulate_runs(model: BumpModel, log_parameters: np.ndarray, motion: RunMotion) -> tuple[np.ndarray, ...]:
    """Sensor signals (T, R, C) of every group in SI at log parameters (p,)."""

    def one(position: int) -> np.ndarray:
        runs = list(model.groups[position].runs)
        arrays, shape = model.arrays[position], model.shapes[position]
        speed, start = jnp.asarray(motion.speed_m_s[runs]), jnp.asarray(motion.start_s[runs])
        road = wheel_road(arrays, model.roads[position], speed[:, None], start[:, None], shape)
        signals = _group_signals(arrays, road, jnp.asarray(log_parameters), shape=shape)
        return np.asarray(jax.block_until_ready(signals))

    return side_by_side(one, range(len(model.groups)))


class Compressed(NamedTuple):
    """Residual vector (m,) and Jacobian (m, p + 2 runs) with the squares and products of the full problem.

    The residuals of each run are replaced by a square factor F with F'F = [J r]'[J r]: it carries the same r'r, J'r and
    J'J, so Gauss-Newton and Levenberg-Marquardt steps are unchanged.  Run-local columns follow the global ones:
    speed and start of the first run of the first group, and so on.
    """

    residual: np.ndarray
    jacobian: np.ndarray


def run_order(model: BumpModel) -> list[int]:
    """Campaign indices of the runs in the order of their local columns."""
    return [run for group in model.groups for run in group.runs]


def run_blocks(linearisation: Linearisation) -> list[np.ndarray]:
    """Per run the matrix [J r] (rows, p + 3) of all its residuals, sensor gains included."""
    residual, jacobian = np.asarray(linearisation.residual), np.asarray(linearisation.residual_jacobian)
    gain, gain_jacobian = np.asarray(linearisation.gain_residual), np.asarray(linearisation.gain_jacobian)
    blocks = []
    for r in range(residual.shape[1]):
        columns = np.concatenate([jacobian[:, r].reshape(-1, jacobian.shape[-1]), gain_jacobian[r]])
        values = np.concatenate([residual[:, r].ravel(), gain[r]])
        blocks.append(np.concatenate([columns, values[:, None]], axis=1))
    return blocks


def square_factor(block: np.ndarray) -> np.ndarray:
    """F (n, n) with F'F = B'B for a tall block B (m, n), columns of zeros allowed.

    From the eigenvalues of the normal matrix with columns scaled to unit length: for thousands of rows and tens of
    columns a small part of the time of an orthogonal factorisation, and exact enough for scaled condition numbers far
    below 1e8.
    """
    normal = block.T @ block
    length = np.sqrt(np.diag(normal))
    scale = np.where(length > 0.0, length, 1.0)
    values, vectors = np.linalg.eigh(normal / scale[:, None] / scale)
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * scale)


def compress(
    model: BumpModel,
    linearisations: Sequence[Linearisation],
    log_parameters: np.ndarray,
    motion: RunMotion,
    nominal: SpeedPrior,
) -> Compressed:
    """Assemble the compressed problem: data, sensor gains, global priors and the priors of the run speeds."""
    count = log_parameters.shape[0]
    order = run_order(model)
    width = count + 2 * len(order)
    blocks = [block for lin in linearisations for block in run_blocks(lin)]
    residuals, jacobians = [], []
    for position, block in enumerate(blocks):
        factor = square_factor(block)
        wide = np.zeros((factor.shape[0], width))
        wide[:, :count] = factor[:, :count]
        wide[:, count + 2 * position : count + 2 * position + 2] = factor[:, count : count + 2]
        residuals.append(factor[:, -1])
        jacobians.append(wide)
    rows, targets = model.parameters.prior_rows()
    residuals.append(rows @ log_parameters - targets)
    jacobians.append(np.concatenate([rows, np.zeros((len(targets), width - count))], axis=1))
    speed, middle, sd = motion.speed_m_s[order], nominal.speed_m_s[order], nominal.relative_sd[order]
    residuals.append((speed / middle - 1.0) / sd)
    wide = np.zeros((len(order), width))
    wide[np.arange(len(order)), count + 2 * np.arange(len(order))] = SPEED_UNIT * speed / middle / sd
    jacobians.append(wide)
    return Compressed(np.concatenate(residuals), np.concatenate(jacobians))
