"""All residuals of a campaign and their exact Jacobian.

The unknowns are the global log parameters x (p,), and per run a relative speed change and a start shift in scaled
units.  A run's speed and start touch that run only, so p + 2 forward-mode tangents give the Jacobian of all runs.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from sysid.estimation.residuals.bump_model import BumpModel, GroupArrays, GroupShape
from sysid.estimation.residuals.native_residuals import native_linearisation
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import SHIFT_UNIT_M, SPEED_UNIT, RunMotion
from sysid.estimation.residuals.sensor_residuals import group_residuals
from sysid.estimation.residuals.signals import simulate_group, wheel_road
from sysid.vehicle_model.contact import EffectiveRoad, RoadInput
from sysid.vehicle_model.engine import WheelRoad
from sysid.vehicle_model.simulation import Motion


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
