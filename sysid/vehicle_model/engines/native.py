"""The engine in C++, compiled for this machine: conversion of vehicle-model records to its arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from sysid.vehicle_model.contact import CELL_POLYNOMIAL, EffectiveRoad, TireLaw
from sysid.vehicle_model.device_arrays import ChannelHistories, HostOrDevice, RunsBySets
from sysid.vehicle_model.engines.protocol import (
    LawFunction,
    Linearisation,
    LocalColumns,
    Timing,
    Unknowns,
    WheelRoad,
)
from sysid.vehicle_model.filters import FilterRecursion
from sysid.vehicle_model.motion import Motion
from sysid.vehicle_model.native import kernel
from sysid.vehicle_model.native.buffers import COORDINATES, MAX_AXLES, POLE_NUMBERS, law_rows
from sysid.vehicle_model.native.kernel import Call
from sysid.vehicle_model.readings import Readings
from sysid.vehicle_model.simulation import Histories, SensorLayout
from sysid.vehicle_model.stacked_matrices import StackedMatrices
from sysid.vehicle_model.suspension import ELEMENT_FIELDS, Ramps, SuspensionLaw

_NOTHING = np.zeros(0)


class _Course(NamedTuple):
    """The effective roads, looked up inside the time loop, and `axle_x` (na, 1) [m]."""

    road: EffectiveRoad
    axle_x: HostOrDevice


@dataclass(frozen=True)
class NativeEngine:
    """The compiled twin of the reference engine; see :class:`sysid.vehicle_model.engines.protocol.Engine`."""

    name: str = "native"

    def takes(self, matrices: StackedMatrices) -> bool:
        """Vehicles of the sizes that the kernel is compiled for."""
        return matrices.body_rows.shape[2] in COORDINATES and matrices.static_load.shape[1] <= MAX_AXLES

    def prepare(self, road: EffectiveRoad, axle_x: HostOrDevice, motion: Motion, timing: Timing) -> WheelRoad:
        """Nothing to do beforehand."""
        return WheelRoad(self, _Course(road, axle_x), motion)

    def sensors(
        self,
        matrices: StackedMatrices,
        suspension: SuspensionLaw,
        tire: TireLaw,
        road: WheelRoad,
        timing: Timing,
        layout: SensorLayout,
        recursion: FilterRecursion | None,
    ) -> ChannelHistories:
        """Filtered sensor signals (T, R, C, S)."""
        return kernel.run(_call("sensors", matrices, (suspension, tire), road, timing, layout, recursion))[0]

    def histories(
        self, matrices: StackedMatrices, suspension: SuspensionLaw, tire: TireLaw, road: WheelRoad, timing: Timing
    ) -> Histories:
        """Unfiltered histories."""
        all_axles = tuple(range(matrices.static_load.shape[1]))
        call = _call("histories", matrices, (suspension, tire), road, timing, SensorLayout(all_axles, all_axles), None)
        return Histories(*kernel.run(call))

    def linearise(
        self,
        matrices: StackedMatrices,
        laws: LawFunction,
        unknowns: Unknowns,
        road: WheelRoad,
        timing: Timing,
        layout: SensorLayout,
        recursion: FilterRecursion | None,
        readings: Readings,
    ) -> Linearisation:
        """Derivatives beside the values in the time loop; those of the laws' rows by JAX."""
        at = jnp.broadcast_to(unknowns.value[:, None], unknowns.parameters.shape)
        tangents = jax.jvp(lambda x: _differentiated(*laws(x)), (at,), (unknowns.parameters,))[1]
        more = {
            "law_tangents": tangents["laws"],
            "frame_tangents": tangents["frames"],
            "motion_tangents": jnp.stack(unknowns.motion),
            **readings._asdict(),
        }
        one = laws(unknowns.value[:, None])
        return Linearisation(*kernel.run(_call("linearise", matrices, one, road, timing, layout, recursion, more)))

    def misfits(
        self,
        matrices: StackedMatrices,
        suspension: SuspensionLaw,
        tire: TireLaw,
        road: WheelRoad,
        timing: Timing,
        layout: SensorLayout,
        recursion: FilterRecursion | None,
        readings: Readings,
        local: LocalColumns,
    ) -> RunsBySets:
        """r'r - b' N^-1 b, (R, S); the signals of a run never leave the processor's cache."""
        call = misfit_call(matrices, (suspension, tire), road, timing, layout, recursion, readings, local)
        return kernel.run(call)[0]


NATIVE = NativeEngine()


def misfit_call(
    matrices: StackedMatrices,
    laws: tuple[SuspensionLaw, TireLaw],
    road: WheelRoad,
    timing: Timing,
    layout: SensorLayout,
    recursion: FilterRecursion | None,
    readings: Readings,
    local: LocalColumns,
) -> Call:
    """The call that computes misfits, also for the benchmark without Python and XLA."""
    more = {**readings._asdict(), **{f"local_{name}": array for name, array in local._asdict().items()}}
    return _call("misfits", matrices, laws, road, timing, layout, recursion, more)


