"""The engine in JAX: runs wherever JAX does, differentiable from outside, a motion per parameter set if wanted."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.tree_util import Partial

from sysid.vehicle_model import simulation
from sysid.vehicle_model.contact import EffectiveRoad, RoadInput, TireLaw, road_input
from sysid.vehicle_model.device_arrays import (
    ChannelHistories,
    HostOrDevice,
    ParametersBySets,
    RunsByChannelsBySets,
    RunsBySets,
)
from sysid.vehicle_model.engines.protocol import (
    Columns,
    LawFunction,
    Linearisation,
    Timing,
    Unknowns,
    WheelRoad,
)
from sysid.vehicle_model.filters import FilterRecursion
from sysid.vehicle_model.motion import Motion, MotionChange
from sysid.vehicle_model.readings import Readings, standardised_residuals
from sysid.vehicle_model.simulation import Histories, SensorLayout, stage_times
from sysid.vehicle_model.stacked_matrices import StackedMatrices
from sysid.vehicle_model.suspension import SuspensionLaw


class _Course(NamedTuple):
    """The road at every half step, at the speed that is held; over edges also the roads and `axle_x` (na, 1) [m]."""

    road: RoadInput
    edged: tuple[EffectiveRoad, HostOrDevice] | None


@partial(jax.jit, static_argnames=("timing",))
def _looked_up(road: EffectiveRoad, axle_x: HostOrDevice, motion: Motion, *, timing: Timing) -> RoadInput:
    times = stage_times(timing.samples, timing.interval_s, timing.substeps)[:, None, None]
    return road_input(road, motion.travelled(times)[:, :, None] - axle_x)


@dataclass(frozen=True)
class ReferenceEngine:
    """The pure JAX twin; see :class:`sysid.vehicle_model.engines.protocol.Engine`.

    The road is looked up at every half step before the time loop.  Motions may be (R, S), one per parameter set.  Every
    method is compiled once for each timing, sensor layout and shape of its arrays.
    """

    name: str = "reference"

    def takes(self, matrices: StackedMatrices) -> bool:
        """Vehicles of any size."""
        return True

    def prepare(self, road: EffectiveRoad, axle_x: HostOrDevice, motion: Motion, timing: Timing) -> WheelRoad:
        """The road at every half step."""
        looked_up = _looked_up(road, axle_x, motion, timing=timing)
        return WheelRoad(self, _Course(looked_up, (road, axle_x) if road.edged else None), motion, road.edged)

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
        """Filtered sensor signals (T, R, C, S)."""
        return _sensors(
            matrices, suspension, tire, road.motion, road, timing=timing, layout=layout, recursion=recursion
        )

    def histories(
        self, matrices: StackedMatrices, suspension: SuspensionLaw, tire: TireLaw, road: WheelRoad, timing: Timing
    ) -> Histories:
        """Unfiltered histories."""
        found: Histories = _histories(matrices, suspension, tire, road, timing=timing)
        return found

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
        """Forward-mode derivatives: one tangent for each unknown."""
        traceable = laws if isinstance(laws, Partial) else Partial(laws)
        found: Linearisation = _linearise(
            matrices, traceable, unknowns, road, readings, timing=timing, layout=layout, recursion=recursion
        )
        return found

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
        """r'r and A'r."""
        found: tuple[RunsBySets, HostOrDevice] = _misfits(
            matrices, suspension, tire, road, readings, columns, timing=timing, layout=layout, recursion=recursion
        )
        return found


@partial(jax.jit, static_argnames=("timing",))
def _histories(
    matrices: StackedMatrices, suspension: SuspensionLaw, tire: TireLaw, road: WheelRoad, *, timing: Timing
) -> Histories:
    return simulation.simulate_histories(
        matrices,
        suspension,
        tire,
        road.motion,
        road.prepared.road,
        interval_s=timing.interval_s,
        substeps=timing.substeps,
        at_wheels=_at_wheels(road),
    )


@partial(jax.jit, static_argnames=("timing", "layout", "recursion"))
def _linearise(
    matrices: StackedMatrices,
    laws: LawFunction,
    unknowns: Unknowns,
    road: WheelRoad,
    readings: Readings,
    *,
    timing: Timing,
    layout: SensorLayout,
    recursion: FilterRecursion | None,
) -> Linearisation:
    def residuals(
        parameters: ParametersBySets, change: MotionChange
    ) -> tuple[ChannelHistories, RunsByChannelsBySets, ChannelHistories]:
        suspension, tire = laws(parameters)
        motion = road.motion._replace(change=change)
        simulated = _sensors(
            matrices, suspension, tire, motion, road, timing=timing, layout=layout, recursion=recursion
        )
        return (*standardised_residuals(readings, simulated), simulated)

    tangents = unknowns.parameters, unknowns.motion
    at = jnp.broadcast_to(unknowns.value[:, None], unknowns.parameters.shape)
    still = jax.tree.map(jnp.zeros_like, unknowns.motion)
    (residual, gain, simulated), (columns, gain_columns, _) = jax.jvp(residuals, (at, still), tangents)
    return Linearisation(residual[..., 0], columns, gain[..., 0], gain_columns, simulated[..., 0])


@partial(jax.jit, static_argnames=("timing", "layout", "recursion"))
def _misfits(
    matrices: StackedMatrices,
    suspension: SuspensionLaw,
    tire: TireLaw,
    road: WheelRoad,
    readings: Readings,
    columns: Columns,
    *,
    timing: Timing,
    layout: SensorLayout,
    recursion: FilterRecursion | None,
) -> tuple[RunsBySets, HostOrDevice]:
    simulated = _sensors(
        matrices, suspension, tire, road.motion, road, timing=timing, layout=layout, recursion=recursion
    )
    residual, gain = standardised_residuals(readings, simulated)
    products = jnp.einsum("trcs,trck->rks", residual, columns.residual)
    products = products + jnp.einsum("rcs,rck->rks", gain, columns.gain)
    return (residual**2).sum(axis=(0, 2)) + (gain**2).sum(axis=1), products


@partial(jax.jit, static_argnames=("timing", "layout", "recursion"))
def _sensors(
    matrices: StackedMatrices,
    suspension: SuspensionLaw,
    tire: TireLaw,
    motion: Motion,
    road: WheelRoad,
    *,
    timing: Timing,
    layout: SensorLayout,
    recursion: FilterRecursion | None,
) -> ChannelHistories:
    return simulation.simulate_sensors(
        matrices,
        suspension,
        tire,
        motion,
        road.prepared.road,
        layout,
        recursion,
        interval_s=timing.interval_s,
        substeps=timing.substeps,
        at_wheels=_at_wheels(road),
    )


def _at_wheels(road: WheelRoad) -> simulation.AtWheels | None:
    """How an edged road is looked up where wheels are."""
    if road.prepared.edged is None:
        return None
    table, axle_x = road.prepared.edged
    return lambda time, ahead: road_input(table, road.motion.travelled(time)[:, None] - axle_x + ahead)


REFERENCE = ReferenceEngine()
