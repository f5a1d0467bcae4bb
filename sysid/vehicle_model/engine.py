"""Which engine integrates the vehicle: C++, compiled for this machine or prebuilt in the wheel, else JAX.

Both keep one protocol (:mod:`sysid.vehicle_model.engines.protocol`) with the same results to rounding. ``SYSID_ENGINE``
chooses: `auto` (the default) takes the native engine if it is available, `native` requires it, and `reference` (or
`jax`) takes the other one. The choice is made here, where a road is prepared, and nowhere else.
"""

from __future__ import annotations

import logging
import os
from functools import cache

import jax
import numpy as np

from sysid.errors import SysidError
from sysid.vehicle_model.contact import EffectiveRoad
from sysid.vehicle_model.engines.native import NATIVE
from sysid.vehicle_model.engines.protocol import Engine, Timing, WheelRoad
from sysid.vehicle_model.engines.reference import REFERENCE
from sysid.vehicle_model.motion import Motion
from sysid.vehicle_model.native import kernel
from sysid.vehicle_model.native.build import BuildError
from sysid.vehicle_model.stacked_matrices import StackedMatrices

_LOGGER = logging.getLogger(__name__)
_CHOICES = ("auto", "native", "reference", "jax")

__all__ = ["Timing", "WheelRoad", "engine_name", "engine_of_process", "engine_versions", "wheel_road"]


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
    problem = _problem(coordinates)
    if problem is None:
        return NATIVE
    if choice == "native":
        raise SysidError(f"The native engine cannot be used: {problem}; set SYSID_ENGINE=auto to do without it.")
    _say_once(problem)
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
def _say_once(problem: str) -> None:
    _LOGGER.warning(
        "The native engine cannot be used: %s. JAX computes instead: the same results, but a simulation takes about "
        "twelve times as long. Install a C++ compiler (Debian, Ubuntu: apt install g++; without administrator: pip "
        "install ziglang), or set SYSID_ENGINE=reference to go without this note.",
        problem,
    )


@cache
def _problem(coordinates: int | None) -> str | None:
    """Why the native engine cannot be used here, None if it can."""
    if jax.default_backend() != "cpu":
        return f"JAX computes on {jax.default_backend()} here"
    try:
        kernel.prepare(coordinates)
    except BuildError as error:
        return str(error)
    return None


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
