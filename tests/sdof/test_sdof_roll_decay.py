"""Measured free decays of another field (see tests/data/roll_decay/PROVENANCE.md) with known period and decrement."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sysid.sdof import read_decay

DATA = Path(__file__).parents[1] / "data" / "roll_decay"


def record(name, step=None):
    time, phi = np.loadtxt(DATA / f"roll_{name}.csv", delimiter=",", skiprows=1, unpack=True)
    if step is None:
        return time, phi
    fine = np.arange(time[0], time[-1], step)
    return fine, np.interp(fine, time, phi)


@pytest.mark.parametrize("step", [None, 0.005])
@pytest.mark.parametrize(
    ("name", "window", "period", "decrement"),
    [("21337", None, 2.5442, 0.0352), ("21340", (0.0, 76.0), 2.5450, 0.0827)],
)
def test_period_and_mean_decrement(name, window, period, decrement, step):
    reading = read_decay(*record(name, step), window_s=window)
    assert reading.damped_period == pytest.approx(period, rel=0.002)
    assert reading.log_decrement == pytest.approx(decrement, rel=0.02)
    cycles = (reading.used.sum() - 1) / 2
    assert cycles == pytest.approx(25 if name == "21337" else 20, abs=1.0)


def test_zero_speed_damping_falls_with_the_amplitude():
    reading = read_decay(*record("21337"))
    assert reading.damping_kind == "quadratic"
    assert reading.decrement_trend > 5 * reading.decrement_trend_se


def test_decrement_at_speed_is_nearly_constant():
    reading = read_decay(*record("21340"), window_s=(0.0, 76.0))
    assert reading.damping_kind == "viscous"
    assert reading.log_decrement_se < 0.02 * reading.log_decrement


def test_the_quiet_start_is_not_read():
    reading = read_decay(*record("21340"), window_s=(0.0, 76.0))
    assert reading.extremum_time_s[reading.used][0] == pytest.approx(23.1, abs=0.1)
