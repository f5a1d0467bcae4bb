"""Clocks of further loggers: unknowns of every run beside its motion.

A stamp t of a logger is off by d + e (t - t_c), where t_c is a time of the run. The alignment of the logs gives offset
d and rate e with standard deviations. These are the priors here, and unknowns are in units of them. A clock that runs
on from log to log has the same error in all n runs. There every run gets an unknown of its own with n times the
variance. This includes the common error and makes no interval too narrow.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.campaign.loggers import ClockFinding
from sysid.campaign.records import Campaign


@dataclass(frozen=True)
class RunClocks:
    """Unknown clocks of n runs in the order of the campaign, by `loggers` (l,).

    - `sd` (n, l, 2): standard deviations of offset [s] and rate, 0 if a clock is known or its logger absent;
    - `about_s` (n, l): times t_c of the runs;
    - `moved` (n, l, 2): change of the clocks by the fit, in standard deviations from the alignment.
    """

    loggers: tuple[str, ...]
    sd: np.ndarray
    about_s: np.ndarray
    moved: np.ndarray

    @property
    def count(self) -> int:
        """Unknowns of one run."""
        return 2 * len(self.loggers)

    def pull(self, runs: Sequence[int]) -> np.ndarray:
        """Gradient (R, 2 l) of half the sum of squares of the priors of some runs."""
        return self.moved[list(runs)].reshape(len(runs), self.count)


def run_clocks(campaign: Campaign) -> RunClocks | None:
    """Clocks that the data may move, None for a campaign of one logger."""
    unknown = [c for c in campaign.clocks if c.is_unknown]
    if not unknown:
        return None
    runs_on = Counter(c.logger for c in unknown if c.method == "all runs")
    loggers = tuple(dict.fromkeys(c.logger for c in unknown))
    place = {run.log.file: i for i, run in enumerate(campaign.bump_runs)}
    shape = (len(campaign.bump_runs), len(loggers))
    clocks = RunClocks(loggers, np.zeros((*shape, 2)), np.zeros(shape), np.zeros((*shape, 2)))
    for c in unknown:
        if c.file in place:
            at = place[c.file], loggers.index(c.logger)
            wider = np.sqrt(runs_on[c.logger]) if c.method == "all runs" else 1.0
            clocks.sd[at] = wider * np.array([c.sd_s, c.rate_sd])
            clocks.about_s[at] = c.about_s
            clocks.moved[at] = np.array([c.moved_s, c.moved_rate]) / np.where(clocks.sd[at] > 0.0, clocks.sd[at], 1.0)
    return clocks


def moved_clocks(campaign: Campaign, step: np.ndarray) -> tuple[ClockFinding, ...]:
    """The clocks of a campaign after a step (n, l, 2) of its unknown ones, in standard deviations."""
    clocks = run_clocks(campaign)
    if clocks is None:
        return ()
    place = {run.log.file: i for i, run in enumerate(campaign.bump_runs)}
    moved = []
    for c in campaign.clocks:
        if c.is_unknown and c.file in place:
            at = place[c.file], clocks.loggers.index(c.logger)
            by_s, by_rate = clocks.sd[at] * step[at]
            c = replace(c, moved_s=c.moved_s + float(by_s), moved_rate=c.moved_rate + float(by_rate))
        moved.append(c)
    return tuple(moved)
