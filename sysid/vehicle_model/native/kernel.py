"""Entry points of the native engine: each takes what its JAX counterpart takes and returns the same to rounding.

The order of the buffers is that of the enumerations in ``engine.cpp``.
"""

from __future__ import annotations

import ctypes
import threading
from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from sysid.vehicle_model.contact import CELL_POLYNOMIAL, EffectiveRoad, TireLaw
from sysid.vehicle_model.filters import FilterRecursion
from sysid.vehicle_model.native.build import BuildError, library
from sysid.vehicle_model.simulation import Histories, LaneMatrices, SensorLayout
from sysid.vehicle_model.suspension import SuspensionLaw

_ENTRIES = ("sensors", "histories", "misfits", "linearise")
#: Numbers of body coordinates that the kernel is compiled for, and the most axles it takes.
COORDINATES = range(3, 7)
MAX_AXLES = 24


class Course(NamedTuple):
    """One group of R runs as the kernel takes it.

    `road` the effective roads, looked up inside the time loop; `axle_x` (na, 1) [m]; `speed` [m/s] and `start_s` [s]
    (R, 1).
    """

    road: EffectiveRoad
    axle_x: jax.Array
    speed: jax.Array
    start_s: jax.Array


class Timing(NamedTuple):
    """Samples of a run, their interval [s], and integration steps per sample."""

    samples: int
    interval_s: float
    substeps: int


class Readings(NamedTuple):
    """Data and weights of a group.

    `value`, `measured`, `censored` (T, R, C), `noise_sd`, `tempering` (R, C), `gain_sd` (C,).
    """

    value: jax.Array
    measured: jax.Array
    censored: jax.Array
    noise_sd: jax.Array
    tempering: jax.Array
    gain_sd: jax.Array


class LocalColumns(NamedTuple):
    """What marginalises speed and start of every run.

    `residual` (T, R, C, 2) and `gain` (R, C, 2) their columns, `offset` (R, 2), `factor` (R, 2, 2).
    """

    residual: jax.Array
    gain: jax.Array
    offset: jax.Array
    factor: jax.Array


_lock = threading.Lock()


@cache
def _registered() -> str:
    path = library()
    try:
        loaded = ctypes.CDLL(str(path))
    except OSError as error:
        raise BuildError(f"the compiled engine cannot be loaded ({error})") from error
    prefix = f"sysid_{path.stem.replace('-', '_')}"
    for entry in _ENTRIES:
        jax.ffi.register_ffi_target(
            f"{prefix}_{entry}", jax.ffi.pycapsule(getattr(loaded, f"sysid_{entry}")), platform="cpu"
        )
    return prefix


def prepare() -> None:
    """Build and load the engine if that has not been done.

    Raises
    ------
    BuildError
        If there is none to be had on this machine.
    """
    with _lock:
        _registered()


def supports(lanes: LaneMatrices) -> bool:
    """Whether the kernel takes vehicles of this size, without axle groups."""
    return lanes.beams is None and lanes.body_rows.shape[2] in COORDINATES and lanes.static_load.shape[1] <= MAX_AXLES


def law_rows(suspension: SuspensionLaw, tire: TireLaw) -> jax.Array:
    """Coefficients of all laws, (6, R, na, S): k, c, u_0, u_ref, n, c_t."""
    shape = suspension.stiffness.shape
    rows = (
        suspension.stiffness,
        suspension.damping,
        tire.static_deflection,
        tire.reference_deflection,
        tire.exponent,
        tire.damping,
    )
    return jnp.stack([jnp.broadcast_to(jnp.asarray(r, jnp.float64), shape) for r in rows])


def sensors(
    lanes: LaneMatrices,
    laws: jax.Array,
    tire: TireLaw,
    course: Course,
    timing: Timing,
    layout: SensorLayout,
    recursion: FilterRecursion | None,
) -> jax.Array:
    """Filtered signals (T, R, C, S); twin of :func:`sysid.vehicle_model.simulation.simulate_sensors`."""
    channels = len(layout.deflection_axles) + len(layout.acceleration_axles) + lanes.body_rows.shape[1]
    shape = (timing.samples, laws.shape[1], channels, laws.shape[3])
    buffers = _buffers(lanes, laws, tire, course, recursion)
    return _call("sensors", [shape], buffers, tire, timing, layout)[0]


