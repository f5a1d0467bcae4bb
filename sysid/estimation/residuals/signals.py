"""What the sensors of all runs show of a simulation."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from sysid.estimation.parameters.lane_laws import lane_laws
from sysid.estimation.residuals.bump_model import BumpModel, GroupArrays, GroupShape
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.vehicle_model import engine
from sysid.vehicle_model.contact import EffectiveRoad, RoadInput
from sysid.vehicle_model.engine import WheelRoad
from sysid.vehicle_model.simulation import Motion


def group_road(
    road: EffectiveRoad, axle_x: jax.Array, speed: jax.Array, start_s: jax.Array, shape: GroupShape
) -> RoadInput:
    """Road input of a group at every half step for speeds [m/s] and starts [s] (R, S), for the JAX engine."""
    return engine.looked_up(road, axle_x, speed, start_s, shape.timing)


def wheel_road(
    arrays: GroupArrays, road: EffectiveRoad, speed: jax.Array, start_s: jax.Array, shape: GroupShape
) -> WheelRoad:
    """The road of a group at speeds [m/s] and starts [s] (R, 1), for the engine of this process."""
    return engine.wheel_road(arrays.matrices, road, arrays.axle_x, speed, start_s, shape.timing)


def simulate_group(
    arrays: GroupArrays, shape: GroupShape, log_parameters: jax.Array, motion: Motion, road: WheelRoad
) -> jax.Array:
    """Filtered sensor signals (T, R, C, S) of one group for log parameters (p, S)."""
    suspension, tire = lane_laws(arrays.laws, log_parameters)
    return engine.simulate_sensors(
        arrays.matrices, suspension, tire, motion, road, shape.sensors, shape.recursion, shape.timing
    )


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
