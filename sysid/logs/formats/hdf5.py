"""HDF5 and netCDF-4, by h5py: vectors and columns of tables, on their dimension's axis, a sample rate or a time beside.

Attributes mean what they do in the CF conventions and in waveforms of LabVIEW.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any, BinaryIO

import numpy as np

from sysid import limits
from sysid.logs.by_library import library_format
from sysid.logs.file_channels import FileChannel, RefusedError, axis_seconds, no_time, unreadable
from sysid.logs.formats.hdf5_attributes import even_stamps, instants, start_of, text_of, unit_of, values_of
from sysid.logs.names import decoded
from sysid.logs.time_columns import find_time

#: Classes of MATLAB 7.3 that hold numbers.
_MATLAB = ("double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))
_ONLY_A_SIZE = "This is a netCDF dimension but not a netCDF variable"


def channels_of(stream: BinaryIO, request: dict[str, Any]) -> Iterator[FileChannel]:
    """Data sets of all groups that are vectors of numbers.

    Raises
    ------
    RefusedError
        If there are too many data sets, or data stand in other files.
    """
    import h5py

    file = h5py.File(stream, "r")
    sets: list[Any] = []

    def visit(path: str | bytes, item: Any) -> None:
        # MATLAB keeps what its own types need under names like this.
        if isinstance(item, h5py.Dataset) and not _text(path).startswith("#"):
            sets.append(item)
            if len(sets) > limits.LOG_CHANNELS:
                raise RefusedError(f"has more than {limits.LOG_CHANNELS} data sets; export those of the sensors only")

    # Links to other files are not followed by this walk.
    file.visititems(visit)
    scales = {data.name: data for data in sets if h5py.h5ds.is_scale(data.id)}
    sizes = {name for name, data in scales.items() if text_of(data, "NAME").startswith(_ONLY_A_SIZE)}
    axes = {
        name: FileChannel(_place(data)[1], data.size, partial(_load, data, None), _place(data)[0], axis=True)
        for name, data in scales.items()
        if name not in sizes
    }
    timed = {(_place(d)[0], d.size) for d in sets if find_time((_place(d)[1],), None) is not None}
    starts = {start for data in sets if isinstance(start := start_of(data), np.datetime64)}
    for data in sets:
        if data.name in axes:
            yield axes[data.name]
        elif data.name not in sizes:
            yield from _of_data_set(data, axes, timed, starts, request["messages"])


def _place(data: Any) -> tuple[str, str]:
    """Group and name of a data set."""
    group, _, name = _text(data.name).strip("/").rpartition("/")
    return group, name


def _text(path: str | bytes) -> str:
    """A path, of which the library gives the bytes where they are not UTF-8."""
    return decoded(path) if isinstance(path, bytes) else path


def _of_data_set(
    data: Any,
    axes: dict[str, FileChannel],
    timed: set[tuple[str, int]],
    starts: set[np.datetime64],
    messages: list[str],
) -> Iterator[FileChannel]:
    group, name = _place(data)
    path = f"{group}/{name}" if group else name
    if data.external or data.is_virtual:
        raise RefusedError(f"keeps the data of '{path[:60]}' in other files; write them into one")
    matlab = text_of(data, "MATLAB_class")
    if data.shape is None or data.dtype is None or data.size < 2 or matlab == "char" or "MATLAB_empty" in data.attrs:
        return
    if data.dtype.names and len(data.shape) == 1:
        for column in data.dtype.names[: limits.LOG_COLUMNS]:
            yield FileChannel(str(column), data.shape[0], partial(_column, data, column), path)
    elif data.dtype.kind not in "biufc" or (matlab and matlab not in _MATLAB):
        what = f"a variable of class {matlab[:30]}" if matlab else "text or dates"
        yield unreadable(name, f"has {what} in '{path[:60]}', expected numbers; write it as numbers", group)
    elif sum(n != 1 for n in data.shape) > 1:
        size = " x ".join(map(str, data.shape))
        yield unreadable(
            name, f"has {size} numbers in '{path[:60]}', expected a vector; write every channel alone", group
        )
    else:
        with_time = (group, data.size) in timed
        time = even_stamps(data, path, starts, with_time) or _axis(data, path, axes, with_time)
        yield FileChannel(name, data.size, partial(_load, data, messages), group, time, "sample rate", in_order=False)


def _column(data: Any, column: str) -> tuple[np.ndarray, None]:
    return data[column], None


def _load(data: Any, messages: list[str] | None) -> tuple[np.ndarray, str | None]:
    values, unit = values_of(data, messages), unit_of(data)
    dates = instants(values, unit)
    return (values, unit) if dates is None else (dates, None)


def _axis(data: Any, path: str, axes: dict[str, FileChannel], with_time: bool) -> Any:
    """What a data set says by its dimension: the channel of its stamps, the refusal of an axis that is not time."""
    place = next((i for i, n in enumerate(data.shape) if n != 1), 0)
    scale = data.dims[place][0] if len(data.dims[place]) else None
    if scale is None or scale.name not in axes:
        return None
    axis, unit = axes[scale.name], unit_of(scale)
    quantity = text_of(scale, "standard_name") or text_of(scale, "long_name") or axis.name
    try:
        # A unit of time says enough: names of axes are free.
        axis_seconds("" if unit else quantity, unit and unit.partition(" since ")[0], path)
    except RefusedError as error:
        return None if with_time else no_time(error)
    return axis


FORMAT = library_format(
    "hdf5",
    "an HDF5 file",
    __name__,
    suffixes=(".h5", ".hdf5", ".hdf"),
    recognises=lambda head: head.startswith(b"\x89HDF\r\n\x1a\n"),
    libraries=("h5py",),
    extra=None,
)
