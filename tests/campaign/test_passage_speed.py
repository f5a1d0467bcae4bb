"""Listed speeds against the moments at which axles meet the bump."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sysid.campaign import read_campaign
from sysid.campaign.passage.arrivals import find_passage
from sysid.campaign.passage.speed import passage_speed, speed_complaint
from sysid.campaign.quality.check import check_quality
from sysid.campaign.records import BumpRun, Channel, Log, Sensor
from sysid.campaign.vehicle_records import Axle, Body, Vehicle

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"
PASSAGES = Path(__file__).parents[1] / "data" / "passages"
SPEED, STEP = 4.5, 0.005
PLACES = (0.0, 4.2, 5.5)


def truck(places=PLACES):
    axles = tuple(Axle(f"axle {i}", 0, x, 500.0, 2e6, 3e3, 0.5, "leaf") for i, x in enumerate(places))
    return Vehicle("truck", (Body("body"),), axles)


def run(places=PLACES, listed=SPEED, speed=SPEED, late=()):
    """A run of axles that ring once the bump has met them at their place and the true speed."""
    time = np.arange(1200) * STEP
    channels = []
    for i, x in enumerate(places):
        met = 1.0 + x / speed + dict(late).get(i, 0.0)
        after = np.clip(time - met, 0.0, None)
        value = 30.0 * np.exp(-4.0 * after) * np.sin(2.0 * np.pi * 10.0 * after)
        sensor = Sensor(f"a{i}", "axle_acceleration", "m/s^2", axle=i)
        channels.append(Channel(sensor, time, value, np.zeros(time.size, np.int8)))
    return BumpRun("case", "empty", listed, 1, Log("run.csv", STEP, tuple(channels)))


@pytest.mark.parametrize("speed", [1.2, 4.5, 11.0])
def test_speed_from_the_arrivals(speed):
    made = run(speed=speed)
    assert passage_speed(made.log.channels, truck(), speed) == pytest.approx(speed, rel=0.02)
    assert speed_complaint(replace(made, nominal_speed_m_s=speed), truck()) is None


@pytest.mark.parametrize(
    ("factor", "word", "hopeless"),
    [
        (3.6, "looks like m/s", True),
        (1.609, "looks like mph", True),
        (1.18, "its speed is searched for", False),
        (0.5, "", True),
    ],
)
def test_a_listed_speed_in_another_unit_is_said(factor, word, hopeless):
    sentence, out = speed_complaint(run(listed=SPEED / factor), truck())
    assert out is hopeless
    assert word in sentence
    assert f"{3.6 * SPEED:.3g}"[:3] in sentence
    assert "nominal_speed_km_h" in sentence


def test_axles_that_contradict_each_other_say_nothing():
    assert passage_speed(run(late=((1, 0.3),)).log.channels, truck(), SPEED) is None


def test_two_axles_alone_must_be_far_off():
    two = PLACES[:2]
    assert speed_complaint(run(two, listed=SPEED / 1.2), truck(two)) is None
    assert speed_complaint(run(two, listed=SPEED / 2.0), truck(two))[1]


def test_runs_of_the_linear_truck_agree_with_their_lists_and_not_with_others():
    campaign = read_campaign(DATA)
    kept, report = check_quality(campaign)
    assert len(kept.bump_runs) == len(campaign.bump_runs)
    assert report.left_out == ()
    slow = tuple(replace(r, nominal_speed_m_s=r.nominal_speed_m_s / 3.6) for r in campaign.bump_runs)
    kept, report = check_quality(replace(campaign, bump_runs=slow))
    assert kept.bump_runs == ()
    assert len(report.left_out) == len(slow)


def test_arrivals_and_signs_of_the_axles():
    passage = find_passage(run().log.channels, truck(), SPEED)
    assert passage is not None
    times = [passage.arrivals[i].time_s for i in range(3)]
    assert np.diff(times) == pytest.approx(np.diff(PLACES) / SPEED, abs=0.003)
    assert all(a.upward == 1 for a in passage.arrivals.values())


def test_an_axle_with_the_wrong_sign_falls_where_it_is_lifted():
    made = run()
    channels = tuple(replace(c, value=-c.value) if c.sensor.axle == 1 else c for c in made.log.channels)
    passage = find_passage(channels, truck(), SPEED)
    assert passage is not None
    assert [passage.arrivals[i].upward for i in range(3)] == [1, -1, 1]


def test_the_end_of_a_low_long_bump_is_not_its_begin():
    """The front axle moves most where it leaves the bump, and the run seemed to be driven at 28 km/h."""
    table = np.loadtxt(PASSAGES / "low_long_bump.csv", delimiter=",", skiprows=1)
    channels = [
        Channel(Sensor(f"a{i}", "axle_acceleration", "g", axle=i), table[:, 0], 9.81 * table[:, i + 1], np.zeros(
            len(table), np.int8)) for i in range(3)
    ]  # fmt: skip
    passage = find_passage(channels, truck((0.0, 4.2, 5.55)), 20 / 3.6)
    assert passage is not None
    assert 3.6 * passage.speed_m_s == pytest.approx(20.0, rel=0.05)
    assert all(a.upward == 1 for a in passage.arrivals.values())


def test_axles_from_the_rear_have_a_negative_speed():
    from_rear = truck([5.5 - x for x in PLACES])
    passage = find_passage(run().log.channels, from_rear, SPEED)
    assert passage is not None
    assert passage.speed_m_s == pytest.approx(-SPEED, rel=0.02)


def test_axle_sensors_alone_do_not_reject_the_first_axle_of_a_fast_run():
    """Its rest before the bump was once read up to the motion of the second axle."""
    campaign = read_campaign(DATA)
    fast = next(r for r in campaign.bump_runs if r.nominal_speed_m_s > 8.0)
    channels = tuple(c for c in fast.log.channels if c.sensor.kind == "axle_acceleration")
    alone = replace(campaign, plank_drops=(), bump_runs=(replace(fast, log=replace(fast.log, channels=channels)),))
    _, report = check_quality(alone)
    assert {f.verdict for f in report.channels} <= {"good", "usable"}
    first = next(f for f in report.channels if f.column == "axle1_accel_g")
    assert first.noise_rms is not None
    assert first.noise_rms < 0.5
