"""Sensors of pitch rate against the frame's accelerations: a body whose motion is known in closed form."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sysid.campaign import check_quality, read_campaign
from sysid.campaign.inputs.logs import make_log
from sysid.campaign.quality.pitch_rates import pitch_rate_suspicions
from sysid.campaign.records import BumpRun, Channel, Log, Sensor

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"
STEP = 0.005
VEHICLE = read_campaign(DATA).vehicle
NOISE = np.random.default_rng(4)
TIME = np.arange(1600) * STEP


def ring(frequency_hz, width_s, size):
    """Value, rate and acceleration of size exp(-u^2 / b^2) sin(w u), u from 4 s, in closed form."""
    u, w, b = TIME - 4.0, 2.0 * np.pi * frequency_hz, width_s
    e, s, c = size * np.exp(-((u / b) ** 2)), np.sin(w * u), np.cos(w * u)
    rate = e * (w * c - 2.0 * u / b**2 * s)
    return e * s, rate, e * ((4.0 * u**2 / b**4 - 2.0 / b**2 - w**2) * s - 4.0 * u * w / b**2 * c)


HEAVE, PITCH = ring(1.6, 0.9, 0.02), ring(2.3, 0.6, 0.015)


def channel(column, kind, unit, value, **place):
    noisy = value + 0.01 * np.std(value) * NOISE.standard_normal(value.size)
    return Channel(Sensor(column, kind, unit, **place), TIME, noisy, np.zeros(TIME.size, np.int8))


def log(factor=1.0, unit="deg/s", places=(0.0, 1.5, 3.8), rate=None, **changes) -> Log:
    frames = [
        channel(f"f{k}", "body_acceleration", "g", HEAVE[2] - PITCH[2] * (x - 1.7), body=0, x_m=x)
        for k, x in enumerate(places)
    ]
    shown = factor * PITCH[1] if rate is None else rate
    return Log("run.csv", STEP, (*frames, replace(channel("gyro", "pitch_rate", unit, shown, body=0), **changes)))


def said(of: Log) -> list[tuple[str, bool]]:
    found = pitch_rate_suspicions(of, of.channels, VEHICLE, frozenset())
    return [(s.sentence, s.rejected) for s in found.get("gyro", ())]


@pytest.mark.parametrize("factor", [1.0, 1.1, 0.9])
@pytest.mark.parametrize("places", [(0.0, 1.5, 3.8), (0.0, 3.8)])
def test_a_healthy_sensor_is_left_alone(factor, places):
    assert said(log(factor, places=places)) == []


@pytest.mark.parametrize(
    ("factor", "unit", "words"),
    [
        (-1.0, "deg/s", ("flipped", "set sign = -1")),
        (np.pi / 180.0, "deg/s", ("is in rad/s", 'set unit = "rad/s"')),
        (180.0 / np.pi, "rad/s", ("is in deg/s", 'set unit = "deg/s"')),
        (-180.0 / np.pi, "rad/s", ("is in deg/s", "sign is flipped")),
    ],
)
def test_signs_and_units_are_named(factor, unit, words):
    ((sentence, rejected),) = said(log(factor, unit))
    assert rejected
    assert "'gyro'" in sentence
    assert all(word in sentence for word in words)


def test_a_gain_is_said_and_the_sensor_is_used():
    ((sentence, rejected),) = said(log(1.6))
    assert not rejected
    assert "1.6 times" in sentence


def test_a_roll_rate_is_no_pitch_rate():
    roll = ring(1.1, 0.8, 0.03)[1]
    ((sentence, rejected),) = said(log(rate=roll))
    assert rejected
    assert "not roll or yaw" in sentence


def test_where_the_frame_says_too_little_nothing_is_said():
    # One point, points of another body, a witness that is accused itself, and a gap.
    assert said(log(-1.0, places=(0.0,))) == []
    gap = PITCH[1] * -1.0
    gap[780:800] = np.nan
    assert said(log(rate=gap)) == []
    whole = log(-1.0, places=(0.0, 3.8))
    assert pitch_rate_suspicions(whole, whole.channels, VEHICLE, frozenset({"f0"})) == {}


def test_the_check_rejects_a_flipped_sensor_and_keeps_a_right_one():
    for factor, verdict in ((1.0, "good"), (-1.0, "rejected")):
        run = BumpRun("case", "unloaded", 4.0, 1, log(factor))
        _, report = check_quality(replace(read_campaign(DATA), bump_runs=(run,), plank_drops=()))
        (found,) = (f for f in report.channels if f.column == "gyro")
        assert found.verdict == verdict, found.messages
        assert found.si_unit == "rad/s"


@pytest.mark.parametrize(("step", "part"), [(0.005, "channels"), (0.0025, "channels"), (0.02, "auxiliary")])
def test_a_slow_pitch_rate_is_no_channel_of_the_fit(step, part):
    time = np.arange(100) * step
    slow = Channel(Sensor("gyro", "pitch_rate", "deg/s", body=0), time, 0.0 * time, np.zeros(100, np.int8))
    made = make_log("run.csv", 0.005, [slow])
    assert len(getattr(made, part)) == 1
