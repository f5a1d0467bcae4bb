"""Scores and information of single runs about parameters and further columns, each run's own unknowns eliminated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.arrays import UnknownsOfFit
from sysid.estimation.residuals.problem import Problem
from sysid.estimation.uncertainty.residual_columns import ResidualColumns, with_columns
from sysid.estimation.uncertainty.sandwich import BlockScores, block_scores


def run_scores(
    problem: Problem, vector: UnknownsOfFit, position: int, columns: Sequence[ResidualColumns], with_parts: bool
) -> list[BlockScores]:
    """Scores and information of every run of a group, whose derivatives are in memory no longer than that takes."""
    group, (_, motion) = problem.model.groups[position], problem.unpack(vector)
    runs = with_columns(problem.linearise_one(vector, position), *columns)
    return [
        block_scores(
            np.asarray(lin.residual),
            np.asarray(lin.residual_jacobian),
            np.asarray(lin.gain_residual),
            np.asarray(lin.gain_jacobian),
            problem.expected.precision(motion, [run]),
            used[None] if with_parts else None,
        )
        for run, used, lin in zip(group.runs, np.asarray(group.measured.any(axis=0)), runs, strict=True)
    ]
