"""Scores and information of single runs about parameters and further columns, each run's own unknowns eliminated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.arrays import UnknownsOfFit
from sysid.estimation.residuals.problem import Problem
from sysid.estimation.residuals.run_clocks import RunClocks
from sysid.estimation.residuals.run_motion import RUN_UNKNOWNS
from sysid.estimation.uncertainty.clock_columns import clock_columns
from sysid.estimation.uncertainty.residual_columns import ResidualColumns
from sysid.estimation.uncertainty.sandwich import BlockScores, block_scores
from sysid.vehicle_model.engines.protocol import Linearisation


@dataclass(frozen=True)
class ClockScores:
    """What the priors of the clocks of R runs add, e clocks each, and where these go.

    `score` (R, p) gradient of half the sum of squares of the priors by the p unknowns that all runs share, and
    `information` (R, p, p) of them: the clocks follow these.

    - `alone` (R, e) is the step of the clocks, in prior standard deviations, while the others stay;
    - `response` (R, e, p): how the clocks follow the p unknowns, with opposite sign;
    - `sd` (R, e): their remaining standard deviations.
    """

    score: np.ndarray
    information: np.ndarray
    alone: np.ndarray
    response: np.ndarray
    sd: np.ndarray


def run_scores_with_clocks(
    problem: Problem,
    vector: UnknownsOfFit,
    position: int,
    columns: Sequence[ResidualColumns],
    with_parts: bool,
    clocks: RunClocks,
) -> tuple[BlockScores, ClockScores]:
    """As :func:`run_scores`, the clocks of further loggers eliminated with the motions."""
    group, (_, motion) = problem.model.groups[position], problem.unpack(vector)
    of_group = run_scores(problem, vector, position, columns, with_parts, clocks)
    of_motion, by_unknowns = problem.expected.rows(motion, group.runs)
    pull = np.concatenate([np.einsum("rjk,rj->rk", by_unknowns, of_motion), clocks.pull(group.runs)], axis=1)
    of_clocks, response = clocks.pull(group.runs), of_group.own_response[:, RUN_UNKNOWNS:]
    return of_group, ClockScores(
        -np.einsum("rkp,rk->rp", response, of_clocks),
        np.einsum("rkp,rkq->rpq", response, response),
        -np.linalg.solve(of_group.own_normal, (of_group.own_score + pull)[..., None])[:, RUN_UNKNOWNS:, 0],
        response,
        np.sqrt(np.diagonal(np.linalg.inv(of_group.own_normal), axis1=1, axis2=2)[:, RUN_UNKNOWNS:]),
    )


def run_scores(
    problem: Problem,
    vector: UnknownsOfFit,
    position: int,
    columns: Sequence[ResidualColumns],
    with_parts: bool,
    clocks: RunClocks | None = None,
) -> BlockScores:
    """Scores and information of the runs of a group, whose derivatives are in memory no longer than that takes.

    Parameters
    ----------
    clocks : those of further loggers, eliminated with the motions; None for clocks that stay.
    """
    group, (_, motion) = problem.model.groups[position], problem.unpack(vector)
    here = Linearisation(*map(np.asarray, problem.linearise_one(vector, position)))
    prior, by_clocks = problem.expected.precision(motion, group.runs), None
    if clocks is not None:
        by_clocks = clock_columns(problem, position, here, clocks)
        whole = np.zeros((len(group.runs), *(RUN_UNKNOWNS + clocks.count,) * 2))
        whole[:, :RUN_UNKNOWNS, :RUN_UNKNOWNS] = prior
        whole[:, RUN_UNKNOWNS:, RUN_UNKNOWNS:] = np.eye(clocks.count)
        prior = whole
    return block_scores(
        here,
        prior,
        np.asarray(group.measured.any(axis=0)) if with_parts else None,
        columns,
        by_clocks,
    )
