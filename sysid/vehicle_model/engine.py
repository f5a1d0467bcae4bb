"""Which engine integrates the vehicle: C++, compiled for this machine or prebuilt in the wheel, else JAX.

Both keep one protocol (:mod:`sysid.vehicle_model.engines.protocol`) with the same results to rounding. ``SYSID_ENGINE``
chooses: `auto` (the default) takes the native engine if it is available, `native` requires it, and `reference` (or
`jax`) takes the other one. The choice is made here, where a road is prepared, and nowhere else.
"""

from __future__ import annotations

import logging
import os
from contextlib import AbstractContextManager, nullcontext
from functools import cache

import numpy as np

from sysid.campaign.vehicle_records import Vehicle
from sysid.errors import SysidError
from sysid.runtime import platform_of_process
from sysid.vehicle_model.assembly import body_coordinates
from sysid.vehicle_model.contact import EffectiveRoad
from sysid.vehicle_model.engines.native import NATIVE
from sysid.vehicle_model.engines.protocol import Engine, Timing, WheelRoad
from sysid.vehicle_model.engines.reference import REFERENCE
from sysid.vehicle_model.motion import Motion
from sysid.vehicle_model.native import ahead, kernel
from sysid.vehicle_model.native.buffers import COORDINATES
from sysid.vehicle_model.native.build import BuildError
from sysid.vehicle_model.stacked_matrices import StackedMatrices

_LOGGER = logging.getLogger(__name__)
_CHOICES = ("auto", "native", "reference", "jax")

#: What is lost without the native engine, and how to get it back: with JAX on the processor and on another device.
_COMPILER = (
    "a likelihood takes about fifteen times as long, and the derivatives of the fit a hundred times. Install a C++ "
    "compiler (Debian, Ubuntu: apt install g++; without administrator: pip install ziglang)"
)
_DEVICE = (
    "steps of so few numbers are slow there. Unset JAX_PLATFORMS, or make the processor JAX's default device "
    "(jax.config.update('jax_default_device', jax.devices('cpu')[0]))"
)

__all__ = [
    "Timing",
    "WheelRoad",
    "compiled_ahead",
    "engine_name",
    "engine_of_process",
    "engine_versions",
    "wheel_road",
]


def engine_of_process(coordinates: int | None = None) -> Engine:
    """The engine of this process, for vehicles that it takes.

    Parameters
    ----------
    coordinates : number of body coordinates that it has to be there for; None: any.

    Raises
    ------
    SysidError
        If SYSID_ENGINE names no engine, or requires the native one and it is not available.
    """
    choice = os.environ.get("SYSID_ENGINE", "auto")
    if choice not in _CHOICES:
        raise SysidError(f"SYSID_ENGINE is '{choice}'; set it to auto, native or reference.")
    if choice in ("reference", "jax"):
        return REFERENCE
    platform = platform_of_process()
    problem = _problem(coordinates) if platform == "cpu" else f"JAX computes on {platform} here"
    if problem is None:
        return NATIVE
    if choice == "native":
        raise SysidError(f"The native engine cannot be used: {problem}; set SYSID_ENGINE=auto to do without it.")
    _say_once(problem, _COMPILER if platform == "cpu" else _DEVICE)
    return REFERENCE


def engine_name() -> str:
    """Name of the engine of this process (raises as :func:`engine_of_process`)."""
    return engine_of_process().name


def engine_versions() -> dict[str, str]:
    """Name of the engine of this process and, of the native one, which build it is; raises as above.

    Builds of other compilers and for other processors differ by rounding.
    """
    engine = engine_of_process()
    return {"engine": engine.name} | ({"engine_build": kernel.prepare()} if engine is NATIVE else {})


@cache
def _say_once(problem: str, loss_and_remedy: str) -> None:
    _LOGGER.warning(
        "The native engine cannot be used: %s. JAX computes instead: the same results, but %s, or set "
        "SYSID_ENGINE=reference to go without this note.",
        problem,
        loss_and_remedy,
    )


@cache
def _problem(coordinates: int | None) -> str | None:
    """Why the native engine cannot be used on this machine's processor, None if it can."""
    try:
        kernel.prepare(coordinates)
    except BuildError as error:
        return str(error)
    return None


def compiled_ahead(vehicle: Vehicle, *, parts: bool) -> AbstractContextManager[None]:
    """While a block runs, compile the native engine for a vehicle, unless it is there or is not to be used.

    Parameters
    ----------
    parts : also for one that has a bending frame more, as the search for undeclared parts tries.
    """
    if os.environ.get("SYSID_ENGINE", "auto") not in ("auto", "native"):
        return nullcontext()
    number = body_coordinates(vehicle)
    return ahead.compiled_ahead([n for n in (number, number + 1)[: 1 + parts] if n in COORDINATES])


def wheel_road(
    matrices: StackedMatrices,
    road: EffectiveRoad,
    axle_x: np.ndarray,
    motion: Motion,
    timing: Timing,
) -> WheelRoad:
    """The road of R runs at motions (R, 1), prepared by the engine of this process.

    Vehicles that this engine does not take get the reference engine.
    """
    taken = NATIVE.takes(matrices)
    engine = engine_of_process(matrices.body_rows.shape[2] if taken else None)
    return (engine if taken else REFERENCE).prepare(road, axle_x, motion, timing)
