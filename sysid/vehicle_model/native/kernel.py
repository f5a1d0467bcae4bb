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
from sysid.vehicle_model.lane_matrices import LaneMatrices
from sysid.vehicle_model.native.build import BuildError, library
from sysid.vehicle_model.simulation import Histories, SensorLayout
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


class Laws(NamedTuple):
    """Suspension and tire laws of R runs.

    `rows` (L, R, na, S) coefficients: k, c, u_0, u_ref, n, c_t, then those of the elements that some axle has, then
    place and slope of every ramp; `sides` (J, R, na, S) of the ramps; `reference_load` (R, na, 1) [N]; `growth` of
    the tires' damping; `elements` bits of :mod:`engine.cpp`; `ramps` numbers of ramps of springs and dampers.
    """

    rows: jax.Array
    sides: jax.Array
    reference_load: jax.Array
    growth: float
    elements: int
    ramps: tuple[int, int]


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
    """Whether the kernel takes vehicles of this size."""
    return lanes.body_rows.shape[2] in COORDINATES and lanes.static_load.shape[1] <= MAX_AXLES


def laws(suspension: SuspensionLaw, tire: TireLaw) -> Laws:
    """Laws of all lanes as the kernel takes them; elements that no axle has are left out."""
    law = suspension
    shape = law.stiffness.shape

    def rows(*values: jax.Array) -> list[jax.Array]:
        return [jnp.broadcast_to(jnp.asarray(v, jnp.float64), shape) for v in values]

    found = rows(law.stiffness, law.damping)
    found += rows(tire.static_deflection, tire.reference_deflection, tire.exponent, tire.damping)
    present = []
    for element in ((law.softening,), (law.saturation, law.tail), (law.asymmetry,), (law.friction, law.slip)):
        has = all(value is not None for value in element)
        present.append(has)
        found += rows(*element) if has else []
    sides, counts = [], []
    for ramps in (law.ramps, law.rate_ramps):
        corners = [] if ramps is None else list(zip(*ramps, strict=True))
        counts.append(len(corners))
        for at, slope, side in corners:
            found += rows(at, slope)
            sides += rows(side)
    elements = sum(1 << bit for bit, has in enumerate(present) if has)
    stacked = jnp.stack(sides) if sides else jnp.zeros((0, *shape))
    return Laws(jnp.stack(found), stacked, tire.reference_load, float(tire.growth), elements, (counts[0], counts[1]))


def sensors(
    lanes: LaneMatrices,
    laws: Laws,
    course: Course,
    timing: Timing,
    layout: SensorLayout,
    recursion: FilterRecursion | None,
) -> jax.Array:
    """Filtered signals (T, R, C, S); twin of :func:`sysid.vehicle_model.simulation.simulate_sensors`."""
    channels = len(layout.deflection_axles) + len(layout.acceleration_axles) + lanes.body_rows.shape[1]
    shape = (timing.samples, laws.rows.shape[1], channels, laws.rows.shape[3])
    buffers = _buffers(lanes, laws, course, recursion)
    return _call("sensors", [shape], buffers, laws, timing, layout)[0]


def histories(lanes: LaneMatrices, laws: Laws, course: Course, timing: Timing) -> Histories:
    """Unfiltered histories; twin of :func:`sysid.vehicle_model.simulation.simulate_histories`."""
    _, runs, axles, sets = laws.rows.shape
    width = dict.fromkeys(Histories._fields, axles)
    width |= {"body_acceleration": lanes.body_rows.shape[1], "body": lanes.body_rows.shape[2]}
    shapes = [(timing.samples, runs, width[name], sets) for name in Histories._fields]
    buffers = _buffers(lanes, laws, course, None)
    every = tuple(range(axles))
    return Histories(*_call("histories", shapes, buffers, laws, timing, SensorLayout(every, every)))


def misfits(
    lanes: LaneMatrices,
    laws: Laws,
    course: Course,
    timing: Timing,
    layout: SensorLayout,
    recursion: FilterRecursion | None,
    readings: Readings,
    local: LocalColumns,
) -> jax.Array:
    """r'r - b' N^-1 b of every run and set (R, S), as in :mod:`sysid.posterior.log_density`."""
    buffers = [*_buffers(lanes, laws, course, recursion), *readings, *local]
    return _call("misfits", [(laws.rows.shape[1], laws.rows.shape[3])], buffers, laws, timing, layout)[0]


def linearise(
    lanes: LaneMatrices,
    laws: Laws,
    law_tangents: jax.Array,
    motion_tangents: jax.Array,
    course: Course,
    timing: Timing,
    layout: SensorLayout,
    recursion: FilterRecursion | None,
    readings: Readings,
) -> list[jax.Array]:
    """Residuals and derivatives of one parameter set with respect to P unknowns.

    Parameters
    ----------
    laws, law_tangents : laws of one set, and derivatives (L, R, na, P) of their rows.
    motion_tangents : (2, R, P) derivatives of speed [m/s] and start [s].

    Returns
    -------
    residuals (T, R, C) and derivatives (T, R, C, P), gain residuals (R, C) and derivatives (R, C, P), and simulated
    signals (T, R, C).
    """
    samples, runs, channels = readings.value.shape
    unknowns = law_tangents.shape[-1]
    signal, gain = (samples, runs, channels), (runs, channels)
    buffers = [*_buffers(lanes, laws, course, recursion), law_tangents, motion_tangents, *readings]
    shapes = [signal, (*signal, unknowns), gain, (*gain, unknowns), signal]
    return _call("linearise", shapes, buffers, laws, timing, layout)


def _buffers(lanes: LaneMatrices, laws: Laws, course: Course, recursion: FilterRecursion | None) -> list[jax.Array]:
    road = course.road
    runs = laws.rows.shape[1]
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
        jnp.broadcast_to(laws.reference_load, (runs, laws.rows.shape[2], 1)),
        poles,
        *((nothing,) * 4 if lanes.beams is None else lanes.beams),
        laws.sides,
        laws.rows,
    ]


def _call(entry: str, shapes, buffers, laws: Laws, timing: Timing, layout: SensorLayout) -> list[jax.Array]:
    results = [jax.ShapeDtypeStruct(shape, jnp.float64) for shape in shapes]
    call = jax.ffi.ffi_call(f"{_registered()}_{entry}", results)
    found = call(
        *(jnp.asarray(b, jnp.float64) for b in buffers),
        samples=np.int64(timing.samples),
        substeps=np.int64(timing.substeps),
        interval=np.float64(timing.interval_s),
        growth=np.float64(laws.growth),
        elements=np.int64(laws.elements),
        ramps=np.int64(laws.ramps[0]),
        rate_ramps=np.int64(laws.ramps[1]),
        deflection_axles=np.array(layout.deflection_axles, np.int64),
        acceleration_axles=np.array(layout.acceleration_axles, np.int64),
    )
    return list(found)
