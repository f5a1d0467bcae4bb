"""Noise, residual scale and residual correlation of sequences with known statistics."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.estimation.noise import autocorrelation, instrument_noise, residual_scale, variance_inflation
from sysid.estimation.run_data import RunGroup


def group(value: np.ndarray, measured: np.ndarray | None = None) -> RunGroup:
    """One run of the channels in the columns of `value` (T, C)."""
    mask = np.ones(value.shape, bool) if measured is None else measured
    shape = (value.shape[0], 1, value.shape[1])
    return RunGroup((0,), 0.005, (value * mask).reshape(shape), mask.reshape(shape), np.zeros(shape, np.int8))


def ar1(rho: float, count: int, seed: int) -> np.ndarray:
    """A first-order autoregressive sequence of unit variance."""
    noise = np.random.default_rng(seed).normal(size=count + 500) * np.sqrt(1 - rho**2)
    return lfilter([1.0], [1.0, -rho], noise)[500:]


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8, 0.95])
def test_variance_inflation_of_the_exact_autocorrelation(rho: float):
    """(1 + rho) / (1 - rho) for an AR(1) sequence."""
    correlation = (rho ** np.arange(800))[:, None, None]
    assert variance_inflation(correlation)[0, 0] == pytest.approx((1 + rho) / (1 - rho), rel=1e-9)


@pytest.mark.parametrize("rho", [0.0, 0.6, 0.9])
def test_variance_inflation_of_a_long_sequence(rho: float):
    sequences = np.stack([ar1(rho, 100_000, seed) for seed in range(3)], axis=1)
    g = group(sequences)
    correlation = autocorrelation(g, sequences[:, None, :], 200)
    np.testing.assert_allclose(correlation[0], 1.0)
    np.testing.assert_allclose(correlation[1:6].mean(axis=-1)[:, 0], rho ** np.arange(1, 6), atol=0.02)
    assert variance_inflation(correlation).mean() == pytest.approx((1 + rho) / (1 - rho), rel=0.1, abs=0.05)


def test_alternating_residuals_are_never_better_than_independent():
    assert variance_inflation(((-0.5) ** np.arange(100))[:, None, None])[0, 0] == 1.0


def test_missing_samples_bias_no_correlation():
    sequence = ar1(0.8, 60_000, 7)[:, None]
    mask = np.random.default_rng(8).random(sequence.shape) > 0.3
    found = autocorrelation(group(sequence, mask), (sequence * mask)[:, None], 10)[:, 0, 0]
    np.testing.assert_allclose(found, 0.8 ** np.arange(10), atol=0.03)


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
    assert np.isfinite(autocorrelation(g, (value * mask)[:, None], 10)).all()


def test_no_scale_falls_below_a_thousandth_of_the_signal():
    value = np.sin(np.linspace(0, 20, 400))[:, None]
    assert residual_scale(group(value), 0.0 * value[:, None])[0, 0] == pytest.approx(1e-3 * value.std(), rel=1e-9)
