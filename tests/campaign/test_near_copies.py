"""Logs that are changed copies of another, and repeats of one run, which are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sysid.campaign.quality.copies import copied_logs
from sysid.campaign.records import BumpRun, Channel, Log, Sensor

STEP_S = 0.005
SENSORS = (
    Sensor("q", "suspension_deflection", "mm", axle=0),
    Sensor("a", "axle_acceleration", "m/s^2", axle=0),
    Sensor("b", "body_acceleration", "m/s^2", body=0, x_m=0.0),
)


def run(name: str, seed: int, idling: bool = True) -> BumpRun:
    """A pass that is the same every time but for the noise: 2 s of rest, a decay of body and wheel, and rest."""
    random = np.random.default_rng(seed)
    time = STEP_S * np.arange(1200)
    since = np.maximum(time - 2.0, 0.0)
    motion = np.exp(-1.2 * since) * np.sin(10.0 * since) + np.exp(-5.0 * since) * np.sin(63.0 * since)
    tone = 0.02 * np.sin(2.0 * np.pi * 38.0 * time) if idling else 0.0
    channels = []
    for sensor, size in zip(SENSORS, (0.02, 8.0, 1.5), strict=True):
        value = size * (motion + tone + 0.005 * random.standard_normal(time.size))
        channels.append(Channel(sensor, time, value, np.zeros(time.size, np.int8)))
    return BumpRun(name, "empty", 4.0, 1, Log(f"{name}.csv", STEP_S, tuple(channels)), "")


def changed(of: BumpRun, change) -> BumpRun:
    """A copy under another name whose stamps and readings are changed."""
    channels = []
    for c in of.log.channels:
        time, value = change(c.time_s, c.value)
        channels.append(replace(c, time_s=time - time[0], value=value, censored=np.zeros(value.size, np.int8)))
    step = float(np.median(np.diff(channels[0].time_s)))
    return replace(of, log=replace(of.log, file="copy.csv", sample_interval_s=step, channels=tuple(channels)))


def with_noise(time, value):
    return time, value + 0.005 * np.ptp(value) / 2.0 * np.random.default_rng(9).standard_normal(value.size)


def at_other_times(time, value):
    other = np.arange(time[0] + 0.0013, time[-1], 0.0061)
    return other, np.interp(other, time, value)


CHANGES = {
    "scaled": lambda t, v: (t, 1.3 * v),
    "trimmed": lambda t, v: (t[60:-100], v[60:-100]),
    "every second row": lambda t, v: (t[::2], v[::2]),
    "resampled": at_other_times,
    "with as much noise again": with_noise,
    "shifted and rounded": lambda t, v: (t[7:], np.round(v[7:], 4) + 1.0),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_changed_copies_are_named(change) -> None:
    first = run("first", 1)
    said = copied_logs([first, run("second", 2), changed(first, change)])
    assert len(said) == 1
    assert said[0].startswith("copy.csv and first.csv are one record")


def test_repeats_of_a_run_are_no_copies() -> None:
    """The same motion and idling at the same speed, in 4950 pairs; and records without any noise."""
    assert copied_logs([run(f"run{i}", i) for i in range(100)]) == []
    still = [changed(run(f"run{i}", 5, idling=False), lambda t, v, i=i: (t, np.round(v, 1) + i)) for i in range(2)]
    still = [replace(r, log=replace(r.log, file=f"still{i}.csv")) for i, r in enumerate(still)]
    assert copied_logs(still) == []


def test_two_cuts_of_one_record_that_overlap_are_one_record() -> None:
    whole = run("whole", 3)
    early, late = (changed(whole, lambda t, v, s=s: (t[s], v[s])) for s in (slice(0, 700), slice(250, None)))
    early = replace(early, log=replace(early.log, file="early.csv"))
    (sentence,) = copied_logs([early, late])
    assert "or both are cut from one log and overlap" in sentence
