"""The truck of the hand-written equations, simulated by the package."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from hand_written_truck import (
    ALPHA,
    DURATION_S,
    HEIGHTS_M,
    OUTPUT_S,
    POINTS_M,
    SPEED_M_S,
    START_S,
    TIRE_DAMPING,
    TIRE_STIFFNESS,
    X,
    road,
)
from rigid_truck import DAMPING, EMPTY, EXPONENT, FILTER, STIFFNESS, VEHICLE

from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.vehicle_model.assembly import assemble
from sysid.vehicle_model.contact import effective_road, road_input, tire_law
from sysid.vehicle_model.filters import discretise
from sysid.vehicle_model.simulation import (
    Motion,
    SensorLayout,
    simulate_histories,
    simulate_sensors,
    stage_times,
)
from sysid.vehicle_model.stacked_matrices import stack_matrices
from sysid.vehicle_model.suspension import SuspensionLaw


def per_axle(values: np.ndarray) -> jax.Array:
    """One value per axle as an array (2, 3, 1) of both passes."""
    return jnp.asarray(np.tile(values[:, None], (2, 1, 1)))


def simulated_truck(
    step_s: float,
    *,
    law: SuspensionLaw | None = None,
    filtered: bool = False,
    speed_m_s: float = SPEED_M_S,
    acceleration_m_s2: float = 0.0,
    vehicle: Vehicle = VEHICLE,
    load: LoadCase = EMPTY,
    heights_m: tuple[float, float] = HEIGHTS_M,
    rate_sensors: tuple[tuple[int, float | None], ...] = (),
):
    """The package's own simulation of both bumps with steps of `step_s`; linear suspensions unless `law` is given."""
    suspension = law or SuspensionLaw(per_axle(STIFFNESS), per_axle(DAMPING))
    shown = {"filtered": filtered, "rate_sensors": rate_sensors}
    model = truck_model(step_s, vehicle=vehicle, load=load, heights_m=heights_m, **shown)
    return model(suspension, speed_m_s, acceleration_m_s2)


def truck_model(
    step_s: float,
    *,
    filtered: bool = False,
    every_s: float = OUTPUT_S,
    duration_s: float = DURATION_S,
    vehicle: Vehicle = VEHICLE,
    load: LoadCase = EMPTY,
    heights_m: tuple[float, float] = HEIGHTS_M,
    rate_sensors: tuple[tuple[int, float | None], ...] = (),
):
    """The simulation as a function of suspension law, speed [m/s] and acceleration [m/s2]."""
    matrices = assemble(vehicle, load)
    stacked = stack_matrices([matrices] * 2, [(0, x) for x in POINTS_M], rate_sensors=rate_sensors)
    station = np.arange(-250, 300) * 0.01
    rises = np.tile(road(station), (2, 3, 1)) * np.array(heights_m)[:, None, None]
    shape = np.tile(road(station), (2, 3, 1))
    stretch = ALPHA * np.stack([shape, 2.0 * shape, -5.0 * shape, 0.0 * shape])
    slopes = np.tile(road(station, 1), (2, 3, 1)) * np.array(heights_m)[:, None, None]
    drag = np.stack([-slopes, 3.0 * slopes, 0.0 * slopes])
    table = effective_road(station, rises, stretch, drag)
    samples, substeps = round(duration_s / every_s), round(every_s / step_s)

    @jax.jit
    def run(suspension, speed, acceleration=0.0):
        tire = tire_law(
            per_axle(TIRE_STIFFNESS), per_axle(TIRE_DAMPING), EXPONENT, stacked.static_load, stacked.static_load
        )
        motion = Motion(*(jnp.full((2, 1), v) for v in (speed, START_S, acceleration)))
        tau = stage_times(samples, every_s, substeps)[:, None, None, None] - START_S
        way = tau * (motion.speed[:, None] + 0.5 * tau * motion.acceleration[:, None])
        inputs = road_input(table, way - X[:, None])
        laws = (suspension, tire, motion, inputs)
        options = {"interval_s": every_s, "substeps": substeps}
        if filtered:
            layout = SensorLayout((0, 1, 2), (0, 1, 2))
            return simulate_sensors(stacked, *laws, layout, discretise(FILTER, step_s), **options)
        return simulate_histories(stacked, *laws, **options)

    return run
