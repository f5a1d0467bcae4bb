"""Speed and start of every run: what the search finds, and what the campaign says of the speed beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.arrays import Runs
from sysid.campaign.records import BumpRun

#: One unit of the scaled local unknowns: relative speed change, and shift along the road [m].
SPEED_UNIT = 0.01
SHIFT_UNIT_M = 0.02


@dataclass(frozen=True)
class RunMotion:
    """Speed [m/s] and start [s] of every run, in the order of the campaign's bump runs; NaN for runs left out."""

    speed_m_s: Runs
    start_s: Runs


@dataclass(frozen=True)
class SpeedPrior:
    """Nominal speed [m/s] and relative standard deviation about it, per run in the order of the campaign."""

    speed_m_s: Runs
    relative_sd: Runs

    def rows(self, motion: RunMotion, runs: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """The prior of some runs' speeds as residuals (R,), and their derivatives (R, 2) by the runs' own unknowns.

        With v_0 the nominal speed and s its relative standard deviation the residual is (v / v_0 - 1) / s; one unit of
        a run's first unknown is 1 % of its present speed v, the second (its start) has no prior.
        """
        chosen = list(runs)
        ratio = motion.speed_m_s[chosen] / self.speed_m_s[chosen]
        sd = self.relative_sd[chosen]
        return (ratio - 1.0) / sd, np.stack([SPEED_UNIT * ratio / sd, np.zeros(len(chosen))], axis=1)


def speed_prior(runs: Sequence[BumpRun]) -> SpeedPrior:
    """Prior of the runs' speeds as the campaign declares them."""
    return SpeedPrior(np.array([r.nominal_speed_m_s for r in runs]), np.array([r.speed_sd for r in runs]))
