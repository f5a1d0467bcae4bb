"""The least-squares objective: all residuals of a campaign and their exact Jacobian.

The unknowns are the global log parameters x (p,), and per run a relative speed change and a start shift in scaled
units.  A run's speed and start touch that run only, so p + 2 forward-mode tangents give the Jacobian of all runs.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
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
    group_residuals,
    simulate_group,
    wheel_road,
)
from sysid.estimation.native_residuals import native_linearisation
from sysid.vehicle_model.contact import EffectiveRoad, RoadInput
from sysid.vehicle_model.engine import WheelRoad
from sysid.vehicle_model.simulation import Motion

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


class Linearisation(NamedTuple):
    """Residuals and Jacobian of one group.

    `residual` (T, R, C) and `gain_residual` (R, C) with derivatives (..., p + 2): the last two columns belong to each
    run's own speed and start in scaled units; `simulated` (T, R, C) sensor signals in SI.
    """

    residual: jax.Array
    residual_jacobian: jax.Array
    gain_residual: jax.Array
    gain_jacobian: jax.Array
    simulated: jax.Array


def _moved(speed: jax.Array, start: jax.Array, local: jax.Array) -> Motion:
    """Motion (R, S) with local unknowns (2, R, S) entering as displacements along the road."""
    return Motion(
        speed=speed,
        start_s=start,
        speed_change=local[0] * SPEED_UNIT * speed,
        start_change=local[1] * SHIFT_UNIT_M / speed,
    )


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
    """Residuals of one group and their forward-mode derivatives at x (p,), speed and start (R,)."""
    inputs = wheel_road(arrays, road, speed[:, None], start[:, None], shape)
    return _linearise(arrays, inputs, noise_sd, tempering, log_parameters, speed, start, shape=shape)


@partial(jax.jit, static_argnames=("shape",))
def _linearise(
    arrays: GroupArrays,
    road: WheelRoad,
    noise_sd: jax.Array,
    tempering: jax.Array,
    log_parameters: jax.Array,
    speed: jax.Array,
    start: jax.Array,
    *,
    shape: GroupShape,
) -> Linearisation:
    count = log_parameters.shape[0]
    columns = count + 2

    def residuals(x: jax.Array, local: jax.Array):
        motion = _moved(speed[:, None], start[:, None], local)
        simulated = simulate_group(arrays, shape, x, motion, road)
        return (*group_residuals(arrays, noise_sd, tempering, simulated), simulated)

    x = jnp.broadcast_to(log_parameters[:, None], (count, columns))
    local = jnp.zeros((2, speed.shape[0], columns))
    x_tangent = jnp.eye(count, columns)
    local_tangent = jnp.broadcast_to(jnp.eye(columns)[count:, None, :], local.shape)
    if not isinstance(road, RoadInput):
        moved = partial(_moved, speed[:, None], start[:, None])
        motion_tangent = jax.jvp(lambda u: moved(u)[2:], (local,), (local_tangent,))[1]
        weights = (noise_sd, tempering)
        return Linearisation(*native_linearisation(arrays, shape, road, weights, x, x_tangent, motion_tangent))
    primal, tangent = jax.jvp(residuals, (x, local), (x_tangent, local_tangent))
    return Linearisation(primal[0][..., 0], tangent[0], primal[1][..., 0], tangent[1], primal[2][..., 0])


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
    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        return tuple(pool.map(one, range(len(model.groups))))


@partial(jax.jit, static_argnames=("shape",))
def _group_signals(arrays, road: WheelRoad, log_parameters, speed, start, *, shape: GroupShape) -> jax.Array:
    motion = Motion(speed[:, None], start[:, None])
    return simulate_group(arrays, shape, log_parameters[:, None], motion, road)[..., 0]


def simulate_runs(model: BumpModel, log_parameters: np.ndarray, motion: RunMotion) -> tuple[np.ndarray, ...]:
    """Sensor signals (T, R, C) of every group in SI at log parameters (p,)."""

    def one(position: int) -> np.ndarray:
        runs = list(model.groups[position].runs)
        arrays, shape = model.arrays[position], model.shapes[position]
        speed, start = jnp.asarray(motion.speed_m_s[runs]), jnp.asarray(motion.start_s[runs])
        road = wheel_road(arrays, model.roads[position], speed[:, None], start[:, None], shape)
        signals = _group_signals(arrays, road, jnp.asarray(log_parameters), speed, start, shape=shape)
        return np.asarray(jax.block_until_ready(signals))

    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        return tuple(pool.map(one, range(len(model.groups))))


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
