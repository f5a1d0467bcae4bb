"""Noise and residual scale of sequences with known statistics."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sysid.estimation.fit.optimum import Optimum
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_data import RunGroup
from sysid.estimation.weights.noise import instrument_noise, residual_scale, rolling_noise


def group(value: np.ndarray, measured: np.ndarray | None = None) -> RunGroup:
    """One run of the channels in the columns of `value` (T, C)."""
    mask = np.ones(value.shape, bool) if measured is None else measured
    shape = (value.shape[0], 1, value.shape[1])
    return RunGroup((0,), 0.005, (value * mask).reshape(shape), mask.reshape(shape), np.zeros(shape, np.int8))


def test_instrument_noise_ignores_a_drift():
    random = np.random.default_rng(9)
    count = 4000
    value = np.stack([0.3 * random.normal(size=count), np.zeros(count)], axis=1)
    value += np.linspace(0.0, 5.0, count)[:, None]
    found = instrument_noise(group(value), count * 0.005)[0]
    assert found[0] == pytest.approx(0.3, rel=0.05)
    assert found[1] < 0.01


def test_a_channel_without_readings_has_no_scale():
    value = np.random.default_rng(10).normal(size=(50, 2))
    mask = np.ones(value.shape, bool)
    mask[:, 1] = False
    g = group(value, mask)
    assert np.isinf(instrument_noise(g, 0.1)[0, 1])
    assert np.isinf(residual_scale(g, value[:, None])[0, 1])
    assert residual_scale(g, value[:, None])[0, 0] == pytest.approx(np.sqrt(np.mean(value[:, 0] ** 2)))


def test_a_late_start_takes_the_noise_of_the_quietest_stretch():
    """0.3 of noise all along, ten times as much in the middle; the quiet part before the bump has no reading."""
    value = np.random.default_rng(11).normal(size=(6000, 2)) * 0.3
    value[1500:4500] *= 10.0
    mask = np.ones(value.shape, bool)
    mask[:800, 1] = False
    mask[3, 1] = mask[4, 1] = True
    found = instrument_noise(group(value, mask), 500 * 0.005)[0]
    # The quietest of many stretches lies a little below.
    assert found[1] == pytest.approx(0.3, rel=0.12)
    assert found[0] == pytest.approx(np.sqrt(np.mean(np.diff(value[:500, 0]) ** 2) / 2.0), rel=1e-9)


def test_readings_that_never_follow_each_other_tell_no_noise_and_no_misfit():
    value = np.random.default_rng(12).normal(size=(200, 2))
    mask = np.ones(value.shape, bool)
    mask[1::2, 1] = False
    instrument = instrument_noise(group(value, mask), 0.25)
    assert np.isfinite(instrument[0, 0])
    assert np.isinf(instrument[0, 1])
    weights = Weights((2.0 * np.where(np.isinf(instrument), 1.0, instrument),), ())
    still = np.zeros_like(instrument)
    optimum = Optimum(SimpleNamespace(weights=weights), np.zeros(1), np.zeros(1), None, (instrument,), (still,))
    assert optimum.misfit == pytest.approx(2.0)
    rolling = replace(optimum, rolling=(1.6 * instrument,))
    assert (rolling.misfit, rolling.over_instruments) == (pytest.approx(1.25), pytest.approx(2.0))


def test_what_a_rolling_truck_shows_holds_slow_motion_that_differences_do_not():
    """Heave of 1.5 Hz and amplitude 3 under noise of 0.3: sqrt(9 / 2 + 0.09), and the bump after it does not count."""
    time = np.arange(2000) * 0.005
    value = (3.0 * np.sin(2 * np.pi * 1.5 * time) + np.random.default_rng(13).normal(size=2000) * 0.3)[:, None] + 7.0
    value[800:] += 50.0
    mask = np.ones(value.shape, bool)
    assert rolling_noise(group(value, mask), 4.0)[0, 0] == pytest.approx(np.sqrt(4.5 + 0.09), rel=0.02)
    assert instrument_noise(group(value, mask), 4.0)[0, 0] < 0.4
    mask[:795] = False
    assert rolling_noise(group(value, mask), 4.0)[0, 0] == 0.0


def test_no_scale_falls_below_a_thousandth_of_the_signal():
    value = np.sin(np.linspace(0, 20, 400))[:, None]
    assert residual_scale(group(value), 0.0 * value[:, None])[0, 0] == pytest.approx(1e-3 * value.std(), rel=1e-9)
