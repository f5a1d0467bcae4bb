"""Loads the compiled engine and calls its entry points with arrays that are checked against their description."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from sysid.threads import thread_count
from sysid.vehicle_model.native import build, header, prebuilt
from sysid.vehicle_model.native.buffers import ENTRIES, in_order, shape
from sysid.vehicle_model.native.build import BuildError


class Call(NamedTuple):
    """A call of an entry point: its arrays by name, the numbers that the symbols of their shapes stand for, and the
    attributes of the struct `Settings` in ``engine.cpp``, by their names there."""

    entry: str
    arrays: Mapping[str, Any]
    sizes: Mapping[str, int]
    settings: Mapping[str, Any]

    def ordered(self) -> list[Any]:
        """The arrays in the order in which they cross, checked (raises ValueError)."""
        return in_order(self.entry, self.arrays, self.sizes)


class _Loaded(NamedTuple):
    """A library that JAX can call: what its entry points are called there, and where it comes from."""

    prefix: str
    origin: str


_lock = threading.Lock()


@cache
def _loaded(coordinates: int | None) -> _Loaded:
    """Compiled for this processor and so many body coordinates where that can be done, else prebuilt."""
    problems = []
    for find in (_compiled, _prebuilt):
        try:
            return find(coordinates)
        except BuildError as error:
            problems.append(str(error))
    raise BuildError(", and ".join(problems))


def _compiled(coordinates: int | None) -> _Loaded:
    path = build.library(coordinates)
    return load(path, path.parent.name, "compiled on this machine")


def _prebuilt(coordinates: int | None) -> _Loaded:
    name, path = prebuilt.library()  # for every number of coordinates
    return load(path, f"{build.source_digest()[:16]}-{name}", f"prebuilt for {name}")


@cache
def load(path: Path, key: str, origin: str) -> _Loaded:
    """Load a library and make its entry points known to JAX, under names with a key of their own.

    Functions that JAX has kept call them by these names.

    Raises
    ------
    BuildError
        If it cannot be loaded, takes other arrays than this version passes, or another interface than that of this
        jaxlib.
    """
    try:
        loaded = ctypes.CDLL(str(path))
    except OSError as error:
        raise BuildError(f"the compiled engine cannot be loaded ({error})") from error
    check_fingerprint(loaded)
    loaded.sysid_use_threads(ctypes.c_int64(thread_count()))
    prefix = f"sysid_{key}"
    for entry in ENTRIES:
        capsule = jax.ffi.pycapsule(getattr(loaded, f"sysid_{entry}"))
        try:
            jax.ffi.register_ffi_target(f"{prefix}_{entry}", capsule, platform="cpu")
        except jax.errors.JaxRuntimeError as error:
            raise BuildError(f"the compiled engine does not fit this jaxlib ({str(error).splitlines()[0]})") from error
    return _Loaded(prefix, origin)


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


def run(call: Call) -> list[jax.Array]:
    """Results of a call.

    Raises
    ------
    ValueError
        If an array is missing, is not known, or has another shape or type than described.
    """
    results = [jax.ShapeDtypeStruct(shape(b, call.sizes), np.float64) for b in ENTRIES[call.entry].results]
    entry = jax.ffi.ffi_call(f"{_loaded(call.sizes['nb']).prefix}_{call.entry}", results)
    return list(entry(*map(jnp.asarray, call.ordered()), **call.settings))
