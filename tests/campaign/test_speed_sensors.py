"""Logged speeds against runs whose motion is known: factor, delay, units, changes of speed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sysid.campaign import read_campaign
from sysid.campaign.passage.speed_sensors import with_logged_speeds
from sysid.campaign.quality.check import check_quality
from sysid.campaign.records import BumpRun, Channel, Log, Sensor
from sysid.campaign.vehicle_records import Axle, Body, Vehicle
from sysid.estimation.residuals.run_motion import motion_prior

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"
STEP = 0.005
PLACES = (0.0, 4.2, 5.5)
SPEEDS = (2.3, 4.4, 6.7, 8.9, 4.5, 6.6)


def driven(number, speed, logged, sensors="axles", listed=None, unit="m/s", rate_hz=10.0, delay_s=0.2):
    """A run at constant `speed`: axles that ring when the bump meets them; `logged` is a function of the true speed.

    The speed falls to zero from 2 s after the last axle on, and the logger shows it `delay_s` late.
    """
    time = np.arange(2400) * STEP
    channels = []
    for i, x in enumerate(PLACES if sensors == "axles" else PLACES[:1]):
        after = np.clip(time - 1.0 - x / speed, 0.0, None)
        value = 30.0 * np.exp(-4.0 * after) * np.sin(2.0 * np.pi * 10.0 * after)
        sensor = Sensor(f"a{i}", "axle_acceleration", "m/s^2", axle=i)
        channels.append(Channel(sensor, time, value, np.zeros(time.size, np.int8)))
    slow = np.arange(0.0, 12.0, 1.0 / rate_hz)
    stops = 1.0 + PLACES[-1] / speed + 2.0
    true = speed * np.clip(1.0 - np.clip(slow - delay_s - stops, 0.0, None) / 2.0, 0.0, 1.0)
    v = Channel(Sensor("v", "speed", unit), slow, logged(true), np.zeros(slow.size, np.int8))
    log = Log(f"run{number}.csv", STEP, tuple(channels), auxiliary=(v,))
    return BumpRun("case", "unloaded", listed or speed, 1, log)


def campaign(runs):
    axles = tuple(Axle(f"axle {i}", 0, x, 500.0, 2e6, 3e3, 0.5, "leaf") for i, x in enumerate(PLACES))
    return replace(
        read_campaign(DATA), vehicle=Vehicle("truck", (Body("body"),), axles), bump_runs=tuple(runs), plank_drops=()
    )


@pytest.mark.parametrize("factor", [0.95, 1.0, 1.04])
@pytest.mark.parametrize("delay_s", [0.0, 0.4])
def test_the_factor_of_a_wheel_sensor_is_found_from_the_arrivals(factor, delay_s):
    runs = [
        driven(i, v, lambda w: factor * w, delay_s=delay_s, listed=round(2.0 * v) / 2.0) for i, v in enumerate(SPEEDS)
    ]
    found = with_logged_speeds(campaign(runs))
    (sensor,) = found.sensors
    # Arrivals are read to some three per cent, and the factor is thought to be near 1.
    assert sensor.factor == pytest.approx(factor, abs=0.015)
    assert abs(np.log(sensor.factor / factor)) < 2.0 * sensor.factor_sd
    assert 0.005 < sensor.factor_sd < 0.02
    assert sensor.runs == len(SPEEDS)
    for run, true in zip(found.campaign.bump_runs, SPEEDS, strict=True):
        assert run.logged_speed_m_s == pytest.approx(true, rel=0.025)
        assert abs(np.log(run.logged_speed_m_s / true)) < 2.0 * run.speed_sd < 0.06
        assert run.nominal_speed_m_s == round(2.0 * true) / 2.0
    # The prior of the search is about the logged speed, not about the rounded one.
    prior = motion_prior(found.campaign.bump_runs)
    assert prior.speed_m_s == pytest.approx([r.logged_speed_m_s for r in found.campaign.bump_runs])
    assert prior.speed_m_s[0] != pytest.approx(2.5, rel=0.03)


def test_one_run_does_not_calibrate_its_own_prior():
    runs = [driven(i, v, lambda w: 1.04 * w) for i, v in enumerate(SPEEDS)]
    alone = with_logged_speeds(campaign(runs[:1])).campaign.bump_runs[0]
    # Of a single run the factor is known as little as before; its listed speed says as much.
    assert alone.logged_speed_m_s is None
    assert alone.speed_sd == 0.03
    unlisted = replace(runs[0], speed_listed=False)
    without = with_logged_speeds(campaign([unlisted])).campaign.bump_runs[0]
    assert without.logged_speed_m_s == pytest.approx(1.04 * SPEEDS[0], rel=0.01)
    assert without.speed_sd > 0.03


def test_a_run_with_one_axle_sensor_takes_the_factor_of_the_others():
    runs = [driven(i, v, lambda w: 1.04 * w) for i, v in enumerate(SPEEDS)]
    blind = driven(9, 5.0, lambda w: 1.04 * w, sensors="one", listed=5.3)
    last = with_logged_speeds(campaign([*runs, blind])).campaign.bump_runs[-1]
    assert last.logged_speed_m_s == pytest.approx(5.0, rel=0.015)
    assert last.speed_sd < 0.025


@pytest.mark.parametrize(
    ("declared", "true", "count"),
    [("km/h", "m/s", 1.0), ("m/s", "km/h", 3.6), ("km/h", "mph", 3600.0 / 1609.344), ("mph", "km/h", 3.6)],
)
def test_a_sensor_in_another_unit_is_named_and_not_used(declared, true, count):
    per_m_s = {"km/h": 3.6, "m/s": 1.0, "mph": 3600.0 / 1609.344}[declared]
    runs = [driven(i, v, lambda w: w * count / per_m_s, unit=declared) for i, v in enumerate(SPEEDS)]
    found = with_logged_speeds(campaign(runs))
    (sentence,) = found.messages
    assert "'v'" in sentence
    assert f"set unit = '{true}'" in sentence
    assert found.sensors == ()
    assert all(r.logged_speed_m_s is None for r in found.campaign.bump_runs)


@pytest.mark.parametrize(("factor", "word"), [(1.609344, "looks like mph"), (3.6, "looks like m/s"), (1.25, "")])
def test_one_run_that_is_listed_wrong_is_named(factor, word):
    right = [driven(i, v, lambda w: w) for i, v in enumerate(SPEEDS)]
    wrong = driven(7, 5.0, lambda w: w, sensors="one", listed=5.0 / factor)
    found = with_logged_speeds(campaign([*right, wrong]))
    (sentence,) = found.messages
    assert sentence.startswith("run7.csv: 'v' logs ")
    assert word in sentence
    assert "nominal_speed_km_h" in sentence


def test_a_sensor_that_fails_in_one_run_is_named():
    runs = [driven(i, v, lambda w: w) for i, v in enumerate(SPEEDS)]
    runs[2] = driven(2, SPEEDS[2], lambda w: 0.7 * w)
    found = with_logged_speeds(campaign(runs))
    (sentence,) = found.messages
    assert sentence.startswith("run2.csv")
    assert "the sensor is not used in this run" in sentence
    assert found.campaign.bump_runs[2].logged_speed_m_s is None
    assert found.campaign.bump_runs[1].logged_speed_m_s is not None


def test_braking_on_the_bump_widens_the_prior_of_the_change():
    # 6 % slower from the first arrival to the last, by the closed form of a constant deceleration.
    speed, passage = 4.4, PLACES[-1] / 4.4
    braked = driven(0, speed, lambda w: w, delay_s=0.25)
    time = braked.log.auxiliary[0].time_s
    value = speed * (1.0 - 0.12 * (time - 1.25 - 0.5 * passage) / passage)
    change = replace(braked.log.auxiliary[0], value=np.clip(value, 0.5, None))
    runs = [replace(braked, log=replace(braked.log, auxiliary=(change,)))]
    runs += [driven(i, v, lambda w: w) for i, v in enumerate(SPEEDS[1:], 1)]
    found = with_logged_speeds(campaign(runs))
    assert found.campaign.bump_runs[0].speed_change_sd == pytest.approx(0.12, abs=0.01)
    assert [r.speed_change_sd for r in found.campaign.bump_runs[1:]] == [0.02] * 5
    assert "-12 %" in " ".join(found.messages)
    # The prior is that of the speed at axle 1, 6 % above the mean.
    assert found.campaign.bump_runs[0].logged_speed_m_s == pytest.approx(1.06 * speed, rel=0.02)


def test_a_gps_of_one_reading_per_second_is_less_certain_than_one_of_ten():
    sds = []
    for rate, logged in ((1.0, lambda w: np.round(w * 3.6) / 3.6), (10.0, lambda w: w)):
        runs = [driven(i, v, logged, rate_hz=rate) for i, v in enumerate(SPEEDS)]
        sds.append(with_logged_speeds(campaign(runs)).campaign.bump_runs[1].speed_sd)
    assert sds[0] > sds[1]


def test_without_a_speed_sensor_nothing_changes():
    runs = [driven(i, v, lambda w: w) for i, v in enumerate(SPEEDS)]
    bare = campaign([replace(r, log=replace(r.log, auxiliary=())) for r in runs])
    found = with_logged_speeds(bare)
    assert found.campaign is bare
    assert found.messages == ()
    _, report = check_quality(bare)
    assert report.speed_sensors == ()
