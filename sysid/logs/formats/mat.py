"""MAT 4 to 7 by scipy and 7.3 by h5py: vectors of the work space, and those in its structures."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any, BinaryIO

import numpy as np

from sysid.logs.by_library import library_format
from sysid.logs.formats import hdf5
from sysid.logs.selection import FileChannel

_NUMBERS = ("double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))


def channels_of(stream: BinaryIO, request: dict[str, Any]) -> Iterator[FileChannel]:
    """Vectors by name; those in a structure S stand in the group S."""
    head = stream.read(520)
    stream.seek(0)
    if b"\x89HDF\r\n\x1a\n" in (head[:8], head[512:520]):
        yield from hdf5.channels_of(stream, request)
        return
    from scipy.io import whosmat

    for name, shape, kind in whosmat(stream):
        if kind in _NUMBERS and sum(n != 1 for n in shape) <= 1 and np.prod(shape, dtype=float) > 1:
            yield FileChannel(name, int(max(shape)), partial(_loaded, stream, name))
        elif kind == "struct" and tuple(shape) == (1, 1):
            yield from _of_structure(name, _variable(stream, name))


def _loaded(stream: BinaryIO, name: str) -> tuple[np.ndarray, None]:
    return _variable(stream, name), None


def _variable(stream: BinaryIO, name: str) -> Any:
    from scipy.io import loadmat

    stream.seek(0)
    value = loadmat(stream, variable_names=[name], chars_as_strings=True)[name]
    return value if value.dtype.names else np.asarray(value).reshape(-1)


def _of_structure(name: str, value: np.ndarray) -> Iterator[FileChannel]:
    record = value.reshape(-1)[0]
    for field in value.dtype.names or ():
        inner = record[field]
        if not isinstance(inner, np.ndarray) or inner.dtype.kind not in "biufc" or inner.size < 2:
            continue
        if sum(n != 1 for n in inner.shape) <= 1:
            yield FileChannel(field, inner.size, partial(_flat, inner), name)


def _flat(value: np.ndarray) -> tuple[np.ndarray, None]:
    return value.reshape(-1), None


FORMAT = library_format(
    "mat",
    "a MAT file",
    __name__,
    suffixes=(".mat",),
    recognises=lambda head: head.startswith((b"MATLAB 5.0", b"MATLAB 7.3")),
    libraries=("scipy.io", "h5py"),
    extra=None,
)