def _call(
    entry: str,
    matrices: StackedMatrices,
    laws: tuple[SuspensionLaw, TireLaw],
    road: WheelRoad,
    timing: Timing,
    layout: SensorLayout,
    recursion: FilterRecursion | None,
    more: dict[str, Any] | None = None,
) -> Call:
    suspension, tire = laws
    present, ramps = _elements(suspension), [0 if r is None else len(r.at) for r in _corners(suspension)]
    arrays = _matrix_arrays(matrices) | _road_arrays(road) | _filter_arrays(recursion) | _law_arrays(suspension, tire)
    rows, runs, axles, sets = arrays["laws"].shape
    sizes = {
        "R": runs,
        "S": sets,
        "T": timing.samples,
        "C": len(layout.deflection_axles) + len(layout.acceleration_axles) + matrices.body_rows.shape[1],
        "na": axles,
        "nb": matrices.body_rows.shape[2],
        "nr": matrices.body_rows.shape[1],
        "n": arrays["rise"].shape[2],
        "nf": 0 if matrices.frames is None else matrices.frames.select.shape[1],
        "L": rows,
        "J": sum(ramps),
        "poles": arrays["filter"].shape[0],
        "P": 0 if more is None or "law_tangents" not in more else more["law_tangents"].shape[-1],
    }
    settings = {
        "samples": np.int64(timing.samples),
        "substeps": np.int64(timing.substeps),
        "interval": np.float64(timing.interval_s),
        "growth": np.float64(tire.growth),
        "elements": np.int64(sum(1 << bit for bit, name in enumerate(ELEMENT_FIELDS) if name in present)),
        "ramps": np.int64(ramps[0]),
        "stops": np.int64(ramps[1]),
        "rate_ramps": np.int64(ramps[2]),
        "deflection_axles": np.array(layout.deflection_axles, np.int64),
        "acceleration_axles": np.array(layout.acceleration_axles, np.int64),
    }
    return Call(entry, arrays | (more or {}), sizes, settings)


def _matrix_arrays(matrices: StackedMatrices) -> dict[str, Any]:
    names = ("position", "rate", "acceleration", "inverse_unsprung", "static_load", "body_rows")
    beams = (_NOTHING,) * 4 if matrices.beams is None else matrices.beams
    return (
        {name: getattr(matrices, name) for name in names}
        | dict(zip(("wheel", "tire_push", "beam_pull", "carries"), beams, strict=True))
        | {"sharing": _NOTHING if matrices.sharing is None else matrices.sharing}
        | dict(zip(("frame_select", "frame_push"), matrices.frames or (_NOTHING,) * 2, strict=True))
    )


def _road_arrays(road: WheelRoad) -> dict[str, Any]:
    course: _Course = road.prepared
    table, (speed, start_s, acceleration, _) = course.road, road.motion
    return {
        "rise": table.rise,
        "stretch": _NOTHING if table.stretch is None else table.stretch,
        "drag": _NOTHING if table.drag is None else table.drag,
        "grid": jnp.stack([jnp.asarray(table.first_station_m, float), jnp.asarray(table.step_m, float)]),
        "polynomial": CELL_POLYNOMIAL,
        "axle_x": course.axle_x,
        "motion": jnp.stack([speed[:, 0], start_s[:, 0], jnp.broadcast_to(acceleration, speed.shape)[:, 0]]),
    }


def _filter_arrays(recursion: FilterRecursion | None) -> dict[str, Any]:
    if recursion is None:
        return {"filter": np.zeros((0, POLE_NUMBERS))}
    parts = (recursion.decay, recursion.start, recursion.middle, recursion.weight, recursion.feed)
    return {"filter": np.stack([f(part) for part in parts for f in (np.real, np.imag)], axis=1)}


def _elements(law: SuspensionLaw) -> tuple[str, ...]:
    """Elements that some axle has."""
    return tuple(n for n, fields in ELEMENT_FIELDS.items() if all(getattr(law, field) is not None for field in fields))


def _differentiated(suspension: SuspensionLaw, tire: TireLaw) -> dict[str, jax.Array]:
    """Arrays that depend on parameters."""
    arrays = _law_arrays(suspension, tire)
    return {name: arrays[name] for name in ("laws", "frames")}


def _corners(law: SuspensionLaw) -> tuple[Ramps | None, ...]:
    """Ramps of a law in the order in which they cross."""
    return law.ramps, law.stops, law.rate_ramps


def _law_arrays(suspension: SuspensionLaw, tire: TireLaw) -> dict[str, jax.Array]:
    """Laws of all passes and sets as rows; elements that no axle has are left out."""
    shape = suspension.stiffness.shape

    def row(value: jax.Array) -> jax.Array:
        return jnp.broadcast_to(jnp.asarray(value, float), shape)

    tires = {
        "static_deflection": tire.static_deflection,
        "reference_deflection": tire.reference_deflection,
        "exponent": tire.exponent,
        "tire_damping": tire.damping,
    }
    known = suspension._asdict() | tires
    rows = [row(known[name]) for name in law_rows(_elements(suspension))]
    sides = []
    for ramps in _corners(suspension):
        for at, slope, side in [] if ramps is None else zip(*ramps, strict=True):
            rows += [row(at), row(slope)]
            sides.append(row(side))
    return {
        "laws": jnp.stack(rows),
        "frames": jnp.zeros(0) if suspension.frames is None else jnp.stack(suspension.frames),
        "sides": jnp.stack(sides) if sides else jnp.zeros((0, *shape)),
        "reference_load": jnp.broadcast_to(jnp.asarray(tire.reference_load, float), (*shape[:2], 1)),
    }
