"""Scores and information of single runs about parameters and further columns, each run's own unknowns eliminated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.arrays import UnknownsOfFit
from sysid.estimation.residuals.problem import Problem
from sysid.estimation.residuals.run_clocks import RunClocks
from sysid.estimation.residuals.run_motion import RUN_UNKNOWNS, RunMotion
from sysid.estimation.uncertainty.clock_columns import clock_columns
from sysid.estimation.uncertainty.residual_columns import ResidualColumns
from sysid.estimation.uncertainty.sandwich import BlockScores, block_scores
from sysid.vehicle_model.engines.protocol import Columns, Linearisation


@dataclass(frozen=True)
class PriorScores:
    """What the priors of the own unknowns of R runs add, which follow the p unknowns that all runs share.

    `score` (R, p) gradient of half the sum of squares of these priors by the p unknowns, and `information` (R, p, p).
    """

    score: np.ndarray
    information: np.ndarray


@dataclass(frozen=True)
class ClockScores:
    """Where the clocks of R runs go, e clocks each.

    - `alone` (R, e) is the step of the clocks, in prior standard deviations, while the others stay;
    - `response` (R, e, p): how the clocks follow the p unknowns that all runs share, with opposite sign;
    - `sd` (R, e): their remaining standard deviations.
    """

    alone: np.ndarray
    response: np.ndarray
    sd: np.ndarray


def run_scores(
    problem: Problem,
    vector: UnknownsOfFit,
    position: int,
    columns: Sequence[ResidualColumns],
    with_parts: bool,
    clocks: RunClocks | None = None,
) -> tuple[BlockScores, PriorScores, ClockScores | None]:
    """Scores and information of the runs of a group, whose derivatives are in memory no longer than that takes.

    The own unknowns u of a run follow the p shared ones x by -E. With u eliminated, the gradient by x is

        (g_x - E' g_u) + (-E' pull)

    with g of the data and `pull` of the priors of u. The first part is returned by channel, the second by run.

    Parameters
    ----------
    vector : the unknowns of `problem`; position : of the group.
    columns : derivatives of the group's residuals by further shared unknowns, kind after kind.
    with_parts : whether the information of single channels is wanted.
    clocks : those of further loggers, eliminated with the motions; None for clocks that stay.

    Returns
    -------
    Of the data, of the priors of the runs' own unknowns, and where the clocks go (None for clocks that stay).
    """
    group, (_, motion) = problem.model.groups[position], problem.unpack(vector)
    here = Linearisation(*map(np.asarray, problem.linearise_one(vector, position)))
    by_clocks = None if clocks is None else clock_columns(problem, position, here, clocks)
    pull, prior = own_priors(problem, motion, position, clocks)
    measured = np.asarray(group.measured.any(axis=0)) if with_parts else None
    scored = block_scores(here, prior, measured, columns, by_clocks)
    response = scored.own_response
    of_priors = PriorScores(
        -np.einsum("rkp,rk->rp", response, pull), np.einsum("rkp,rkl,rlq->rpq", response, prior, response)
    )
    return scored, of_priors, None if clocks is None else _of_clocks(scored, pull)


def own_priors(
    problem: Problem, motion: RunMotion, position: int, clocks: RunClocks | None
) -> tuple[np.ndarray, np.ndarray]:
    """Priors of the l own unknowns of R runs, motions then clocks: gradient (R, l) of half their squares, precision."""
    runs = problem.model.groups[position].runs
    rows, by_motion = problem.expected.rows(motion, runs)
    pull, prior = np.einsum("rjk,rj->rk", by_motion, rows), problem.expected.precision(motion, runs)
    if clocks is None:
        return pull, prior
    whole = np.zeros((len(runs), *(RUN_UNKNOWNS + clocks.count,) * 2))
    whole[:, :RUN_UNKNOWNS, :RUN_UNKNOWNS] = prior
    whole[:, RUN_UNKNOWNS:, RUN_UNKNOWNS:] = np.eye(clocks.count)
    return np.concatenate([pull, clocks.pull(runs)], axis=1), whole


def own_columns(problem: Problem, position: int, here: Linearisation, clocks: RunClocks | None) -> Columns:
    """Columns (T, R, C, l) of the own unknowns of a group's runs, motions then clocks, beside its linearisation."""
    # Copies, which do not keep the columns of the parameters.
    residual, gain = (np.array(c[..., problem.count :]) for c in (here.residual_jacobian, here.gain_jacobian))
    if clocks is not None:
        of_clocks = clock_columns(problem, position, here, clocks)
        residual, gain = np.concatenate([residual, of_clocks.residual], -1), np.concatenate([gain, of_clocks.gain], -1)
    return Columns(residual, gain)


def _of_clocks(scored: BlockScores, pull: np.ndarray) -> ClockScores:
    """Where clocks go, from `pull` (R, l): gradient of half the sum of squares of the priors by the own unknowns."""
    return ClockScores(
        -np.linalg.solve(scored.own_normal, (scored.own_score + pull)[..., None])[:, RUN_UNKNOWNS:, 0],
        scored.own_response[:, RUN_UNKNOWNS:],
        np.sqrt(np.diagonal(np.linalg.inv(scored.own_normal), axis1=1, axis2=2)[:, RUN_UNKNOWNS:]),
    )
