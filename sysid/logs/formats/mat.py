"""MAT 4 to 7 by scipy and 7.3 by h5py: vectors of the work space, and those in its structures."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any, BinaryIO

import numpy as np

from sysid.logs.by_library import library_format
from sysid.logs.file_channels import FileChannel, unreadable
from sysid.logs.formats import hdf5

_NUMBERS = ("double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))
#: Structures inside structures that are looked into.
_DEPTH = 6


def channels_of(stream: BinaryIO, request: dict[str, Any]) -> Iterator[FileChannel]:
    """Vectors by name; those in a structure S stand in the group S, those in its part P in the group S/P."""
    head = stream.read(520)
    stream.seek(0)
    if b"\x89HDF\r\n\x1a\n" in (head[:8], head[512:520]):
        yield from hdf5.channels_of(stream, request)
        return
    from scipy.io import whosmat

    for name, shape, kind in whosmat(stream):
        if kind in _NUMBERS:
            if sum(n != 1 for n in shape) <= 1:
                yield FileChannel(name, int(max(shape, default=0)), partial(_loaded, stream, name), in_order=False)
            elif np.prod(shape, dtype=float) > 0:
                yield _matrix(name, shape)
        elif kind == "struct":
            yield from _of_structure(name, _variable(stream, name), 1)
        elif kind != "char":
            yield _no_numbers(name, kind)


def _matrix(name: str, shape: tuple[int, ...], group: str = "") -> FileChannel:
    size = " x ".join(map(str, shape))
    return unreadable(name, f"has {size} numbers in '{name[:60]}', expected a vector; save every channel alone", group)


def _no_numbers(name: str, kind: str, group: str = "") -> FileChannel:
    what = f"a variable of class {kind[:30]}"
    return unreadable(name, f"has {what} in '{name[:60]}', expected numbers; save it as a vector of numbers", group)


def _loaded(stream: BinaryIO, name: str) -> tuple[np.ndarray, None]:
    return _variable(stream, name), None


def _variable(stream: BinaryIO, name: str) -> Any:
    from scipy.io import loadmat

    stream.seek(0)
    value = loadmat(stream, variable_names=[name], chars_as_strings=True)[name]
    return value if value.dtype.names else np.asarray(value).reshape(-1)


def _of_structure(name: str, value: np.ndarray, depth: int) -> Iterator[FileChannel]:
    """Vectors of a structure; one of several elements is ``NAME(1)``, ``NAME(2)`` and so on."""
    records = value.reshape(-1)
    for number, record in enumerate(records, start=1):
        group = f"{name}({number})" if records.size > 1 else name
        for field in value.dtype.names or ():
            inner = record[field]
            if not isinstance(inner, np.ndarray) or inner.dtype.kind in "SU":
                continue
            if inner.dtype.names and depth < _DEPTH:
                yield from _of_structure(f"{group}/{field}", inner, depth + 1)
            elif inner.dtype.kind not in "biufc":
                yield _no_numbers(field, "cell" if inner.dtype.kind == "O" else "struct", group)
            elif sum(n != 1 for n in inner.shape) <= 1:
                yield FileChannel(field, inner.size, partial(_flat, inner), group, in_order=False)
            elif inner.size:
                yield _matrix(field, inner.shape, group)


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
