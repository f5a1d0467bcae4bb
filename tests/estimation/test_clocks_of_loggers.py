"""Two loggers 200 ms and 100 ppm apart: k, c and their intervals are those of one clock."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic_campaign import Physics
from two_loggers import SecondClock, late_s, loggers_declared, simulate_logs

from sysid.campaign import check_quality, read_campaign
from sysid.campaign.records import BumpRun, Campaign
from sysid.estimation import FitOptions, campaign_parameters, fit_bump_runs
from sysid.estimation.fit.state import restored
from sysid.road.point_cloud import read_point_cloud
from sysid.road.scan import analyse_scan

CLOCK = SecondClock(0.2, 1e-4)
PHYSICS = Physics(drops_per_axle=0, speeds_km_h=(9.0, 16.0))
OPTIONS = FitOptions(weight_rounds=1, second_solver=False, laws="declared")
NEAR_S = 2e-3
#: What is asked for, in standard deviations, and by which factor these may be wider.
UNCHANGED_SD, WIDER = 0.2, 1.15
KINDS = ('clock = "continuous"', 'clock = "per_log"')


@pytest.fixture(scope="module")
def logs(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("clocks") / "two"
    simulate_logs(folder, PHYSICS, CLOCK)
    return folder


def campaign_of(folder: Path, clock: str) -> Campaign:
    text = loggers_declared((folder / "campaign.toml").read_text(encoding="utf-8"), _second, clock)
    file = folder / "two.toml"
    file.write_text(text, encoding="utf-8")
    return check_quality(read_campaign(file, point_cloud_reader=read_point_cloud))[0]


def _second(column: str) -> bool:
    return column[-1] != "1" and any(f"{kind}{axle}_" in column for kind in ("lvdt", "axle", "frame") for axle in "23")


def moved(campaign: Campaign, run: BumpRun, by_s: float, by_rate: float) -> BumpRun:
    """A run with the stamps of the second logger moved, by an offset and a rate about the time of the found clock."""
    (clock,) = [c for c in campaign.clocks if c.file == run.log.file]
    channels = tuple(
        replace(c, time_s=c.time_s + by_s + by_rate * (c.time_s - clock.offset_s - clock.at_s))
        if _second(c.sensor.column)
        else c
        for c in run.log.channels
    )
    return replace(run, log=replace(run.log, channels=channels))


def fitted(campaign: Campaign) -> dict[str, tuple[float, float]]:
    """k and c with their standard deviations, by name."""
    profiles = {name: analyse_scan(scan).profile for name, scan in campaign.scans.items()}
    result, state = fit_bump_runs(campaign, campaign_parameters(campaign, None), profiles, OPTIONS)
    # Later stages begin with the same records.
    again = restored(campaign, profiles, state.point).model.groups
    for old, new in zip(state.model.groups, again, strict=True):
        np.testing.assert_array_equal(old.value, new.value)
    return {p.name: (p.value, p.sd) for p in result.parameters if p.name.startswith(("k_", "c_"))}


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_k_and_c_are_those_of_one_clock(logs: Path, kind: str) -> None:
    campaign = campaign_of(logs, kind)
    order = sorted(clock.file for clock in campaign.clocks)
    truth = []
    for run in campaign.bump_runs:
        (clock,) = [c for c in campaign.clocks if c.file == run.log.file]
        # As the second logger really was: started late, and slow by the rate.
        error = clock.offset_s - late_s(order.index(run.log.file)) - CLOCK.rate * clock.at_s
        assert abs(error) < NEAR_S
        truth.append(moved(campaign, run, -error, CLOCK.rate - clock.rate))
    found, right = (fitted(c) for c in (campaign, replace(campaign, bump_runs=tuple(truth), clocks=())))
    apart = {name: (value - right[name][0]) / right[name][1] for name, (value, _) in found.items()}
    wider = {name: sd / right[name][1] for name, (_, sd) in found.items()}
    for name in found:
        sys.stderr.write(f"{kind} {name}: {apart[name]:+.2f} sd, sd {wider[name]:.2f} times\n")
    assert max(map(abs, apart.values())) < UNCHANGED_SD
    assert 0.95 < min(wider.values()) <= max(wider.values()) < WIDER
