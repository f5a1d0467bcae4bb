"""Derivatives of the residuals by the allowances of a fit: mass properties, then departures from the model.

Derivatives by masses are forward differences with the matrices assembled again; their step:
:data:`sysid.estimation.uncertainty.residual_columns.STEP`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.arrays import Parameters
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.uncertainty.allowances import Allowances
from sysid.estimation.uncertainty.departure_scale import departure_columns
from sysid.estimation.uncertainty.residual_columns import STEP, ResidualColumns, difference_columns


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
    count = len(allowances.masses.factors)
    # Towards the declared value: the simulation does not follow a mass beyond its allowed range.
    steps = np.where(here > 0.0, -STEP, STEP)
    units = steps[:, None] * np.eye(here.size)
    start = allowances.moved(model, here)
    trials = [(allowances.on_same_roads(start, here + units[j]), float(steps[j])) for j in range(count)]
    by_masses = difference_columns(model, start, weights, log_parameters, motion, trials)
    return by_masses, departure_columns(model, allowances, weights, log_parameters, motion, here)
