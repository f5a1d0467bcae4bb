"""Scores and information of single runs about parameters and further columns, each run's own unknowns eliminated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.arrays import UnknownsOfFit
from sysid.estimation.residuals.problem import Problem
from sysid.estimation.uncertainty.residual_columns import ResidualColumns
from sysid.estimation.uncertainty.sandwich import BlockScores, block_scores
from sysid.vehicle_model.engines.protocol import Linearisation


def run_scores(
    problem: Problem, vector: UnknownsOfFit, position: int, columns: Sequence[ResidualColumns], with_parts: bool
) -> BlockScores:
    """Scores and information of the runs of a group, whose derivatives are in memory no longer than that takes."""
    group, (_, motion) = problem.model.groups[position], problem.unpack(vector)
    return block_scores(
        Linearisation(*map(np.asarray, problem.linearise_one(vector, position))),
        problem.expected.precision(motion, group.runs),
        np.asarray(group.measured.any(axis=0)) if with_parts else None,
        columns,
    )
