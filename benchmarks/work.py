"""The work that everyone gets: some runs of the linear truck with the product's default contact law."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from sysid.campaign.quality.check import check_quality
from sysid.campaign.read import read_campaign
from sysid.campaign.records import Campaign
from sysid.estimation.fit.state import FitState, fit_point
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.residuals.bump_model import BumpModel, bump_model
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.weights import noise
from sysid.posterior.log_density import LogDensity
from sysid.road.point_cloud import read_point_cloud
from sysid.road.road_profile import RoadProfile
from sysid.road.scan import analyse_scan

ROOT = Path(__file__).resolve().parents[1]
CAMPAIGN = ROOT / "examples" / "linear_truck" / "campaign.toml"
#: Beginning of every record in which the truck has not reached the bump [s].
QUIET_S = 0.25


@dataclass(frozen=True)
class Point:
    """Where the work is done: log parameters (p,), speed [m/s] and start [s] of every run of the campaign."""

    log_parameters: np.ndarray
    motion: RunMotion


@dataclass(frozen=True)
class Work:
    """Some runs of the campaign ready for the likelihood, around a point (p,) in log parameters."""

    campaign: Campaign
    model: BumpModel
    state: FitState

    @property
    def simulated_s(self) -> float:
        """Length of all records [s]."""
        shapes = zip(self.model.groups, self.model.shapes, strict=True)
        return sum(len(group.runs) * shape.samples * shape.interval_s for group, shape in shapes)

    def sets(self, count: int) -> np.ndarray:
        """Parameter sets (count, p) scattered by 5 % about the point; the first is the point."""
        scatter = 0.05 * np.random.default_rng(7).standard_normal((count, self.state.point.log_parameters.size))
        scatter[0] = 0.0
        return np.asarray(self.state.point.log_parameters + scatter)


@contextmanager
def engine(name: str) -> Iterator[None]:
    """Compute with one engine."""
    before = os.environ.get("SYSID_ENGINE")
    os.environ["SYSID_ENGINE"] = name
    try:
        yield
    finally:
        if before is None:
            del os.environ["SYSID_ENGINE"]
        else:
            os.environ["SYSID_ENGINE"] = before


@cache
def linear_truck() -> tuple[Campaign, dict[str, RoadProfile]]:
    """The screened campaign and its road profiles."""
    campaign, _ = check_quality(read_campaign(CAMPAIGN, point_cloud_reader=read_point_cloud))
    return campaign, {name: analyse_scan(scan).profile for name, scan in campaign.scans.items()}


def nominal_point(laws: Sequence[frozenset[str]] | None = None) -> Point:
    """Start values of the campaign file or of other laws, nominal speeds, and the bump met after a second."""
    campaign, _ = linear_truck()
    speed = np.array([run.nominal_speed_m_s for run in campaign.bump_runs])
    parameters = campaign_parameters(campaign, None, laws)
    return Point(np.asarray(parameters.start, float), RunMotion.steady(speed, np.full(speed.size, 1.0)))


def fitted_point(folder: Path) -> Point:
    """Where the fit in an output folder ended."""
    from sysid.workflow import Calibration

    calibration = Calibration(CAMPAIGN, folder, resume=True)
    fit = calibration.fit()
    log_parameters = np.log([p.value for p in fit.parameters])
    files = [run.log.file for run in calibration.campaign.bump_runs]
    found = {(p.quantity, p.run): p.value for p in fit.run_parameters}
    # Other programs of the comparison drive at constant speed.
    motion = RunMotion.steady(*(np.array([found[quantity, file] for file in files]) for quantity in ("speed", "start")))
    return Point(log_parameters, motion)


def make_work(point: Point, runs: Sequence[int], laws: Sequence[frozenset[str]] | None = None) -> Work:
    """The work of some runs of the campaign, by their indices; `laws` are elements of every axle's suspension law."""
    whole, profiles = linear_truck()
    campaign = replace(whole, bump_runs=tuple(whole.bump_runs[i] for i in runs))
    # All load cases keep their parameters, whichever runs are chosen.
    parameters = campaign_parameters(whole, None, laws)
    model = bump_model(campaign, parameters, profiles)
    sd = tuple(noise.instrument_noise(group, QUIET_S) for group in model.groups)
    chosen = list(runs)
    weights = Weights(sd, tuple(np.ones_like(s) for s in sd))
    # Its covariance is of no use here.
    unknown = np.eye(point.log_parameters.size)
    end = fit_point(model, point.log_parameters, point.motion.of(chosen), weights, unknown)
    return Work(campaign, model, FitState(campaign, end, model))


def density(work: Work, name: str) -> LogDensity:
    """The product's vectorised log-density by one engine."""
    with engine(name):
        return LogDensity(work.state)
