"""Derivatives of the residuals by masses and departures from the model.

Both are differences of whole simulations.  The sensors' offset and gain are eliminated and the weights applied as
everywhere else, so the columns stand beside those of the parameters.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from itertools import islice
from typing import NamedTuple

import numpy as np

from sysid.arrays import Parameters
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.residuals.by_group import ByGroup, too_many
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RUN_UNKNOWNS, RunMotion
from sysid.estimation.residuals.signals import TOGETHER, simulate_trials
from sysid.threads import side_by_side
from sysid.vehicle_model.engines.protocol import Linearisation
from sysid.vehicle_model.readings import residuals_of_trials

#: Step of the derivatives: a share of a mass, or the amplitude of a departure.  Where a run just reaches a stop, the
#: derivatives are others on either side.  A search can end that near to such a corner, so a step that is a thousand
#: times larger may cross it.  Derivatives from different sides contradict each other: together they seem to tell what
#: no motion shows, the common error of a scale for one.  Rounding is 1e-6 of a derivative.
STEP = 1e-7


class ResidualColumns(NamedTuple):
    """Derivatives of the residuals (T, R, C, m) and gain residuals (R, C, m) of a group by m amplitudes."""

    residual: np.ndarray
    gain: np.ndarray

    @property
    def by_channel(self) -> np.ndarray:
        """A view of the derivatives of the residuals, (R, C, m, T)."""
        return np.moveaxis(self.residual, 0, -1)

    def set_difference(self, column: int, there: TrialResiduals, here: TrialResiduals, step: float, run: int) -> None:
        """Set one column of a run to the difference of two trials over the step between them."""
        # In place: the arrays are larger than the processor's cache.
        of_run = self.by_channel[run, :, column]
        np.subtract(there.residual[run], here.residual[run], out=of_run)
        of_run /= step
        self.gain[run, :, column] = (there.gain[run] - here.gain[run]) / step


class TrialResiduals(NamedTuple):
    """Weighted residuals (R, C, T) and gain residuals (R, C) of a group for one of several models."""

    residual: np.ndarray
    gain: np.ndarray


def empty_columns(model: BumpModel, count: int) -> tuple[ResidualColumns, ...]:
    """Zero columns of every group for `count` amplitudes; the samples of a channel lie next to each other."""
    shapes = [arrays.value.shape for arrays in model.arrays]
    return tuple(
        ResidualColumns(np.moveaxis(np.zeros((*s[1:], count, s[0])), -1, 0), np.zeros((*s[1:], count))) for s in shapes
    )


def trial_residuals(
    model: BumpModel, weights: Weights, trials: Iterable[BumpModel], log_parameters: Parameters, motion: RunMotion
) -> Iterator[tuple[TrialResiduals, ...]]:
    """Residuals of every group for each of several models of the runs whose readings `model` holds."""

    def shown(position: int, signals: np.ndarray) -> list[TrialResiduals]:
        scales = weights.noise_sd[position], weights.tempering[position]
        residual, gain = residuals_of_trials(weights.on(model.arrays, position).readings(*scales), signals)
        return [TrialResiduals(r, g) for r, g in zip(residual, gain, strict=True)]

    return simulate_trials(trials, log_parameters, motion, shown)


def signal_residuals(
    model: BumpModel, weights: Weights, signals: Sequence[np.ndarray]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Weighted residuals (T, R, C) and gain residuals (R, C) of every group for sensor signals (T, R, C) [SI]."""
    return [residuals_of_group(model, weights, position, shown) for position, shown in enumerate(signals)]


def residuals_of_group(
    model: BumpModel, weights: Weights, position: int, signals: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Weighted residuals (T, R, C) and gain residuals (R, C) of one group for sensor signals (T, R, C) [SI]."""
    scales = weights.noise_sd[position], weights.tempering[position]
    readings = weights.on(model.arrays, position).readings(*scales)
    residual, gain = residuals_of_trials(readings, signals[:, :, None])
    return np.moveaxis(residual[0], -1, 0), gain[0]


def difference_columns(
    model: BumpModel,
    start: BumpModel,
    weights: Weights,
    log_parameters: Parameters,
    motion: RunMotion,
    trials: Sequence[tuple[BumpModel, float]],
) -> Sequence[ResidualColumns]:
    """Forward differences of every group's residuals by amplitudes, made when they are asked for if they are too many.

    Parameters
    ----------
    model : holds the readings; start : the same runs from which the trials differ.
    log_parameters : (p,); motion : of all runs.
    trials : per amplitude the same runs with that amplitude moved, and by how much.
    """
    if too_many(model, len(trials)):

        def of(position: int) -> ResidualColumns:
            known = weights.part(position), log_parameters, motion
            parts = [(trial.part(position), step) for trial, step in trials]
            return difference_columns(model.part(position), start.part(position), *known, parts)[0]

        return ByGroup(len(model.groups), of)
    columns = empty_columns(model, len(trials))
    if not trials:
        return columns
    models = [start, *(trial for trial, _ in trials)]
    residuals = trial_residuals(model, weights, models, log_parameters, motion)
    base = next(residuals)
    set_differences(columns, base, residuals, [[Difference(k, step)] for k, (_, step) in enumerate(trials)])
    return columns


class Difference(NamedTuple):
    """A column that a trial gives: which one, the step of its amplitude, and in which runs (R,) of each group."""

    column: int
    step: float
    runs: Sequence[np.ndarray] | None = None


def set_differences(
    columns: Sequence[ResidualColumns],
    base: Sequence[TrialResiduals],
    trials: Iterator[tuple[TrialResiduals, ...]],
    differences: Iterable[Sequence[Difference]],
) -> None:
    """Set columns of every group to the differences of trials from `base` over their steps.

    Parameters
    ----------
    trials, differences : of every trial its residuals, and the columns that it gives.
    """
    pairs = zip(trials, differences, strict=True)

    def of_group(some: Sequence[tuple[tuple[TrialResiduals, ...], Sequence[Difference]]], position: int) -> None:
        here = base[position]
        for moved, given in some:
            for column, step, chosen in given:
                there = moved[position]
                for run in range(len(there.residual)) if chosen is None else np.flatnonzero(chosen[position]):
                    columns[position].set_difference(column, there, here, step, int(run))

    while some := tuple(islice(pairs, TOGETHER)):
        side_by_side(partial(of_group, some), range(len(columns)))


def channel_columns(
    linearisation: Linearisation,
    run: int,
    channel: int,
    *kinds: ResidualColumns,
    clocks: ResidualColumns | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (T, p + m + l) of a channel's residuals, (p + m + l,) of its gain, m further columns among them.

    They stand between the derivatives by the parameters and those by the run's own unknowns: its motion, then its
    clocks. One channel at a time: joined columns of whole runs fill the memory of a small computer.
    """
    rows, gain = linearisation.residual_jacobian[:, run, channel], linearisation.gain_jacobian[run, channel]
    more, of_gain = [k.residual[:, run, channel] for k in kinds], [k.gain[run, channel] for k in kinds]
    last, of_last = ([], []) if clocks is None else ([clocks.residual[:, run, channel]], [clocks.gain[run, channel]])
    return (
        np.concatenate([rows[:, :-RUN_UNKNOWNS], *more, rows[:, -RUN_UNKNOWNS:], *last], axis=1),
        np.concatenate([gain[:-RUN_UNKNOWNS], *of_gain, gain[-RUN_UNKNOWNS:], *of_last]),
    )
