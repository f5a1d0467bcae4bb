"""Sensor signals of all runs for a simulation."""

from __future__ import annotations

from functools import partial

import jax
import numpy as np

from sysid.arrays import Parameters
from sysid.estimation.parameters.axle_laws import axle_laws
from sysid.estimation.residuals.bump_model import BumpModel, GroupArrays, GroupShape
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.threads import side_by_side
from sysid.vehicle_model import engine
from sysid.vehicle_model.contact import EffectiveRoad
from sysid.vehicle_model.device_arrays import ChannelHistories, ParametersBySets
from sysid.vehicle_model.engine import WheelRoad


def wheel_road(arrays: GroupArrays, road: EffectiveRoad, motion: RunMotion, shape: GroupShape) -> WheelRoad:
    """The road of a group whose runs move as `motion` (R,) says, for the engine of this process."""
    return engine.wheel_road(arrays.matrices, road, arrays.axle_x, motion.along_road(arrays.axle_x), shape.timing)


def simulate_group(
    arrays: GroupArrays, shape: GroupShape, log_parameters: ParametersBySets, road: WheelRoad
) -> ChannelHistories:
    """Filtered sensor signals (T, R, C, S) of one group for log parameters (p, S)."""
    suspension, tire = axle_laws(arrays.laws, log_parameters)
    return road.engine.sensors(arrays.matrices, suspension, tire, road, shape.timing, shape.sensors, shape.recursion)


@partial(jax.jit, static_argnames=("shape",))
def _group_signals(arrays: GroupArrays, road: WheelRoad, log_parameters: jax.Array, *, shape: GroupShape) -> jax.Array:
    return simulate_group(arrays, shape, log_parameters[:, None], road)[..., 0]


def simulate_runs(model: BumpModel, log_parameters: Parameters, motion: RunMotion) -> tuple[np.ndarray, ...]:
    """Sensor signals (T, R, C) of every group in SI at log parameters (p,)."""

    def one(position: int) -> np.ndarray:
        runs = list(model.groups[position].runs)
        arrays, shape = model.arrays[position], model.shapes[position]
        road = wheel_road(arrays, model.roads[position], motion.of(runs), shape)
        signals = _group_signals(arrays, road, log_parameters, shape=shape)
        return np.asarray(jax.block_until_ready(signals))

    return side_by_side(one, range(len(model.groups)))
