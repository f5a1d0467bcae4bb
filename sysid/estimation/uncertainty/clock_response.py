"""What is not known of the loggers' clocks, and how k and c follow it.

The stamps of a logger in one run are off by an unknown t ~ N(0, s^2).  The fit takes the clocks as they were found, so
that its optimum x moves with them, dx/dt = -A^-1 B, with A the information about x, priors included, and B that between
x and t, the runs' own motions eliminated.  This adds A^-1 B S B' A^-1 to the covariance A^-1, or takes

    B (S^-1 + B' A^-1 B)^-1 B'

from the information (Woodbury).  A clock that runs on from log to log is off by the same in all n runs: there every run
gets an unknown of its own of n times the variance, which holds the common one and adds no less.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from sysid.arrays import UnknownsOfFit
from sysid.campaign.records import Campaign
from sysid.estimation.residuals.problem import Problem
from sysid.estimation.uncertainty.residual_columns import ResidualColumns, residuals_of_group
from sysid.estimation.uncertainty.run_scores import run_scores

#: Step of the derivative by a clock [s].
_STEP_S = 1e-4


@dataclass(frozen=True)
class ClockResponse:
    """`across` B (p + m, n) between p parameters with m further unknowns, and n clocks [1/s]; `sd_s` (n,) of these."""

    across: np.ndarray
    sd_s: np.ndarray

    def lost(self, information: np.ndarray, factor: float) -> np.ndarray:
        """What the clocks take from an information (p + m, p + m).

        Parameters
        ----------
        information : of data whose variances are widened by `factor`, and of the priors.
        """
        across = self.across / factor
        of_clocks = np.diag(self.sd_s**-2) + across.T @ np.linalg.solve(information, across)
        lost = across @ np.linalg.solve(of_clocks, across.T)
        return np.asarray(0.5 * (lost + lost.T))


def clock_response(
    campaign: Campaign, problem: Problem, vector: UnknownsOfFit, columns: Sequence[Sequence[ResidualColumns]]
) -> ClockResponse | None:
    """How the optimum follows the clocks of all runs, None for a campaign of one logger.

    Parameters
    ----------
    columns : by which the residuals move with m unknowns beside the p parameters, kind after kind.
    """
    known = _standard_deviations(campaign)
    loggers = sorted({logger for _, logger in known})
    count = problem.count + sum(kind[0].gain.shape[-1] for kind in columns)
    across, sd_s = [], []
    for position, group in enumerate(problem.model.groups):
        files = [campaign.bump_runs[run].log.file for run in group.runs]
        if not any((file, logger) in known for file in files for logger in loggers):
            continue
        clocks = _by_clocks(problem, vector, position, loggers)
        found = run_scores(problem, vector, position, [*(kind[position] for kind in columns), clocks], False)
        for file, information in zip(files, found.information, strict=True):
            for k, logger in enumerate(loggers):
                if (file, logger) in known:
                    across.append(information[:count, count + k])
                    sd_s.append(known[file, logger])
    return ClockResponse(np.array(across).T, np.array(sd_s)) if across else None


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
    time = group.interval_s * np.arange(shown.shape[0])
    # Differences of samples would miss a tenth of the slope at 25 Hz.
    slope = CubicSpline(time, shown, axis=0)(time, 1)
    residual, gain = [], []
    for logger in loggers:
        of_logger = np.array([s.logger == logger for s in model.layout.sensors])
        moved = residuals_of_group(model, problem.weights, position, shown + _STEP_S * slope * of_logger)
        residual.append((moved[0] - np.asarray(here.residual)) / _STEP_S)
        gain.append((moved[1] - np.asarray(here.gain_residual)) / _STEP_S)
    return ResidualColumns(np.stack(residual, axis=-1), np.stack(gain, axis=-1))
