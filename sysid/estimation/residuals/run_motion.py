"""Motion of every run: the unknowns of the search, and their priors from the campaign.

A run has three unknowns of its own: its speed v and start t_0 at axle 1, and the share c by which its speed changes,
at constant acceleration, until the last axle is where axle 1 was, L behind.  The search uses the mean speed of the
passage, v (1 + c / 2), in place of v: the arrivals of first and last axle determine the mean speed whatever c is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.arrays import Runs, RunsByUnknowns, RunsByUnknownsByUnknowns
from sysid.campaign.records import BumpRun
from sysid.vehicle_model.motion import Motion, MotionChange, acceleration_of

#: One unit of the scaled local unknowns: relative change of the mean speed, and shift along the road [m]; of the change
#: over the passage it is the standard deviation of its prior.
SPEED_UNIT = 0.01
SHIFT_UNIT_M = 0.02
#: Number of a run's own unknowns, and their order after those that all runs share.
RUN_UNKNOWNS = 3
SPEED, SHIFT, CHANGE = range(RUN_UNKNOWNS)


@dataclass(frozen=True)
class RunMotion:
    """Motion of every run, in the order of the campaign's bump runs; NaN for runs left out.

    Speed [m/s] and start [s] at axle 1, and relative change of the speed until the last axle passes.
    """

    speed_m_s: Runs
    start_s: Runs
    speed_change: Runs

    @classmethod
    def steady(cls, speed_m_s: Runs, start_s: Runs) -> RunMotion:
        """Runs whose speed does not change."""
        return cls(speed_m_s, start_s, np.zeros_like(speed_m_s))

    def of(self, runs: Sequence[int]) -> RunMotion:
        """Motion of some runs, in their order."""
        chosen = list(runs)
        return RunMotion(self.speed_m_s[chosen], self.start_s[chosen], self.speed_change[chosen])

    def along_road(self, axle_x: np.ndarray) -> Motion:
        """Motion (R, 1) of the runs of a vehicle with axles at `axle_x` (na, 1) [m]."""
        acceleration = acceleration_of(self.speed_change, self.speed_m_s, float(np.ptp(axle_x)))
        return Motion(self.speed_m_s[:, None], self.start_s[:, None], acceleration[:, None])

    def per_unit(self, axle_x: np.ndarray, change_unit: Runs) -> MotionChange:
        """Derivatives (R, 3) of the motion of the runs by the scaled unknowns of the runs.

        Parameters
        ----------
        change_unit : (R,) unit of the change of speed.
        """
        speed, length, still = self.speed_m_s, float(np.ptp(axle_x)), np.zeros_like(self.speed_m_s)
        acceleration = acceleration_of(self.speed_change, speed, length)
        # With the mean speed w the speed at axle 1 is w / (1 + c / 2), the acceleration w^2 c / (1 + c / 2) / L.
        by_change = 0.0 if length <= 0.0 else speed**2 / length
        return MotionChange(
            speed=np.stack([SPEED_UNIT * speed, still, self.speed_by_change * change_unit], axis=1),
            start_s=np.stack([still, SHIFT_UNIT_M / speed, still], axis=1),
            acceleration=np.stack([2.0 * SPEED_UNIT * acceleration, still, by_change * change_unit], axis=1),
        )

    @property
    def mean_speed_m_s(self) -> Runs:
        """Mean speed from axle 1 to the last axle at the bump (R,) [m/s]."""
        return np.asarray(self.speed_m_s * (1.0 + 0.5 * self.speed_change))

    @property
    def speed_by_change(self) -> Runs:
        """Derivative (R,) of the speed at axle 1 by its change at the same mean speed [m/s]."""
        return np.asarray(-self.speed_m_s / (2.0 + self.speed_change))

    def moved(self, unknowns: RunsByUnknowns, change_unit: Runs) -> RunMotion:
        """The motion that scaled unknowns (R, 3) away from this one has; `change_unit` as in :meth:`per_unit`."""
        change = self.speed_change + change_unit * unknowns[:, CHANGE]
        mean = self.mean_speed_m_s * (1.0 + SPEED_UNIT * unknowns[:, SPEED])
        start = self.start_s + SHIFT_UNIT_M / self.speed_m_s * unknowns[:, SHIFT]
        return RunMotion(mean / (1.0 + 0.5 * change), start, change)


@dataclass(frozen=True)
class MotionPrior:
    """Prior knowledge of the runs' motions, (R,) each in the order of the campaign.

    Expected speed [m/s] and relative standard deviation about it; standard deviation of the change of speed about zero,
    0 where there is none.
    """

    speed_m_s: Runs
    relative_sd: Runs
    change_sd: Runs

    def rows(self, motion: RunMotion, runs: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """The priors of some runs as residuals (R, 2), and their derivatives (R, 2, 3) by the runs' own unknowns.

        With v_0 the expected speed and s its relative standard deviation the residuals are (v / v_0 - 1) / s, and the
        change of speed in units of its standard deviation.  The start has no prior.
        """
        chosen = list(runs)
        ratio = motion.speed_m_s[chosen] / self.speed_m_s[chosen]
        sd, change_sd = self.relative_sd[chosen], self.change_sd[chosen]
        change = motion.speed_change[chosen] / np.where(change_sd > 0.0, change_sd, 1.0)
        derivative = np.zeros((len(chosen), 2, RUN_UNKNOWNS))
        derivative[:, 0, SPEED] = SPEED_UNIT * ratio / sd
        derivative[:, 0, CHANGE] = motion.speed_by_change[chosen] * change_sd / (self.speed_m_s[chosen] * sd)
        # Without a change of speed, its unknown has no effect and stays where it is.
        derivative[:, 1, CHANGE] = 1.0
        return np.stack([(ratio - 1.0) / sd, change], axis=1), derivative

    def precision(self, motion: RunMotion, runs: Sequence[int]) -> RunsByUnknownsByUnknowns:
        """Prior precision (R, 3, 3) of some runs' own unknowns."""
        _, derivative = self.rows(motion, runs)
        return np.asarray(np.einsum("rjk,rjl->rkl", derivative, derivative))


def motion_prior(runs: Sequence[BumpRun]) -> MotionPrior:
    """Prior of the runs' motions as the campaign declares them."""
    return MotionPrior(
        *(np.array(v) for v in zip(*((r.expected_speed_m_s, r.speed_sd, r.speed_change_sd) for r in runs), strict=True))
    )
