"""Derivatives of the residuals by the allowances of a fit: mass properties, then departures from the model.

Derivatives by masses are forward differences with the matrices assembled again; their step:
:data:`sysid.estimation.uncertainty.residual_columns.STEP`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.arrays import Parameters
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.residuals.by_group import ByGroup
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.side_signals import side_signals
from sysid.estimation.residuals.signals import each, simulate_runs, simulate_trials
from sysid.estimation.uncertainty.allowances import Allowances
from sysid.estimation.uncertainty.departure_scale import departure_columns
from sysid.estimation.uncertainty.residual_columns import (
    STEP,
    ResidualColumns,
    difference_columns,
    residuals_of_group,
)
from sysid.vehicle_model.contact import RoadRise, raised_along

#: Step of the derivatives by unknowns of left and right, in their standard deviations.
_SIDE_STEP = 0.02


def allowance_columns(
    model: BumpModel,
    allowances: Allowances,
    weights: Weights,
    log_parameters: Parameters,
    motion: RunMotion,
    amounts: np.ndarray | None = None,
) -> tuple[Sequence[ResidualColumns], Sequence[ResidualColumns]]:
    """Derivatives of every group's residuals and gains by masses, and those by departures: q columns together.

    Footprints do not change, as in derivatives by the parameters: a truck with all masses, loads, stiffnesses and
    dampings larger by the same share moves in the same way.

    Parameters
    ----------
    model : moved by `amounts` (q,) already, None for a model as declared.
    log_parameters : (p,); motion : of all runs.
    """
    here = np.zeros(allowances.count) if amounts is None else amounts
    sides = allowances.masses.sides
    planar = np.flatnonzero(~sides)
    # Towards the declared value: the simulation does not follow a mass beyond its allowed range.
    steps = np.where(here > 0.0, -STEP, STEP)
    units = steps[:, None] * np.eye(here.size)
    start = allowances.moved(model, here)
    trials = [(allowances.on_same_roads(start, here + units[j]), float(steps[j])) for j in planar]
    by_masses = difference_columns(model, start, weights, log_parameters, motion, trials)
    if sides.any():
        by_masses = _with_sides(by_masses, model, allowances, weights, log_parameters, motion)
    return by_masses, departure_columns(model, allowances, weights, log_parameters, motion, here)


def _with_sides(
    by_masses: Sequence[ResidualColumns],
    model: BumpModel,
    allowances: Allowances,
    weights: Weights,
    log_parameters: Parameters,
    motion: RunMotion,
) -> Sequence[ResidualColumns]:
    """Columns by masses, and after them those by the unknowns of left and right, which are last among the masses."""
    unknowns = allowances.masses.side_unknowns
    signals = None if isinstance(by_masses, ByGroup) else simulate_runs(model, log_parameters, motion)

    def of(position: int) -> ResidualColumns:
        known = by_masses[position]
        if signals is None:
            (shown,) = simulate_runs(model.part(position), log_parameters, motion)
        else:
            shown = signals[position]
        made = side_signals(model, position, log_parameters, motion, unknowns)
        base, base_gain = residuals_of_group(model, weights, position, shown)
        residual = np.zeros((*base.shape, len(unknowns)))
        gain = np.zeros((*base_gain.shape, len(unknowns)))
        steps, part = [_SIDE_STEP * u.sd for u in unknowns], model.part(position)
        raised = (
            replace(
                part, roads=(raised_along(part.roads[0], RoadRise(made.rise.station_m, step * made.rise_columns[k])),)
            )
            for k, step in enumerate(steps)
        )
        # What rolling does to the mean, and what it shows on one side.
        for k, (moved,) in enumerate(simulate_trials(raised, log_parameters, motion, each)):
            moved[:, :, made.channels] += steps[k] * made.columns[..., k]
            by_residual, by_gain = residuals_of_group(model, weights, position, moved)
            residual[..., k], gain[..., k] = (by_residual - base) / steps[k], (by_gain - base_gain) / steps[k]
        return ResidualColumns(
            np.concatenate([known.residual, residual], axis=-1), np.concatenate([known.gain, gain], axis=-1)
        )

    count = len(model.groups)
    return ByGroup(count, of) if isinstance(by_masses, ByGroup) else tuple(of(position) for position in range(count))
