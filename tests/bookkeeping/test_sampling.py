"""Motion above half the rate of a log, and filters that cannot keep it away."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from sysid.bookkeeping.sampling import sampling_complaints
from sysid.campaign.records import AntiAliasFilter, BumpRun, Channel, Log, Sensor


def run(number: int, filtered: bool, rattle: float) -> BumpRun:
    """Wheel hop, and a share of rattle at 180 Hz, moved at 10 kHz, with noise, read at 200 Hz."""
    random = np.random.default_rng(number)
    fine = np.arange(0.0, 5.0, 1e-4)
    since = np.maximum(fine - 2.0, 0.0)
    moved = 30.0 * np.exp(-4.0 * since) * (np.sin(63.0 * since) + rattle * np.sin(2.0 * np.pi * 188.0 * since))
    if filtered:
        moved = lfilter(*butter(4, 60.0, fs=1e4), moved)
    value = moved[::50] + 0.05 * random.standard_normal(moved[::50].size)
    time = 0.005 * np.arange(value.size)
    channel = Channel(Sensor("a", "axle_acceleration", "m/s^2", axle=0), time, value, np.zeros(value.size, np.int8))
    return BumpRun(f"run{number}", "empty", 4.0, 1, Log(f"run{number}.csv", 0.005, (channel,)), "")


@pytest.mark.parametrize(
    ("filtered", "rattle", "named"), [(False, 0.2, False), (False, 0.9, False), (True, 0.9, False)]
)
def test_what_is_folded_far_from_half_the_rate_cannot_be_told(filtered: bool, rattle: float, named: bool) -> None:
    """188 Hz appears as 12 Hz: the reason to look near half the rate, where a broad motion shows too."""
    assert bool(sampling_complaints([run(i, filtered, rattle) for i in range(4)], None)) is named


def test_broad_motion_above_half_the_rate_is_named() -> None:
    def impacts(number: int, filtered: bool) -> BumpRun:
        random = np.random.default_rng(number)
        plain = run(number, filtered, 0.0)
        fine = np.zeros(50_000)
        fine[random.integers(20_000, 40_000, 40)] = random.normal(0.0, 1000.0, 40)
        fine = lfilter(*butter(2, 300.0, fs=1e4), fine)
        more = lfilter(*butter(4, 60.0, fs=1e4), fine) if filtered else fine
        (channel,) = plain.log.channels
        channel = Channel(channel.sensor, channel.time_s, channel.value + more[::50], channel.censored)
        return BumpRun(plain.case, "empty", 4.0, 1, Log(plain.log.file, 0.005, (channel,)), "")

    (sentence,) = sampling_complaints([impacts(i, False) for i in range(4)], None)
    assert sentence.startswith("Near half the rate of the logs (200 Hz)")
    assert sampling_complaints([impacts(i, True) for i in range(4)], None) == []


def test_a_cut_off_near_half_the_rate_is_named() -> None:
    runs = [run(0, True, 0.0)]
    (sentence,) = sampling_complaints(runs, AntiAliasFilter("butterworth", 4, 80.0))
    # |H| of a Butterworth filter of order n at f: 1 / sqrt(1 + (f / fc)^2n).
    assert f"passes {100.0 / np.sqrt(1.0 + 1.25**8):.0f}%" in sentence
    assert sampling_complaints(runs, AntiAliasFilter("butterworth", 4, 60.0)) == []
