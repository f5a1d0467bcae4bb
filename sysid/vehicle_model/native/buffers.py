"""What crosses into the compiled engine, described once: arrays by name, shape and meaning, and shared constants.

The C++ side is compiled with a header made from this description (:mod:`sysid.vehicle_model.native.header`), the Python
side checks every call against it.

Symbols of shapes: R runs, S parameter sets, T samples, C channels, na axles, nb body coordinates, nr body sensors, nv
sensors of pitch rate, n stations of the road, M footprint maps (R, or 1 for all runs), nf bending frames, L rows of the
laws, J ramps, P unknowns, K columns, `poles` of the filter. All arrays hold 64-bit floats.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from sysid.vehicle_model.contact import CELL_POLYNOMIAL, NO_DEFLECTION, SOFT_DAMPING
from sysid.vehicle_model.suspension import ELEMENT_FIELDS, REFERENCE_RATE_M_S, SHORTEST
from sysid.vehicle_model.suspension_states import LONGEST, SMALL_CHANGE_M_S

#: Numbers of body coordinates that the kernel is compiled for, and the most axles it takes.
COORDINATES = range(3, 9)
MAX_AXLES = 24
#: Rows of a footprint map: stretch alpha_1, alpha_2, alpha_3 and lift; drag beta_0, beta_1, beta_2.
STRETCH_ROWS, DRAG_ROWS = 4, 3
#: Coefficients of the road's polynomial on a cell, and the real numbers of one pole of the filter.
CELL_POWERS = len(CELL_POLYNOMIAL)
POLE_NUMBERS = 10
#: Numbers of a run's motion: speed, start and acceleration.
MOTION_NUMBERS = 3

#: Integer and real constants of both sides, by their names in C++.
CONSTANTS: dict[str, int | float] = {
    "kLeastCoordinates": COORDINATES[0],
    "kMostCoordinates": COORDINATES[-1],
    "kMaxAxles": MAX_AXLES,
    "kStretchRows": STRETCH_ROWS,
    "kDragRows": DRAG_ROWS,
    "kCellPowers": CELL_POWERS,
    "kPoleNumbers": POLE_NUMBERS,
    "kReferenceRate": REFERENCE_RATE_M_S,
    "kShortest": SHORTEST,
    "kLongest": LONGEST,
    "kSmallChange": SMALL_CHANGE_M_S,
    "kSoftDamping": SOFT_DAMPING,
    "kNoDeflection": NO_DEFLECTION,
}

#: What the compiled side says where memory does not suffice.
NO_MEMORY = "memory does not suffice for the native engine"

#: What a call says beside its arrays, by its name in C++: numbers, and lists of axles. `elements` are bits of the
#: elements that suspensions have, then numbers of ramps; the axles are those whose sensors are observed; a road with
#: edges is looked up where the wheels are.
SETTINGS: dict[str, type] = {
    "samples": int,
    "substeps": int,
    "interval": float,
    "elements": int,
    "ramps": int,
    "stops": int,
    "rate_ramps": int,
    "edged": int,
    "deflection_axles": list,
    "acceleration_axles": list,
}

#: First rows of all laws, of suspension and tire; those of the elements that some axle has follow, then place and slope
#: of every ramp.
LAW_ROWS = ("stiffness", "damping", "static_deflection", "reference_deflection", "exponent", "tire_damping")


class Buffer(NamedTuple):
    """One array: its name, its shape in numbers and symbols, what it holds, and whether it may be empty, (0,)."""

    name: str
    shape: tuple[str | int, ...]
    meaning: str
    optional: bool = False


#: Arrays that stand together, in the order in which they cross.
BLOCKS: dict[str, tuple[Buffer, ...]] = {
    "common": (
        Buffer("position", ("R", "2 na + nb", "nb"), "of StackedMatrices"),
        Buffer("rate", ("R", "2 na + nb", "nb"), "of StackedMatrices"),
        Buffer("acceleration", ("R", "nb", "2 na"), "of StackedMatrices"),
        Buffer("inverse_unsprung", ("R", "na", 1), "of StackedMatrices"),
        Buffer("static_load", ("R", "na", 1), "of StackedMatrices"),
        Buffer("body_rows", ("R", "nr", "nb"), "of StackedMatrices"),
        Buffer("rate_rows", ("R", "nv", "nb"), "of StackedMatrices, empty without sensors of pitch rate", True),
        Buffer("rise", ("R", "na", "n"), "of EffectiveRoad"),
        Buffer("stretch", (STRETCH_ROWS, "M", "na", "n"), "of EffectiveRoad, empty for a point follower", True),
        Buffer("drag", (DRAG_ROWS, "M", "na", "n"), "of EffectiveRoad, empty for a point follower", True),
        Buffer("grid", (2,), "first station and step [m]"),
        Buffer("polynomial", (CELL_POWERS, CELL_POWERS), "CELL_POLYNOMIAL"),
        Buffer("axle_x", ("na", 1), "[m]"),
        Buffer("motion", (MOTION_NUMBERS, "R"), "speed [m/s], start [s] and acceleration [m/s2]"),
        Buffer("reference_load", ("R", "na", 1), "of TireLaw [N]"),
        Buffer("growth", ("R", "na", 1), "of TireLaw"),
        Buffer("filter", ("poles", POLE_NUMBERS), "real and imaginary part of decay, start, middle, weight, feed"),
        Buffer("wheel", ("R", "na", "na"), "of StackedBeams, empty without axle groups", True),
        Buffer("tire_push", ("R", "na", "na"), "`tire` of StackedBeams, empty without axle groups", True),
        Buffer("beam_pull", ("R", "na", "na"), "`pull` of StackedBeams, empty without axle groups", True),
        Buffer("carries", ("R", "na", 1), "of StackedBeams, empty without axle groups", True),
        Buffer("sharing", ("R", "na", "na"), "of StackedMatrices, empty without rockers", True),
        Buffer("frame_select", ("R", "nf", "nb"), "`select` of StackedFrames, empty where no frame bends", True),
        Buffer("frame_push", ("R", "nb", "nf"), "`push` of StackedFrames, empty where no frame bends", True),
        Buffer("frames", (2, "R", "nf", "S"), "of FrameLaw, empty where no frame bends", True),
        Buffer("sides", ("J", "R", "na", "S"), "sides of all ramps: of springs, of stops, of dampers"),
        Buffer("laws", ("L", "R", "na", "S"), "LAW_ROWS, ELEMENT_FIELDS, place and slope of ramps"),
    ),
    "tangents": (
        Buffer("law_tangents", ("L", "R", "na", "P"), "derivatives of `laws`"),
        Buffer("frame_tangents", (2, "R", "nf", "P"), "derivatives of `frames`", True),
        Buffer("motion_tangents", (MOTION_NUMBERS, "R", "P"), "derivatives of `motion`"),
    ),
    "readings": (
        Buffer("value", ("T", "R", "C"), "of Readings"),
        Buffer("measured", ("T", "R", "C"), "of Readings"),
        Buffer("censored", ("T", "R", "C"), "of Readings"),
        Buffer("noise_sd", ("R", "C"), "of Readings"),
        Buffer("tempering", ("R", "C"), "of Readings"),
        Buffer("gain_sd", ("C",), "of Readings"),
    ),
    "columns": (
        Buffer("columns_residual", ("R", "K", "C", "T"), "of Columns, the samples of a channel next to each other"),
        Buffer("columns_gain", ("R", "C", "K"), "of Columns"),
    ),
}

_SIGNALS, _GAINS = ("T", "R", "C"), ("R", "C")


class Entry(NamedTuple):
    """An entry point: the blocks of arrays that it takes, in their order, and what it returns."""

    blocks: tuple[str, ...]
    results: tuple[Buffer, ...]

    @property
    def buffers(self) -> tuple[Buffer, ...]:
        """All arrays that it takes, in their order."""
        return tuple(buffer for block in self.blocks for buffer in BLOCKS[block])


ENTRIES: dict[str, Entry] = {
    "sensors": Entry(("common",), (Buffer("signals", (*_SIGNALS, "S"), "filtered"),)),
    "histories": Entry(
        ("common",),
        tuple(
            Buffer(name, ("T", "R", rows, "S"), "of Histories")
            for name, rows in (
                ("deflection", "na"),
                ("axle_acceleration", "na"),
                ("body_acceleration", "nr"),
                ("tire_force", "na"),
                ("horizontal_force", "na"),
                ("suspension_force", "na"),
                ("body", "nb"),
            )
        ),
    ),
    "misfits": Entry(
        ("common", "readings", "columns"),
        (Buffer("squares", ("R", "S"), "r'r"), Buffer("products", ("R", "K", "S"), "A'r")),
    ),
    "linearise": Entry(
        ("common", "tangents", "readings"),
        (
            Buffer("residual", _SIGNALS, "of Linearisation"),
            Buffer("residual_jacobian", (*_SIGNALS, "P"), "of Linearisation"),
            Buffer("gain_residual", _GAINS, "of Linearisation"),
            Buffer("gain_jacobian", (*_GAINS, "P"), "of Linearisation"),
            Buffer("simulated", _SIGNALS, "of Linearisation"),
        ),
    ),
}


def law_rows(present: Sequence[str]) -> tuple[str, ...]:
    """Names of the rows of the laws without ramps, with the elements that are present."""
    return (*LAW_ROWS, *(field for name, fields in ELEMENT_FIELDS.items() if name in present for field in fields))


def size(dimension: str | int, sizes: Mapping[str, int]) -> int:
    """The number that a dimension such as ``2 na + nb`` stands for."""
    if isinstance(dimension, int):
        return dimension
    total = 0
    for term in dimension.split(" + "):
        *factor, symbol = term.split(" ")
        total += int(factor[0] if factor else 1) * sizes[symbol]
    return total


def shape(buffer: Buffer, sizes: Mapping[str, int]) -> tuple[int, ...]:
    """Shape of an array in numbers."""
    return tuple(size(d, sizes) for d in buffer.shape)


def in_order(entry: str, arrays: Mapping[str, Any], sizes: Mapping[str, int]) -> list[Any]:
    """Arrays of a call in the order in which they cross, each checked.

    Raises
    ------
    ValueError
        If one is missing, is not known, or has another shape or type than described.
    """
    buffers = ENTRIES[entry].buffers
    known = {b.name for b in buffers}
    for name in sorted(known ^ arrays.keys()):
        what = "lacks" if name in known else "does not know"
        raise ValueError(f"The call `{entry}` of the native engine {what} the array `{name}`.")
    for buffer in buffers:
        _check(entry, buffer, arrays[buffer.name], sizes)
    return [arrays[b.name] for b in buffers]


def _check(entry: str, buffer: Buffer, array: Any, sizes: Mapping[str, int]) -> None:
    given, expected = tuple(np.shape(array)), shape(buffer, sizes)
    if given != expected and not (buffer.optional and given == (0,)):
        symbols = ", ".join(map(str, buffer.shape))
        empty = " or be empty" if buffer.optional else ""
        raise ValueError(
            f"The array `{buffer.name}` of the native engine's call `{entry}` has the shape {given}; "
            f"it should be ({symbols}) = {expected}{empty}."
        )
    kind = getattr(array, "dtype", None)
    if kind != np.float64:
        raise ValueError(
            f"The array `{buffer.name}` of the native engine's call `{entry}` holds {kind or type(array).__name__}; "
            "it should hold float64."
        )
