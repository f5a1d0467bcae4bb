"""HDF5, by h5py: one-dimensional data sets and columns of tables, each with a time of its group or a sample rate."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any, BinaryIO

import numpy as np

from sysid import limits
from sysid.logs.by_library import library_format
from sysid.logs.selection import FileChannel, RefusedError, even_time

_UNITS = ("unit", "units", "Unit", "Units", "UNIT", "unit_string")
_STEPS = ("sample_interval_s", "dt", "wf_increment")
_RATES = ("sample_rate_hz", "sample_rate", "sampling_rate", "fs")


def channels_of(stream: BinaryIO, request: dict[str, Any]) -> Iterator[FileChannel]:
    """Data sets of all groups that are vectors of numbers.

    Raises
    ------
    RefusedError
        If there are too many data sets, or data stand in other files.
    """
    import h5py

    file = h5py.File(stream, "r")
    places: list[str] = []

    def visit(path: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            places.append(path)
            if len(places) > limits.LOG_CHANNELS:
                raise RefusedError(f"has more than {limits.LOG_CHANNELS} data sets; export those of the sensors only")

    # Links to other files are not followed by this walk.
    file.visititems(visit)
    for path in places:
        # MATLAB keeps what its own types need under names like this.
        if not path.startswith("#"):
            yield from _of_data_set(file[path], path)


def _of_data_set(data: Any, path: str) -> Iterator[FileChannel]:
    if data.external or data.is_virtual:
        raise RefusedError(f"keeps the data of '{path[:60]}' in other files; write them into one")
    if data.shape is None or data.dtype is None:
        return
    group, _, name = path.rpartition("/")
    if data.dtype.names and len(data.shape) == 1:
        for column in data.dtype.names[: limits.LOG_COLUMNS]:
            yield FileChannel(str(column), data.shape[0], partial(_column, data, column), path)
    elif data.dtype.kind in "biufc" and sum(n != 1 for n in data.shape) <= 1 and data.size > 1:
        yield FileChannel(
            name, data.size, lambda: (np.asarray(data[()]).reshape(-1), _unit(data)), group, *_own_time(data)
        )


def _column(data: Any, column: str) -> tuple[np.ndarray, None]:
    return data[column], None


def _own_time(data: Any) -> tuple[Any, ...]:
    step = next((_number(data, key) for key in _STEPS if key in data.attrs), None)
    rate = next((_number(data, key) for key in _RATES if key in data.attrs), None)
    if step is None and rate:
        step = 1.0 / rate
    return () if step is None else (even_time(0.0, step, data.size), f"sample rate {step!r}")


def _number(data: Any, key: str) -> float:
    value = np.asarray(data.attrs[key])
    if value.size != 1 or value.dtype.kind not in "iuf":
        raise RefusedError(f"has no number in the attribute '{key}'; correct or remove it")
    return float(value.reshape(-1)[0])


def _unit(data: Any) -> str | None:
    for key in _UNITS:
        value = data.attrs.get(key)
        if isinstance(value, np.ndarray) and value.size == 1:
            value = value.reshape(-1)[0]
        if isinstance(value, bytes):
            value = value.decode("utf-8", "replace")
        if isinstance(value, str):
            return value
    return None


FORMAT = library_format(
    "hdf5",
    "an HDF5 file",
    __name__,
    suffixes=(".h5", ".hdf5", ".hdf"),
    recognises=lambda head: head.startswith(b"\x89HDF\r\n\x1a\n"),
    libraries=("h5py",),
    extra=None,
)
