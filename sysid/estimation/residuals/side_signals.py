"""What sensors on one side show of roll: their lever times the difference between left and right.

A sensor at y to the left of the middle reads the mean plus y times a roll: of the body over the axle for a deflection,
its acceleration for an accelerometer. The planar simulation has the mean; the difference is that of
:mod:`sysid.vehicle_model.roll` at the parameters and motions of the fit, and taken from the readings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.arrays import Parameters
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.residuals.rolling_runs import PlanarRuns, RollingRuns
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.side_unknowns import (
    LEVER,
    SideUnknown,
    levers_m,
    show_roll,
)
from sysid.threads import side_by_side
from sysid.vehicle_model.contact import RoadRise
from sysid.vehicle_model.engine import Timing
from sysid.vehicle_model.filters import discretise
from sysid.vehicle_model.roll import (
    RollMotion,
    through_filter,
)

#: Largest step of the roll [s].
STEP_S = 0.0025
#: Columns that are made together: those of all unknowns would fill the memory.
_TOGETHER = 12


@dataclass(frozen=True)
class SideSignals:
    """What the channels of one group show of roll.

    `shown` (T, R, C) in SI, and derivatives `columns` (T, R, n, q) by the unknowns, of the n `channels` on one side;
    `rise`: what the mean road must have more for the tires of both sides, and its derivatives `rise_columns`
    (q, R, na, m) [m].
    """

    shown: np.ndarray
    channels: np.ndarray
    columns: np.ndarray
    rise: RoadRise
    rise_columns: np.ndarray


def with_sides(model: BumpModel, log_parameters: Parameters, motion: RunMotion) -> BumpModel:
    """The model as its truck rolls; itself where no sensor on one side shows roll.

    Its roads are raised by what tires of unlike sides make of the mean (:meth:`RollingRuns.rise`), and its readings are
    less what sensors on one side show of roll. The rise follows the motion over the road as it is at first, then that
    over the raised road.

    Parameters
    ----------
    model : its `sides` say how left and right differ from usual.
    log_parameters, motion : (p,), and of every run.
    """
    bumps = {p.bump for passes in model.passes for p in passes}
    if not show_roll(model.layout, model.felt, bumps):
        return model

    def made(model: BumpModel) -> list[SideSignals]:
        def one(position: int) -> SideSignals:
            return side_signals(model, position, log_parameters, motion, ())

        return list(side_by_side(one, range(len(model.groups))))

    def on_raised(signals: Sequence[SideSignals]) -> BumpModel:
        rises = tuple(s.rise for s in signals)
        return replace(model, rises=rises).on_roads(model.roads)

    found = made(on_raised(made(model)))
    arrays = zip(model.arrays, model.groups, found, strict=True)
    return replace(
        on_raised(found), arrays=tuple(old._replace(value=group.value - s.shown) for old, group, s in arrays)
    )


def side_signals(
    model: BumpModel,
    position: int,
    log_parameters: Parameters,
    motion: RunMotion,
    unknowns: Sequence[SideUnknown],
) -> SideSignals:
    """Roll in the channels of one group, and its derivatives by unknowns of left and right.

    Parameters
    ----------
    log_parameters, motion : (p,), and of every run of the campaign.
    unknowns : q of them, none for the signals alone.
    """
    group, shape = model.groups[position], model.shapes[position]
    levers = levers_m(model.layout, model.felt.vehicle)
    channels = np.flatnonzero(levers)
    columns_of = np.array([model.layout.sensors[c].column for c in channels])
    # The samples of the model: fewer than those of the records where only some of them are used.
    shown = np.zeros((shape.samples, *group.value.shape[1:]))
    columns = np.zeros((shape.samples, len(group.runs), channels.size, len(unknowns)))
    cases = [p.load_case for p in model.passes[position]]
    station = _stations(model, position, motion)
    height = np.zeros((len(cases), len(model.felt.vehicle.axles), station.size))
    height_columns = np.zeros((len(unknowns), *height.shape))
    for case in dict.fromkeys(cases):
        rows = np.array([r for r, of_run in enumerate(cases) if of_run == case])
        runs = _rolling(model, position, rows, log_parameters, motion)
        height[rows] = runs.rise(station)
        parts = _signals(model, position, runs, runs.base)[..., 0]
        shown[:, rows[:, None], channels] = parts
        for first in range(0, len(unknowns), _TOGETHER):
            some = unknowns[first : first + _TOGETHER]
            moved = runs.roll(np.stack([runs.derivative(u) for u in some], axis=-1))
            made = _signals(model, position, runs, moved)
            for j, u in enumerate(some):
                if u.kind == LEVER:
                    made[..., j] = parts * (columns_of == u.of)
            columns[:, rows, :, first : first + len(some)] = made
            height_columns[first : first + len(some), rows] = runs.rise_columns(station, some, moved)
    return SideSignals(shown, channels, columns, RoadRise(station, height), height_columns)


def _stations(model: BumpModel, position: int, motion: RunMotion) -> np.ndarray:
    """Stations of the road of a group, up to where its front axles are in the end [m]."""
    road, shape = model.roads[position], model.shapes[position]
    along = motion.of(list(model.groups[position].runs))
    last = float(np.max(along.mean_speed_m_s * (shape.samples * shape.interval_s - along.start_s)))
    first, step = road.station_m[0], road.step_m
    return np.asarray(first + step * np.arange(max(road.station_m.size, int((last - first) / step))))


def _every(interval_s: float) -> int:
    """Steps of the roll per sample."""
    return max(1, int(np.ceil(interval_s / STEP_S - 1e-9)))


def _rolling(
    model: BumpModel, position: int, rows: np.ndarray, log_parameters: Parameters, motion: RunMotion
) -> RollingRuns:
    """Roll of some runs of one load case in one group, on steps of at most :data:`STEP_S`."""
    shape, arrays, every = model.shapes[position], model.arrays[position], _every(model.shapes[position].interval_s)
    planar = PlanarRuns(
        passes=model.passes[position],
        rows=rows,
        felt=model.felt,
        tracks=model.felt,
        matrices=arrays.matrices,
        road=model.roads[position],
        laws=arrays.laws,
        axle_x=arrays.axle_x,
        motion=motion.of(list(model.groups[position].runs)),
        timing=Timing((shape.samples - 1) * every + 1, shape.interval_s / every, 1),
        sides=model.sides,
        rise=model.rises[position] if model.rises else None,
    )
    return RollingRuns(planar, log_parameters)


def _signals(model: BumpModel, position: int, runs: RollingRuns, made: RollMotion) -> np.ndarray:
    """What the channels on one side show (T', R, n, Q) of a roll, at the samples of the records."""
    shape, bodies = model.shapes[position], runs.system.bodies
    every = _every(shape.interval_s)
    levers = levers_m(model.layout, model.felt.vehicle)
    result = []
    recursion = shape.filter
    low_pass = None if recursion is None else discretise(recursion, shape.interval_s / every)
    for c in np.flatnonzero(levers):
        sensor = model.layout.sensors[c]
        if sensor.kind == "axle_acceleration":
            assert sensor.axle is not None
            shown = made.acceleration[:, bodies + sensor.axle]
        elif sensor.kind == "body_acceleration":
            shown = made.acceleration[:, sensor.body or 0]
        else:
            assert sensor.axle is not None
            body = runs.system.body_of[sensor.axle]
            shown = made.angle[:, body] - made.angle[:, bodies + sensor.axle]
        factor = runs.factor(LEVER, 0, None, sensor.column)
        result.append(levers[c] * factor * through_filter(low_pass, shown)[::every])
    return np.stack(result, axis=2)
