"""Information that is lost with what is not known of the loggers' clocks.

The stamps of a logger in one run are off by an unknown t ~ N(0, s^2).  With the information I of that run about the
common unknowns x and about t, the run's own motion eliminated, integrating t out takes

    I_xt (I_tt + s^-2)^-1 I_tx

from the information about x.  A clock that runs on from log to log is off by the same in all n runs: there every run
gets an unknown of its own of n times the variance, which holds the common one and loses no less.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from sysid.arrays import UnknownsOfFit
from sysid.campaign.records import Campaign
from sysid.estimation.residuals.problem import Problem
from sysid.estimation.uncertainty.residual_columns import ResidualColumns, residuals_of_group
from sysid.estimation.uncertainty.run_scores import run_scores

#: Step of the derivative by a clock [s].
_STEP_S = 1e-4


def clock_loss(
    campaign: Campaign, problem: Problem, vector: UnknownsOfFit, columns: Sequence[Sequence[ResidualColumns]]
) -> np.ndarray | None:
    """Lost information (p + m, p + m) about p parameters and m unknowns of further columns; None without loggers.

    Parameters
    ----------
    columns : by which the residuals move with these m, kind after kind.
    """
    sd_s = _standard_deviations(campaign)
    loggers = sorted({logger for _, logger in sd_s})
    if not loggers:
        return None
    count = problem.count + sum(kind[0].gain.shape[-1] for kind in columns)
    lost = np.zeros((count, count))
    for position, group in enumerate(problem.model.groups):
        files = [campaign.bump_runs[run].log.file for run in group.runs]
        if not any((file, logger) in sd_s for file in files for logger in loggers):
            continue
        clocks = _by_clocks(problem, vector, position, loggers)
        found = run_scores(problem, vector, position, [*(kind[position] for kind in columns), clocks], False)
        for file, of_run in zip(files, found, strict=True):
            information = of_run.information[0]
            kept = [k for k, logger in enumerate(loggers) if (file, logger) in sd_s]
            if not kept:
                continue
            at = count + np.array(kept)
            prior = np.diag([sd_s[file, loggers[k]] ** -2 for k in kept])
            across = information[:count][:, at]
            lost += across @ np.linalg.solve(information[np.ix_(at, at)] + prior, across.T)
    return 0.5 * (lost + lost.T)


def _standard_deviations(campaign: Campaign) -> dict[tuple[str, str], float]:
    """Standard deviation [s] of every clock that was found, by the file of the run and the logger."""
    found = [c for c in campaign.clocks if not c.complaint and np.isfinite(c.offset_s) and 0.0 < c.sd_s < np.inf]
    runs = Counter(c.logger for c in found if c.method == "all runs")
    return {(c.file, c.logger): c.sd_s * (np.sqrt(runs[c.logger]) if c.method == "all runs" else 1.0) for c in found}


def _by_clocks(problem: Problem, vector: UnknownsOfFit, position: int, loggers: Sequence[str]) -> ResidualColumns:
    """Derivatives of a group's residuals by the clock of each logger [1/s], one column per logger."""
    model, group = problem.model, problem.model.groups[position]
    here = problem.linearise_one(vector, position)
    shown = np.asarray(here.simulated)
    slope = np.gradient(shown, group.interval_s, axis=0)
    residual, gain = [], []
    for logger in loggers:
        of_logger = np.array([s.logger == logger for s in model.layout.sensors])
        moved = residuals_of_group(model, problem.weights, position, shown + _STEP_S * slope * of_logger)
        residual.append((moved[0] - np.asarray(here.residual)) / _STEP_S)
        gain.append((moved[1] - np.asarray(here.gain_residual)) / _STEP_S)
    return ResidualColumns(np.stack(residual, axis=-1), np.stack(gain, axis=-1))
