"""Loads the compiled engine and calls its entry points with arrays that are checked against their description."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from sysid.runtime import refuse_fork
from sysid.threads import thread_count
from sysid.vehicle_model.device_arrays import HostOrDevice
from sysid.vehicle_model.native import build, header, prebuilt
from sysid.vehicle_model.native.buffers import ENTRIES, NO_MEMORY, SETTINGS, in_order, shape
from sysid.vehicle_model.native.build import BuildError


class _Array(ctypes.Structure):
    """The struct `Array` of ``call.h``."""

    _fields_ = (("data", ctypes.c_void_p), ("shape", ctypes.POINTER(ctypes.c_int64)), ("axes", ctypes.c_int64))


class _AxleList(ctypes.Structure):
    """The struct `AxleList` of the header."""

    _fields_ = (("at", ctypes.POINTER(ctypes.c_int64)), ("count", ctypes.c_int64))


_KINDS: dict[type, Any] = {int: ctypes.c_int64, float: ctypes.c_double, list: _AxleList}


class _Settings(ctypes.Structure):
    """The struct `Settings` of the header."""

    _fields_ = tuple((name, _KINDS[kind]) for name, kind in SETTINGS.items())


class Call(NamedTuple):
    """A call of an entry point: its arrays by name, the numbers that the symbols of their shapes stand for, and its
    settings (:data:`sysid.vehicle_model.native.buffers.SETTINGS`)."""

    entry: str
    arrays: Mapping[str, Any]
    sizes: Mapping[str, int]
    settings: Mapping[str, Any]

    def ordered(self) -> list[Any]:
        """The arrays in the order in which they cross, checked (raises ValueError)."""
        return in_order(self.entry, self.arrays, self.sizes)


class Loaded(NamedTuple):
    """A library, and where it comes from."""

    library: ctypes.CDLL
    origin: str


_lock = threading.Lock()


@cache
def _loaded(coordinates: int | None) -> Loaded:
    """Compiled for this processor and so many body coordinates where that can be done, else prebuilt."""
    problems = []
    for find in (_compiled, _prebuilt):
        try:
            return find(coordinates)
        except BuildError as error:
            problems.append(str(error))
    raise BuildError(", and ".join(problems))


def _compiled(coordinates: int | None) -> Loaded:
    path = build.library(coordinates)
    return load(path, "compiled on this machine")


def _prebuilt(_coordinates: int | None) -> Loaded:
    name, path = prebuilt.library()  # for every number of coordinates
    return load(path, f"prebuilt for {name}")


@cache
def load(path: Path, origin: str) -> Loaded:
    """Load a library.

    Raises
    ------
    BuildError
        If it cannot be loaded, or takes other arrays than this version passes.
    """
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        raise BuildError(f"the compiled engine cannot be loaded ({error})") from error
    check_fingerprint(library)
    library.sysid_use_threads(ctypes.c_int64(thread_count()))
    return Loaded(library, origin)


def check_fingerprint(loaded: ctypes.CDLL) -> None:
    """Refuse a library that was compiled with another description of the arrays.

    Raises
    ------
    BuildError
        If it was, or says nothing about it.
    """
    try:
        say = loaded.sysid_fingerprint
    except AttributeError as error:
        raise BuildError("the compiled engine does not say which arrays it takes") from error
    say.restype = ctypes.c_char_p
    if say() != header.fingerprint().encode("ascii"):
        raise BuildError("the compiled engine takes other arrays than this version passes")


def prepare(coordinates: int | None = None) -> str:
    """Load the engine if that has not been done, compiling it if need be; where it comes from, in words.

    Parameters
    ----------
    coordinates : body coordinates of the vehicles that it is for; None: one is as good as another.

    Raises
    ------
    BuildError
        If there is none to be had on this machine.
    """
    with _lock:
        return _loaded(coordinates).origin


def run(call: Call) -> list[HostOrDevice]:
    """Results of a call: NumPy arrays, or JAX's where JAX traces the function that makes it.

    Raises
    ------
    ValueError
        If an array is missing, is not known, or has another shape or type than described, or the compiled side refuses
        the call.
    MemoryError
        If memory does not suffice.
    BuildError
        If there is no engine to be had on this machine.
    """
    refuse_fork()
    arrays = call.ordered()
    shapes = [shape(result, call.sizes) for result in ENTRIES[call.entry].results]
    library = _loaded(call.sizes["nb"]).library
    if any(isinstance(array, jax.core.Tracer) for array in arrays):
        made = [jax.ShapeDtypeStruct(s, np.float64) for s in shapes]
        return list(
            jax.pure_callback(
                lambda *given: _computed(library, call, given, shapes), made, *arrays, vmap_method="sequential"
            )
        )
    return list(_computed(library, call, arrays, shapes))


def _computed(
    library: ctypes.CDLL, call: Call, arrays: Sequence[Any], shapes: Sequence[tuple[int, ...]]
) -> list[np.ndarray]:
    # Python's lock is free while the library computes.
    given = [np.ascontiguousarray(array) for array in arrays]
    results = [np.empty(s) for s in shapes]
    addresses = (ctypes.c_void_p * len(results))(*(r.ctypes.data for r in results))
    entry = getattr(library, f"sysid_{call.entry}")
    entry.restype = ctypes.c_char_p
    kept = [(ctypes.c_int64 * a.ndim)(*a.shape) for a in given]
    passed = (_Array * len(given))(
        *(_Array(a.ctypes.data, of_array, a.ndim) for a, of_array in zip(given, kept, strict=True))
    )
    problem = entry(passed, ctypes.c_int64(len(given)), ctypes.byref(_settings(call)), addresses)
    if problem is not None:
        words = problem.decode("ascii")
        raise MemoryError(words) if words == NO_MEMORY else ValueError(words)
    return results


def _settings(call: Call) -> _Settings:
    def passed(value: Any, kind: type) -> Any:
        return _AxleList((ctypes.c_int64 * len(value))(*value), len(value)) if kind is list else kind(value)

    return _Settings(**{name: passed(call.settings[name], kind) for name, kind in SETTINGS.items()})
