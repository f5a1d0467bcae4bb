"""A wrong place is said as a wrong place: neither as a sign of healthy sensors nor as a gain of those beside it."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from sysid.bookkeeping import check_bookkeeping
from sysid.campaign import read_campaign
from sysid.campaign.quality.check import check_quality
from sysid.campaign.records import Campaign, Channel
from sysid.road.point_cloud import read_point_cloud

ROOT = Path(__file__).parents[2]


@lru_cache(maxsize=2)
def truck(name: str) -> Campaign:
    """Some runs at all speeds, without drops and scan."""
    campaign = read_campaign(ROOT / name, point_cloud_reader=read_point_cloud)
    return replace(campaign, plank_drops=(), scans={}, bump_runs=campaign.bump_runs[::2])


def said(campaign: Campaign) -> str:
    screened, report = check_quality(campaign)
    return "\n".join((*report.messages, *check_bookkeeping(screened, campaign).messages))


# Each of these was said as the sign of the axle's sensors, as their clock, or as a gain or place of sensors beside it.
@pytest.mark.parametrize(
    ("name", "axle", "by_m"),
    [
        ("examples/linear_truck", 1, 0.8),
        ("examples/linear_truck", 4, 0.8),
        ("examples/linear_truck", 4, -1.2),
        ("data", 0, 0.8),
        ("data", 3, 0.8),
    ],
)
def test_an_axle_off_its_place_is_no_wrong_sign(name: str, axle: int, by_m: float) -> None:
    campaign = truck(name)
    right = campaign.vehicle.axles[axle].x_m
    axles = tuple(replace(a, x_m=a.x_m + by_m * (i == axle)) for i, a in enumerate(campaign.vehicle.axles))
    text = said(replace(campaign, vehicle=replace(campaign.vehicle, axles=axles)))
    ((found, listed),) = re.findall(r"at (-?\d+\.\d+) m instead of (-?\d+\.\d+) m", text)
    assert float(found) == pytest.approx(right, abs=0.07)
    assert float(listed) == pytest.approx(right + by_m, abs=0.01)
    assert not re.search(r"wrong sign|times what|crosstalk|moves as the frame|clock of its sensors", text)


# In some runs the axle seems to fall at its listed place, as it leaves the bump there, or the frame sensor that is
# nearest to that place is another axle's: the first two were rejected, of the third a gain of 2.4 was said.
@pytest.mark.parametrize(("axle", "by_m"), [(2, 1.2), (3, 0.4), (2, -1.2)])
def test_no_sensor_of_an_axle_that_most_runs_show_elsewhere_is_accused(axle: int, by_m: float) -> None:
    campaign = read_campaign(ROOT / "data")
    axles = tuple(replace(a, x_m=a.x_m + by_m * (i == axle)) for i, a in enumerate(campaign.vehicle.axles))
    vehicle = replace(campaign.vehicle, axles=axles)
    _, report = check_quality(replace(campaign, vehicle=vehicle, plank_drops=(), scans={}))
    found = [m for f in report.channels for m in f.messages]
    assert found != []
    assert not [m for m in found if re.search(r"sign|times what|does not follow", m)]


def test_an_axle_whose_sensors_are_upside_down_is_at_its_place() -> None:
    def turned(c: Channel) -> Channel:
        ours = c.sensor.column in ("axle2_accel_g", "lvdt2_mm", "frame2_accel_g")
        return replace(c, value=-c.value) if ours else c

    campaign = truck("data")
    runs = [replace(r, log=replace(r.log, channels=tuple(map(turned, r.log.channels)))) for r in campaign.bump_runs]
    text = said(replace(campaign, bump_runs=tuple(runs)))
    assert "'axle2_accel_g' has the wrong sign" in text
    assert "m instead of" not in text


@pytest.mark.parametrize(("number", "by_m"), [(3, 1.2), (5, -1.2), (5, 1.2)])
def test_a_frame_sensor_off_its_place_accuses_no_other(number: int, by_m: float) -> None:
    """Its neighbours are compared with what it shows: the one whose move explains most is the wrong one."""
    campaign = truck("data")
    runs = []
    for run in campaign.bump_runs:
        channels = tuple(
            replace(c, sensor=replace(c.sensor, x_m=c.sensor.x_m + by_m))
            if c.sensor.column == f"frame{number}_accel_g"
            else c
            for c in run.log.channels
        )
        runs.append(replace(run, log=replace(run.log, channels=channels)))
    text = said(replace(campaign, bump_runs=tuple(runs)))
    assert re.findall(r"'(frame\d_accel_g)' moves as the frame does", text) == [f"frame{number}_accel_g"]
    assert "pitch_inertia" not in text
    assert "moves as the frame does" not in said(campaign)


@pytest.mark.parametrize("factor", [1e-3, 1 / 25.4, 0.5, 2.0])
def test_frame_sensors_that_are_all_off_their_places_are_named_with_them(factor: float) -> None:
    """None of them can be compared with the others: the frame above the axles, a + q'', says where each is."""

    def placed(c: Channel) -> Channel:
        frame = c.sensor.kind == "body_acceleration"
        return replace(c, sensor=replace(c.sensor, x_m=factor * c.sensor.x_m)) if frame else c

    campaign = truck("examples/linear_truck")
    runs = [replace(r, log=replace(r.log, channels=tuple(map(placed, r.log.channels)))) for r in campaign.bump_runs[:2]]
    text = said(replace(campaign, bump_runs=tuple(runs)))
    (sentence,) = re.findall(r"('frame.*) move as the frame does at x_m = (.*) m, not at the listed", text)
    names, found = re.findall(r"frame(\d)", sentence[0]), re.findall(r"[\d.]+", sentence[1])
    right = [campaign.vehicle.axles[int(n) - 1].x_m for n in names]
    assert len(names) > 1
    np.testing.assert_allclose([float(v) for v in found], right, atol=0.3)
