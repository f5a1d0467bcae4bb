"""Healthy sensors stay healthy where a logger has lost rows or cells while an axle is on the bump."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from sysid.bookkeeping import check_bookkeeping
from sysid.bookkeeping.places import runs_without_bump
from sysid.campaign import read_campaign
from sysid.campaign.passage.arrivals import find_passage
from sysid.campaign.quality.check import check_quality
from sysid.campaign.records import BumpRun, Campaign, Channel
from sysid.road.point_cloud import read_point_cloud

ROOT = Path(__file__).parents[2]
#: What may be said of a record that lacks readings.
_GAPS = re.compile(r"rows are missing|is lost|readings? (is|are) missing")


@lru_cache(maxsize=1)
def truck() -> Campaign:
    """Four runs of the linear truck, over its scan."""
    campaign = read_campaign(ROOT / "examples" / "linear_truck", point_cloud_reader=read_point_cloud)
    return replace(campaign, plank_drops=(), bump_runs=campaign.bump_runs[:4])


def said(campaign: Campaign) -> set[str]:
    screened, report = check_quality(campaign)
    channels = {f"{f.file}, {f.column}: {m}" for f in report.channels for m in f.messages}
    return {*report.messages, *channels, *check_bookkeeping(screened, campaign).messages}


def without(run: BumpRun, columns: set[str] | None, begin: float, end: float) -> BumpRun:
    """A run without the cells of some columns, or without whole rows."""

    def lose(c: Channel) -> Channel:
        kept = (c.time_s < begin) | (c.time_s > end)
        if columns is None:
            return replace(c, time_s=c.time_s[kept], value=c.value[kept], censored=c.censored[kept])
        return replace(c, value=np.where(kept, c.value, np.nan)) if c.sensor.column in columns else c

    return replace(run, log=replace(run.log, channels=tuple(map(lose, run.log.channels))))


def with_gaps(campaign: Campaign, seed: int, rows: int, whole_rows: bool) -> Campaign:
    """Gaps of so many rows while an axle is on the bump, in every run."""
    rng = np.random.default_rng(seed)
    runs = []
    for run in campaign.bump_runs:
        passage = find_passage(run.log.channels, campaign.vehicle, run.nominal_speed_m_s)
        assert passage is not None
        axle = int(rng.choice(list(passage.arrivals)))
        begin = passage.arrivals[axle].time_s + rng.uniform(-0.05, 0.25)
        of_axle = [c.sensor.column for c in run.log.channels if c.sensor.axle == axle]
        columns = None if whole_rows else {str(rng.choice(of_axle))}
        runs.append(without(run, columns, begin, begin + 0.005 * rows))
    return replace(campaign, bump_runs=tuple(runs))


# Each of these draws accused between one and five healthy sensors, axles or runs when readings were interpolated.
@pytest.mark.parametrize(("seed", "rows", "whole_rows"), [(5, 20, True), (5, 60, True), (6, 20, True), (7, 40, True)])
def test_gaps_on_the_bump_accuse_nobody(seed: int, rows: int, whole_rows: bool) -> None:
    new = said(with_gaps(truck(), seed, rows, whole_rows)) - said(truck())
    assert {x for x in new if not _GAPS.search(x)} == set()
    assert new


def test_a_wrong_gain_is_still_named_beside_gaps() -> None:
    def louder(c: Channel) -> Channel:
        return replace(c, value=1.25 * c.value) if c.sensor.column == "axle4_accel_g" else c

    campaign = with_gaps(truck(), 5, 20, True)
    runs = [replace(r, log=replace(r.log, channels=tuple(map(louder, r.log.channels)))) for r in campaign.bump_runs]
    (sentence,) = [x for x in said(replace(campaign, bump_runs=tuple(runs))) if "times what" in x]
    (factor,) = re.findall(r"'axle4_accel_g' reads (\d\.\d+) times", sentence)
    assert float(factor) == pytest.approx(1.25, abs=0.03)


def test_a_log_whose_bump_is_missing_is_no_standing_truck() -> None:
    def quiet(c: Channel) -> Channel:
        return replace(c, value=np.resize(c.value[c.time_s < 0.8], c.value.size))

    standing = truck().bump_runs[1]
    standing = replace(standing, log=replace(standing.log, channels=tuple(map(quiet, standing.log.channels))))
    for run, count in ((standing, 1), (without(standing, None, 1.0, 5.0), 0)):
        runs = [run if r.log.file == run.log.file else r for r in truck().bump_runs]
        assert len(runs_without_bump(runs, {})) == count
