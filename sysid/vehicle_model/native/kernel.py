"""Loads the compiled engine and calls its entry points with arrays that are checked against their description."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from sysid.threads import thread_count
from sysid.vehicle_model.native import header
from sysid.vehicle_model.native.buffers import ENTRIES, in_order, shape
from sysid.vehicle_model.native.build import BuildError, library


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


_lock = threading.Lock()


@cache
def _registered() -> str:
    path = library()
    try:
        loaded = ctypes.CDLL(str(path))
    except OSError as error:
        raise BuildError(f"the compiled engine cannot be loaded ({error})") from error
    check_fingerprint(loaded)
    loaded.sysid_use_threads(ctypes.c_int64(thread_count()))
    prefix = f"sysid_{path.parent.name}"
    for entry in ENTRIES:
        jax.ffi.register_ffi_target(
            f"{prefix}_{entry}", jax.ffi.pycapsule(getattr(loaded, f"sysid_{entry}")), platform="cpu"
        )
    return prefix


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


def prepare() -> None:
    """Build and load the engine if that has not been done.

    Raises
    ------
    BuildError
        If there is none to be had on this machine.
    """
    with _lock:
        _registered()


def run(call: Call) -> list[jax.Array]:
    """Results of a call.

    Raises
    ------
    ValueError
        If an array is missing, is not known, or has another shape or type than described.
    """
    results = [jax.ShapeDtypeStruct(shape(b, call.sizes), np.float64) for b in ENTRIES[call.entry].results]
    entry = jax.ffi.ffi_call(f"{_registered()}_{call.entry}", results)
    return list(entry(*map(jnp.asarray, call.ordered()), **call.settings))
