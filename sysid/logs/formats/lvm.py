"""LVM (LabVIEW measurement), by lvm_read: one X column, one per channel, or none but a sample interval."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any, BinaryIO

import numpy as np

from sysid.logs.by_library import library_format
from sysid.logs.file_channels import FileChannel, RefusedError, axis_seconds, even_axis, no_time
from sysid.logs.names import decoded


def channels_of(stream: BinaryIO, request: dict[str, Any]) -> Iterator[FileChannel]:
    """Channels of all segments; with several, the group is ``segment 1`` and so on."""
    from lvm_read import read_str

    text = decoded(stream.read()).replace("\r\n", "\n")
    content = read_str(text)
    several = content["Segments"] > 1
    for number in range(content["Segments"]):
        segment = content[number]
        if "data" in segment:
            yield from _of_segment(segment, str(content.get("X_Columns", "One")), f"segment {number + 1}" * several)


def _of_segment(segment: dict[str, Any], x_columns: str, group: str) -> Iterator[FileChannel]:
    names, data = segment["Channel names"], segment["data"]
    if data.ndim != 2 or not data.size:
        return
    without_x = x_columns == "No"
    x_place: int | None = None
    order = 0
    for place, name in enumerate(names[: data.shape[1]]):
        if name == "X_Value":
            x_place = place
            continue
        if not name or name == "Comment":
            continue
        # Entries of the header stand below the channel where every channel has its own X, else one behind the other.
        entry = place - 1 if x_columns == "Multi" else order
        order += 1
        count = _count(segment, entry, data.shape[0])
        what, x_unit = (_entry(segment, key, entry) or "" for key in ("X_Dimension", "X_Unit_Label"))
        if without_x or x_place is None:
            time, clock = _even(segment, entry, count, what, x_unit, name), "Delta_X"
        else:
            time = partial(_column, data, x_place, count, what, x_unit, name)
            clock = f"X_Value in column {x_place + 1}"
        unit = _entry(segment, "Y_Unit_Label", entry)
        yield FileChannel(name, count, partial(_channel, data[:count, place], unit, name), group, time, clock)


def _channel(values: np.ndarray, unit: str | None, name: str) -> tuple[np.ndarray, str | None]:
    return _readings(values, name), unit


def _count(segment: dict[str, Any], entry: int, rows: int) -> int:
    """Number of values of a channel: as many rows as there are, fewer where the header says so."""
    samples = segment.get("Samples", [])
    said = samples[entry] if entry < len(samples) else rows
    return min(rows, int(said)) if np.isfinite(said) and said > 1 else (rows if said == 1 else 0)


def _entry(segment: dict[str, Any], key: str, entry: int) -> str | None:
    """The word of the header for a channel."""
    words = segment.get(key, [])
    return str(words[entry]) if entry < len(words) else None


def _even(segment: dict[str, Any], entry: int, count: int, what: str, unit: str, name: str) -> Any:
    try:
        start, step = float(segment["X0"][entry]), float(segment["Delta_X"][entry])
    except (KeyError, IndexError, TypeError, ValueError):
        return no_time(RefusedError("has neither an X column nor a Delta_X for every channel; save it with its time"))
    return even_axis(what, unit, 0.0 if np.isnan(start) else start, step, count, name)


def _column(data: np.ndarray, place: int, count: int, what: str, unit: str, name: str) -> np.ndarray:
    return _readings(data[:count, place], f"X_Value of {name}") * axis_seconds(what, unit, name)


def _readings(values: np.ndarray, name: str) -> np.ndarray:
    # The library turns whatever it cannot read into a missing value.
    if not np.isfinite(values).any():
        raise RefusedError(f"has no number in '{name[:60]}'; look at the decimal separator in its header")
    return values


FORMAT = library_format(
    "lvm",
    "an LVM file",
    __name__,
    suffixes=(".lvm",),
    recognises=lambda head: head.removeprefix(b"\xef\xbb\xbf").startswith(b"LabVIEW Measurement"),
    libraries=("lvm_read",),
    extra="lvm",
)
