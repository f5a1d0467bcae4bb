"""Which engine integrates the vehicle: C++ compiled for this machine where there is a compiler, else JAX.

Both have one contract, the same inputs and the same outputs to rounding.  ``SYSID_ENGINE`` chooses: `auto` (the
default) takes the native engine where it can be built, `native` insists on it, `jax` does without.  Only the JAX engine
can be differentiated from outside and takes a motion per parameter set.
"""

from __future__ import annotations

import os
from functools import cache, partial
from typing import Literal, get_args

import jax
import numpy as np

from sysid.errors import SysidError
from sysid.vehicle_model import simulation
from sysid.vehicle_model.contact import EffectiveRoad, RoadInput, TireLaw, road_input
from sysid.vehicle_model.filters import FilterRecursion
from sysid.vehicle_model.lane_matrices import LaneMatrices
from sysid.vehicle_model.native import kernel
from sysid.vehicle_model.native.build import BuildError
from sysid.vehicle_model.native.kernel import Course, LocalColumns, Readings, Timing
from sysid.vehicle_model.simulation import Histories, Motion, SensorLayout, stage_times
from sysid.vehicle_model.suspension import SuspensionLaw

Choice = Literal["auto", "native", "jax"]
#: What the time loop gets of the road: looked up beforehand (JAX), or where to look it up (native).
WheelRoad = RoadInput | Course

__all__ = ["LocalColumns", "Readings", "Timing", "WheelRoad", "engine_name", "wheel_road"]


def engine_name() -> Literal["native", "jax"]:
    """The engine of this process.

    Raises
    ------
    SysidError
        If SYSID_ENGINE names no engine, or insists on the native one where it cannot be had.
    """
    choice = os.environ.get("SYSID_ENGINE", "auto")
    if choice not in get_args(Choice):
        raise SysidError(f"SYSID_ENGINE is '{choice}'; set it to auto, native or jax.")
    if choice == "jax":
        return "jax"
    problem = _problem()
    if problem is None:
        return "native"
    if choice == "native":
        raise SysidError(f"The native engine cannot be used: {problem}; set SYSID_ENGINE=auto to do without it.")
    return "jax"


@cache
def _problem() -> str | None:
    """Why the native engine cannot be used here, None if it can."""
    if jax.default_backend() != "cpu":
        return f"JAX computes on {jax.default_backend()} here"
    try:
        kernel.prepare()
    except BuildError as error:
        return str(error)
    return None


def wheel_road(
    lanes: LaneMatrices,
    road: EffectiveRoad,
    axle_x: np.ndarray,
    speed: jax.Array,
    start_s: jax.Array,
    timing: Timing,
) -> WheelRoad:
    """The road of R runs at speeds [m/s] and starts [s] (R, 1), as the engine of this process wants it."""
    if engine_name() == "native" and kernel.supports(lanes):
        return Course(road, axle_x, speed, start_s)
    return _looked_up(road, axle_x, speed, start_s, timing=timing)


@partial(jax.jit, static_argnames=("timing",))
def _looked_up(road: EffectiveRoad, axle_x, speed, start_s, *, timing: Timing) -> RoadInput:
    return looked_up(road, axle_x, speed, start_s, timing)


def looked_up(
    road: EffectiveRoad, axle_x: jax.Array, speed: jax.Array, start_s: jax.Array, timing: Timing
) -> RoadInput:
    """Road input at every half step for speeds [m/s] and starts [s] (R, S)."""
    times = stage_times(timing.samples, timing.interval_s, timing.substeps)[:, None, None, None]
    return road_input(road, speed[:, None] * (times - start_s[:, None]) - axle_x)


def simulate_sensors(
    lanes: LaneMatrices,
    suspension: SuspensionLaw,
    tire: TireLaw,
    motion: Motion,
    road: WheelRoad,
    layout: SensorLayout,
    recursion: FilterRecursion | None,
    timing: Timing,
) -> jax.Array:
    """Filtered sensor signals (T, R, C, S), see :func:`sysid.vehicle_model.simulation.simulate_sensors`."""
    if isinstance(road, Course):
        return kernel.sensors(lanes, kernel.laws(suspension, tire), road, timing, layout, recursion)
    return simulation.simulate_sensors(
        lanes,
        suspension,
        tire,
        motion,
        road,
        layout,
        recursion,
        interval_s=timing.interval_s,
        substeps=timing.substeps,
    )


def simulate_histories(
    lanes: LaneMatrices, suspension: SuspensionLaw, tire: TireLaw, motion: Motion, road: WheelRoad, timing: Timing
) -> Histories:
    """Unfiltered histories, see :func:`sysid.vehicle_model.simulation.simulate_histories`."""
    if isinstance(road, Course):
        return kernel.histories(lanes, kernel.laws(suspension, tire), road, timing)
    return simulation.simulate_histories(
        lanes, suspension, tire, motion, road, interval_s=timing.interval_s, substeps=timing.substeps
    )
