"""The engine in C++, compiled for this machine: conversion of vehicle-model records to its arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import Partial

from sysid.vehicle_model.contact import CELL_POLYNOMIAL, EffectiveRoad, TireLaw
from sysid.vehicle_model.device_arrays import ChannelHistories, HostOrDevice, RunsBySets, numpy_of
from sysid.vehicle_model.engines.protocol import (
    Columns,
    LawFunction,
    Linearisation,
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
from sysid.vehicle_model.simulation import Histories, SensorLayout, observed
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
        return WheelRoad(self, _Course(road, axle_x), motion, road.edged)

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
        return Histories._make(kernel.run(call))

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
        traceable = laws if isinstance(laws, Partial) else Partial(laws)
        tangents = _law_tangents(traceable, unknowns.value, unknowns.parameters)
        more = {
            "law_tangents": tangents["laws"],
            "frame_tangents": tangents["frames"],
            "motion_tangents": numpy_of(*unknowns.motion).stack(unknowns.motion),
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
        columns: Columns,
    ) -> tuple[RunsBySets, HostOrDevice]:
        """r'r and A'r; the signals of a run never leave the processor's cache."""
        call = misfit_call(matrices, (suspension, tire), road, timing, layout, recursion, readings, columns)
        squares, products = kernel.run(call)
        return squares, products


NATIVE = NativeEngine()


def misfit_call(
    matrices: StackedMatrices,
    laws: tuple[SuspensionLaw, TireLaw],
    road: WheelRoad,
    timing: Timing,
    layout: SensorLayout,
    recursion: FilterRecursion | None,
    readings: Readings,
    columns: Columns,
) -> Call:
    """The call that computes misfits, also for the benchmark without Python."""
    along = columns.residual.transpose(1, 3, 2, 0)
    more = {**readings._asdict(), "columns_residual": along, "columns_gain": columns.gain}
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
        "M": runs if arrays["stretch"].ndim == 1 or arrays["stretch"].shape[1] == runs else 1,
        "S": sets,
        "T": timing.samples,
        "C": observed(layout, matrices),
        "na": axles,
        "nb": matrices.body_rows.shape[2],
        "nr": matrices.body_rows.shape[1],
        "nv": 0 if matrices.rate_rows is None else matrices.rate_rows.shape[1],
        "n": arrays["rise"].shape[2],
        "nf": 0 if matrices.frames is None else matrices.frames.select.shape[1],
        "L": rows,
        "J": sum(ramps),
        "poles": arrays["filter"].shape[0],
        "K": 0 if more is None or "columns_gain" not in more else more["columns_gain"].shape[-1],
        "P": 0 if more is None or "law_tangents" not in more else more["law_tangents"].shape[-1],
    }
    settings = {
        "samples": timing.samples,
        "substeps": timing.substeps,
        "interval": timing.interval_s,
        "elements": sum(1 << bit for bit, name in enumerate(ELEMENT_FIELDS) if name in present),
        "ramps": ramps[0],
        "stops": ramps[1],
        "rate_ramps": ramps[2],
        "edged": int(road.edged),
        "deflection_axles": layout.deflection_axles,
        "acceleration_axles": layout.acceleration_axles,
    }
    return Call(entry, arrays | (more or {}), sizes, settings)


def _matrix_arrays(matrices: StackedMatrices) -> dict[str, Any]:
    names = ("position", "rate", "acceleration", "inverse_unsprung", "static_load", "body_rows")
    beams = (_NOTHING,) * 4 if matrices.beams is None else matrices.beams
    return (
        {name: getattr(matrices, name) for name in names}
        | dict(zip(("wheel", "tire_push", "beam_pull", "carries"), beams, strict=True))
        | {"rate_rows": _NOTHING if matrices.rate_rows is None else matrices.rate_rows}
        | {"sharing": _NOTHING if matrices.sharing is None else matrices.sharing}
        | dict(zip(("frame_select", "frame_push"), matrices.frames or (_NOTHING,) * 2, strict=True))
    )


def _road_arrays(road: WheelRoad) -> dict[str, Any]:
    course: _Course = road.prepared
    table, (speed, start_s, acceleration, _) = course.road, road.motion
    xp = numpy_of(speed, start_s, acceleration)
    return {
        "rise": table.rise,
        "stretch": _NOTHING if table.stretch is None else table.stretch,
        "drag": _NOTHING if table.drag is None else table.drag,
        "grid": xp.stack([xp.asarray(table.first_station_m, float), xp.asarray(table.step_m, float)]),
        "polynomial": CELL_POLYNOMIAL,
        "axle_x": course.axle_x,
        "motion": xp.stack([speed[:, 0], start_s[:, 0], xp.broadcast_to(acceleration, speed.shape)[:, 0]]),
    }


def _filter_arrays(recursion: FilterRecursion | None) -> dict[str, Any]:
    if recursion is None:
        return {"filter": np.zeros((0, POLE_NUMBERS))}
    parts = (recursion.decay, recursion.start, recursion.middle, recursion.weight, recursion.feed)
    return {"filter": np.stack([f(part) for part in parts for f in (np.real, np.imag)], axis=1)}


def _elements(law: SuspensionLaw) -> tuple[str, ...]:
    """Elements that some axle has."""
    return tuple(n for n, fields in ELEMENT_FIELDS.items() if all(getattr(law, field) is not None for field in fields))


@jax.jit
def _law_tangents(laws: LawFunction, value: HostOrDevice, directions: HostOrDevice) -> dict[str, jax.Array]:
    """Derivatives (..., P) of the arrays that depend on parameters, at (p,) along `directions` (p, P)."""
    at = jnp.broadcast_to(value[:, None], directions.shape)
    tangents: dict[str, jax.Array] = jax.jvp(lambda x: _differentiated(*laws(x)), (at,), (directions,))[1]
    return tangents


def _differentiated(suspension: SuspensionLaw, tire: TireLaw) -> dict[str, HostOrDevice]:
    """Arrays that depend on parameters."""
    arrays = _law_arrays(suspension, tire)
    return {name: arrays[name] for name in ("laws", "frames")}


def _corners(law: SuspensionLaw) -> tuple[Ramps | None, ...]:
    """Ramps of a law in the order in which they cross."""
    return law.ramps, law.stops, law.rate_ramps


def _law_arrays(suspension: SuspensionLaw, tire: TireLaw) -> dict[str, HostOrDevice]:
    """Laws of all passes and sets as rows; elements that no axle has are left out."""
    shape = suspension.stiffness.shape
    xp = numpy_of(*jax.tree.leaves((suspension, tire)))

    def row(value: HostOrDevice | float) -> Any:
        return xp.broadcast_to(xp.asarray(value, float), shape)

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
        "laws": xp.stack(rows),
        "frames": xp.zeros(0) if suspension.frames is None else xp.stack(suspension.frames),
        "sides": xp.stack(sides) if sides else xp.zeros((0, *shape)),
        "reference_load": xp.broadcast_to(xp.asarray(tire.reference_load, float), (*shape[:2], 1)),
        "growth": xp.broadcast_to(xp.asarray(tire.growth, float), (*shape[:2], 1)),
    }
