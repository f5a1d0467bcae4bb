"""Sensor signals of all runs for a simulation."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import groupby, islice
from typing import TypeVar

import jax
import numpy as np

from sysid.arrays import Parameters
from sysid.estimation.parameters.axle_laws import axle_laws, laws_side_by_side
from sysid.estimation.residuals.bump_model import BumpModel, GroupArrays, GroupShape
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.threads import side_by_side
from sysid.vehicle_model import engine
from sysid.vehicle_model.contact import EffectiveRoad, roads_side_by_side
from sysid.vehicle_model.device_arrays import ChannelHistories, ParametersBySets
from sysid.vehicle_model.engine import WheelRoad
from sysid.vehicle_model.stacked_matrices import runs_side_by_side

_Shown = TypeVar("_Shown")
#: What becomes of the signals (T, R, K, C) of a group, by its position, in runs of K models: one result each.
Shown = Callable[[int, np.ndarray], Sequence[_Shown]]

#: Trial models that are simulated in one call: a vector register of the native engine holds the same run of all.
TOGETHER = 8


def wheel_road(arrays: GroupArrays, road: EffectiveRoad, motion: RunMotion, shape: GroupShape) -> WheelRoad:
    """The road of a group whose runs move as `motion` (R,) says, for the engine of this process."""
    return engine.wheel_road(arrays.matrices, road, arrays.axle_x, motion.along_road(arrays.axle_x), shape.timing)


def simulate_group(
    arrays: GroupArrays, shape: GroupShape, log_parameters: ParametersBySets, road: WheelRoad
) -> ChannelHistories:
    """Filtered sensor signals (T, R, C, S) of one group for log parameters (p, S)."""
    suspension, tire = axle_laws(arrays.laws, log_parameters)
    return road.engine.sensors(arrays.matrices, suspension, tire, road, shape.timing, shape.sensors, shape.recursion)


def simulate_runs(model: BumpModel, log_parameters: Parameters, motion: RunMotion) -> tuple[np.ndarray, ...]:
    """Sensor signals (T, R, C) of every group in SI at log parameters (p,)."""

    def one(position: int) -> np.ndarray:
        runs = list(model.groups[position].runs)
        arrays, shape = model.arrays[position], model.shapes[position]
        road = wheel_road(arrays, model.roads[position], motion.of(runs), shape)
        return np.asarray(simulate_group(arrays, shape, log_parameters[:, None], road))[..., 0]

    return side_by_side(one, range(len(model.groups)))


def simulate_trials(
    trials: Iterable[BumpModel], log_parameters: Parameters, motion: RunMotion, shown: Shown[_Shown]
) -> Iterator[tuple[_Shown, ...]]:
    """What is made of the sensor signals [SI] of every group, for each of several models of the same runs.

    Masses, laws and roads of the models may differ. Those of one structure are simulated together; no more than
    :data:`TOGETHER` models are in memory at a time.

    Parameters
    ----------
    shown : called by the thread that simulated a group; :func:`each` for the signals (T, R, C) themselves.
    """
    for _, alike in groupby(trials, key=_structure):
        while some := list(islice(alike, TOGETHER)):
            made = _simulate_together(some, log_parameters, motion, shown)
            for k in range(len(some)):
                yield tuple(of_group[k] for of_group in made)


def each(_: int, signals: np.ndarray) -> Sequence[np.ndarray]:
    """Signals (T, R, C) of single models."""
    return [signals[:, :, k] for k in range(signals.shape[2])]


def _structure(model: BumpModel) -> object:
    """What must be equal for models to be simulated together."""
    varied = [(a.matrices, a.laws, road) for a, road in zip(model.arrays, model.roads, strict=True)]
    leaves, structure = jax.tree.flatten(varied)
    stations = [(float(road.first_station_m), float(road.step_m)) for road in model.roads]
    places = [a.axle_x.tolist() for a in model.arrays]
    return structure, [np.shape(leaf) for leaf in leaves], stations, places, model.shapes


def _simulate_together(
    models: Sequence[BumpModel], log_parameters: Parameters, motion: RunMotion, shown: Shown[_Shown]
) -> tuple[Sequence[_Shown], ...]:
    """What is made of the signals of every group for K models of one structure."""

    def one(position: int) -> Sequence[_Shown]:
        shape, runs = models[0].shapes[position], list(models[0].groups[position].runs)
        arrays = [m.arrays[position] for m in models]
        matrices = jax.tree.map(lambda *parts: runs_side_by_side(parts), *[a.matrices for a in arrays])
        road = roads_side_by_side([m.roads[position] for m in models])
        moved = motion.of([run for run in runs for _ in models])
        wheels = wheel_road(arrays[0]._replace(matrices=matrices), road, moved, shape)
        law = laws_side_by_side([a.laws for a in arrays], [log_parameters[:, None]] * len(models))
        signals = wheels.engine.sensors(matrices, *law, wheels, shape.timing, shape.sensors, shape.recursion)
        return shown(position, np.asarray(signals).reshape(shape.samples, len(runs), len(models), -1))

    return side_by_side(one, range(len(models[0].groups)))
