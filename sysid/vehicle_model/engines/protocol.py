"""Protocol of an engine of the time integration, and its input and output records.

An engine prepares the road of a group of runs in its own form. Code that has a prepared road calls the engine through
it, and need not know which engine it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, Protocol

import jax

from sysid.vehicle_model.contact import EffectiveRoad, TireLaw
from sysid.vehicle_model.device_arrays import ChannelHistories, HostOrDevice, ParametersBySets, RunsBySets
from sysid.vehicle_model.filters import FilterRecursion
from sysid.vehicle_model.motion import Motion, MotionChange
from sysid.vehicle_model.readings import Readings
from sysid.vehicle_model.simulation import Histories, SensorLayout
from sysid.vehicle_model.stacked_matrices import StackedMatrices
from sysid.vehicle_model.suspension import SuspensionLaw

#: Suspension and tire laws of all runs and sets, as a function of parameters (p, S).
LawFunction = Callable[[ParametersBySets], tuple[SuspensionLaw, TireLaw]]


class Timing(NamedTuple):
    """Samples of a run, their interval [s], and integration steps per sample."""

    samples: int
    interval_s: float
    substeps: int


class Unknowns(NamedTuple):
    """A parameter set, and P directions in which parameters and motions of the runs move from it.

    `value` (p,) parameters; `parameters` (p, P) and `motion` (R, P) derivatives with respect to the P unknowns.
    """

    value: HostOrDevice
    parameters: HostOrDevice
    motion: MotionChange


class Linearisation(NamedTuple):
    """Residuals of R runs and their derivatives by P unknowns.

    `residual` (T, R, C) and `gain_residual` (R, C) with derivatives (..., P), and `simulated` (T, R, C) sensor signals
    in SI.
    """

    residual: HostOrDevice
    residual_jacobian: HostOrDevice
    gain_residual: HostOrDevice
    gain_jacobian: HostOrDevice
    simulated: HostOrDevice


class Columns(NamedTuple):
    """K columns A beside the residuals of R runs: `residual` (T, R, C, K) and `gain` (R, C, K)."""

    residual: HostOrDevice
    gain: HostOrDevice


@partial(jax.tree_util.register_dataclass, data_fields=["prepared", "motion"], meta_fields=["engine", "edged"])
@dataclass(frozen=True)
class WheelRoad:
    """The road that the wheels of R runs meet, prepared by the engine that can use it.

    `motion` of the runs, (R, 1); `prepared` is the engine's own; `edged` as for EffectiveRoad.
    """

    engine: Engine
    prepared: Any
    motion: Motion
    edged: bool = False


class Engine(Protocol):
    """Integrates R runs with S parameter sets; all engines give the same results to rounding.

    Arrays are those of the host, and so are the results of the native engine; or those of JAX, also while it traces a
    function.
    """

    @property
    def name(self) -> str:
        """Its name in settings and results."""

    def takes(self, matrices: StackedMatrices) -> bool:
        """Whether it can integrate vehicles of this size."""

    def prepare(self, road: EffectiveRoad, axle_x: HostOrDevice, motion: Motion, timing: Timing) -> WheelRoad:
        """The road of runs with axles at `axle_x` (na, 1) [m], at motions (R, 1)."""

    def sensors(
        self,
        matrices: StackedMatrices,
        suspension: SuspensionLaw,
        tire: TireLaw,
        road: WheelRoad,
        timing: Timing,
        layout: SensorLayout,
        recursion: FilterRecursion | None,
    ) -> ChannelHistories:
        """Sensor signals (T, R, C, S) through the filter, see :func:`sysid.vehicle_model.simulate_sensors`."""

    def histories(
        self, matrices: StackedMatrices, suspension: SuspensionLaw, tire: TireLaw, road: WheelRoad, timing: Timing
    ) -> Histories:
        """Unfiltered histories, see :func:`sysid.vehicle_model.simulate_histories`."""

    def linearise(
        self,
        matrices: StackedMatrices,
        laws: LawFunction,
        unknowns: Unknowns,
        road: WheelRoad,
        timing: Timing,
        layout: SensorLayout,
        recursion: FilterRecursion | None,
        readings: Readings,
    ) -> Linearisation:
        """Residuals of one parameter set and their exact derivatives by P unknowns."""

    def misfits(
        self,
        matrices: StackedMatrices,
        suspension: SuspensionLaw,
        tire: TireLaw,
        road: WheelRoad,
        timing: Timing,
        layout: SensorLayout,
        recursion: FilterRecursion | None,
        readings: Readings,
        columns: Columns,
    ) -> tuple[RunsBySets, HostOrDevice]:
        """Squares r'r of the residuals of every run and set (R, S), and their products A'r with columns (R, K, S)."""