def histories(lanes: LaneMatrices, laws: jax.Array, tire: TireLaw, course: Course, timing: Timing) -> Histories:
    """Unfiltered histories; twin of :func:`sysid.vehicle_model.simulation.simulate_histories`."""
    _, runs, axles, sets = laws.shape
    width = dict.fromkeys(Histories._fields, axles)
    width |= {"body_acceleration": lanes.body_rows.shape[1], "body": lanes.body_rows.shape[2]}
    shapes = [(timing.samples, runs, width[name], sets) for name in Histories._fields]
    buffers = _buffers(lanes, laws, tire, course, None)
    return Histories(*_call("histories", shapes, buffers, tire, timing, SensorLayout((), ())))


def misfits(
    lanes: LaneMatrices,
    laws: jax.Array,
    tire: TireLaw,
    course: Course,
    timing: Timing,
    layout: SensorLayout,
    recursion: FilterRecursion | None,
    readings: Readings,
    local: LocalColumns,
) -> jax.Array:
    """r'r - b' N^-1 b of every run and set (R, S), as in :mod:`sysid.posterior.log_density`."""
    buffers = [*_buffers(lanes, laws, tire, course, recursion), *readings, *local]
    return _call("misfits", [(laws.shape[1], laws.shape[3])], buffers, tire, timing, layout)[0]


def linearise(
    lanes: LaneMatrices,
    laws: jax.Array,
    law_tangents: jax.Array,
    motion_tangents: jax.Array,
    tire: TireLaw,
    course: Course,
    timing: Timing,
    layout: SensorLayout,
    recursion: FilterRecursion | None,
    readings: Readings,
) -> list[jax.Array]:
    """Residuals and derivatives of one parameter set with respect to P unknowns.

    Parameters
    ----------
    laws, law_tangents : (6, R, na, 1) and its derivatives (6, R, na, P).
    motion_tangents : (2, R, P) derivatives of speed [m/s] and start [s].

    Returns
    -------
    residuals (T, R, C) and derivatives (T, R, C, P), gain residuals (R, C) and derivatives (R, C, P), and simulated
    signals (T, R, C).
    """
    samples, runs, channels = readings.value.shape
    unknowns = law_tangents.shape[-1]
    signal, gain = (samples, runs, channels), (runs, channels)
    buffers = [*_buffers(lanes, laws, tire, course, recursion), law_tangents, motion_tangents, *readings]
    shapes = [signal, (*signal, unknowns), gain, (*gain, unknowns), signal]
    return _call("linearise", shapes, buffers, tire, timing, layout)


def _buffers(lanes, laws, tire, course: Course, recursion: FilterRecursion | None) -> list[jax.Array]:
    road = course.road
    runs = laws.shape[1]
    poles = np.zeros((0, 10))
    if recursion is not None:
        parts = (recursion.decay, recursion.start, recursion.middle, recursion.weight, recursion.feed)
        poles = np.stack([f(part) for part in parts for f in (np.real, np.imag)], axis=1)
    nothing = np.zeros((0,))
    return [
        lanes.position,
        lanes.rate,
        lanes.acceleration,
        lanes.inverse_unsprung,
        lanes.static_load,
        lanes.body_rows,
        road.rise,
        nothing if road.stretch is None else road.stretch,
        nothing if road.drag is None else road.drag,
        jnp.stack([jnp.asarray(road.first_station_m), jnp.asarray(road.step_m)]),
        CELL_POLYNOMIAL,
        course.axle_x,
        jnp.stack([jnp.broadcast_to(x, (runs, 1))[:, 0] for x in (course.speed, course.start_s)]),
        jnp.broadcast_to(tire.reference_load, (runs, laws.shape[2], 1)),
        poles,
        laws,
    ]


def _call(entry: str, shapes, buffers, tire: TireLaw, timing: Timing, layout: SensorLayout) -> list[jax.Array]:
    results = [jax.ShapeDtypeStruct(shape, jnp.float64) for shape in shapes]
    call = jax.ffi.ffi_call(f"{_registered()}_{entry}", results)
    found = call(
        *(jnp.asarray(b, jnp.float64) for b in buffers),
        samples=np.int64(timing.samples),
        substeps=np.int64(timing.substeps),
        interval=np.float64(timing.interval_s),
        growth=np.float64(tire.growth),
        deflection_axles=np.array(layout.deflection_axles, np.int64),
        acceleration_axles=np.array(layout.acceleration_axles, np.int64),
    )
    return list(found)
