"""Expected result of a campaign: readings simulated from known parameters, calibrated, compared with the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import binom

from sysid.campaign.records import Campaign
from sysid.display import Z90
from sysid.errors import CampaignError, DataRejectedError
from sysid.estimation.fit.fit_result import FitResult
from sysid.estimation.fit.least_squares import fit_bump_runs
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.progress import Progress, unwatched
from sysid.road.road_profile import RoadProfile
from sysid.selftest.readings import (
    Instruments,
    as_logged,
    ordinary_instruments,
    simulated_campaign,
    with_usable_channels,
)
from sysid.selftest.world import World, draw_world

#: Nominal share of true values inside an interval.
SHARE = 0.90
#: Share of campaigns within the range that is given for the number of intervals that hold.
RANGE = 0.95
SHOWN = ("stiffness", "damping")
#: Those of the product, without the second solver and other laws than those that made the readings.
OPTIONS = FitOptions(second_solver=False, laws="declared")
#: Draws of the errors behind the expected number of intervals that hold.
_DRAWS = 4000


@dataclass(frozen=True)
class Check:
    """One k or c of a simulated campaign: `truth` and least-squares `value` in `unit`, `prior_sd` and `sd` of the
    logarithm.
    """

    name: str
    unit: str
    truth: float
    value: float
    prior_sd: float
    sd: float

    @property
    def held(self) -> bool:
        """Whether the 90 % interval, log value +- 1.645 sd, holds the truth."""
        return bool(abs(np.log(self.value / self.truth)) <= Z90 * self.sd)


@dataclass(frozen=True)
class Replicate:
    """One simulated campaign: every k and c, and `covariance` (checks, checks) of their logarithms."""

    checks: tuple[Check, ...]
    covariance: np.ndarray
    converged: bool

    @property
    def held(self) -> int:
        """How many intervals hold the truth."""
        return sum(c.held for c in self.checks)

    def expected(self, random: np.random.Generator) -> tuple[float, int, int]:
        """Mean and central 95 % range of the number of intervals that hold, were the errors N(0, covariance)."""
        scale = np.sqrt(np.diag(self.covariance))
        errors = random.multivariate_normal(np.zeros(scale.size), self.covariance, _DRAWS, method="cholesky") / scale
        count = (np.abs(errors) <= Z90).sum(axis=1)
        low, high = np.quantile(count, [0.5 - RANGE / 2, 0.5 + RANGE / 2])
        return SHARE * scale.size, int(low), int(high)


@dataclass(frozen=True)
class SelfTest:
    """All simulated campaigns, and sentences about those that could not be calibrated.

    `silent` names logs without any usable channel: their runs were simulated with all sensors.
    """

    replicates: tuple[Replicate, ...]
    failures: tuple[str, ...]
    seed: int
    silent: tuple[str, ...] = ()

    @property
    def converged(self) -> bool:
        """Whether every campaign was calibrated to the end."""
        return not self.failures and all(r.converged for r in self.replicates)

    @property
    def intervals(self) -> int:
        """Number of intervals of all campaigns."""
        return sum(len(r.checks) for r in self.replicates)

    @property
    def held(self) -> int:
        """Number of intervals that hold the truth."""
        return sum(r.held for r in self.replicates)

    def binomial_range(self) -> tuple[int, int]:
        """Central 95 % range of the number of intervals that hold, were they independent."""
        tail = 0.5 - RANGE / 2
        return int(binom.ppf(tail, self.intervals, SHARE)), int(binom.ppf(1.0 - tail, self.intervals, SHARE))


def self_test(
    campaign: Campaign,
    profiles: Mapping[str, RoadProfile],
    count: int = 1,
    seed: int = 0,
    *,
    instruments: Instruments | None = None,
    options: FitOptions = OPTIONS,
    progress: Progress | None = None,
) -> SelfTest:
    """Simulate a campaign `count` times with parameters and masses from their priors, and calibrate each.

    Parameters
    ----------
    campaign : its vehicle, load cases and runs; of the logs only lengths and usable sensors count, where there are any.
    profiles : road profile of every bump.
    instruments : how the sensors err; ordinary ones if None.
    options : settings of least squares.
    progress : callback (message, fraction done).

    Raises
    ------
    CampaignError
        If the campaign has no bump run.
    DataRejectedError
        If none of the simulated campaigns can be calibrated.
    """
    if not campaign.bump_runs:
        raise CampaignError(
            f"{campaign.file.name} has no bump run to simulate; list the planned ones under tests.bump_run."
        )
    report = progress or unwatched
    usable, silent = with_usable_channels(replace(campaign, plank_drops=()))
    planned = as_logged(usable, profiles)
    parameters = campaign_parameters(planned, None)
    instruments = instruments or ordinary_instruments(planned)
    done, failures = [], []
    for number in range(count):
        random = np.random.default_rng([seed, number])

        def part(message: str, fraction: float, number: int = number) -> None:
            report(message if count == 1 else f"{number + 1} of {count}: {message}", (number + fraction) / count)

        part("simulating the readings", 0.0)
        world = draw_world(planned, parameters, profiles, random, options.contact)
        readings = simulated_campaign(planned, world, profiles, instruments, random)
        try:
            fit, _ = fit_bump_runs(readings, parameters, profiles, options, part)
        except DataRejectedError as error:
            failures.append(str(error))
            continue
        done.append(compared(fit, world))
    if not done:
        raise DataRejectedError(f"No simulated campaign could be calibrated: {failures[0]}")
    return SelfTest(tuple(done), tuple(failures), seed, silent)


def compared(fit: FitResult, world: World) -> Replicate:
    """Every k and c of a fit compared with the truth."""
    chosen = [i for i, p in enumerate(fit.parameters) if p.quantity in SHOWN]
    truth = world.values
    checks = []
    for i in chosen:
        p = fit.parameters[i]
        sd = float(np.sqrt(fit.covariance[i, i]))
        checks.append(Check(p.name, p.unit, truth[p.name], p.value, p.prior_sd, sd))
    return Replicate(tuple(checks), fit.covariance[np.ix_(chosen, chosen)], fit.converged)
