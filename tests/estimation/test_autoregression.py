"""Autoregressive models of sequences whose spectrum, order and variances are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_toeplitz, toeplitz
from scipy.signal import freqz, lfilter

from sysid.estimation.weights.autoregression import (
    autocorrelation,
    autoregression,
    fitted_autoregression,
    variance_inflation,
)

#: A resonance at a tenth of the sampling rate, and a slow decay.
PHI = np.array([1.45, -0.8])


def process(phi: np.ndarray, count: int, seed: int) -> np.ndarray:
    """An autoregressive sequence (count,) with innovations of unit variance."""
    noise = np.random.default_rng(seed).normal(size=count + 500)
    return lfilter([1.0], [1.0, *-phi], noise)[500:]


def modelled(sequence: np.ndarray, lags: int = 60):
    return fitted_autoregression(np.ones(sequence.shape, bool), sequence, lags)


def test_coefficients_solve_the_equations_of_yule_and_walker():
    """Every order's coefficients from SciPy's Toeplitz solver."""
    rho = autocorrelation(np.ones(4000, bool), process(PHI, 4000, 1), 12)
    found = autoregression(rho, np.asarray(4000))
    order = int(found.order)
    assert order >= 2
    np.testing.assert_allclose(found.coefficients[:order], solve_toeplitz(rho[:order], rho[1 : order + 1]), rtol=1e-9)
    assert found.innovation == pytest.approx(1.0 - found.coefficients[:order] @ rho[1 : order + 1], rel=1e-9)


@pytest.mark.parametrize(("phi", "order"), [(np.zeros(0), 0), (np.array([0.6]), 1), (PHI, 2)])
def test_order_is_that_of_the_process(phi: np.ndarray, order: int):
    """The criterion is consistent: of 40 long sequences nearly all get the true order, none a lower one."""
    found = modelled(np.stack([process(phi, 5000, seed) for seed in range(40)], axis=1)).order
    assert (found == order).sum() >= 36
    assert found.min() == order


def test_spectrum_is_that_of_the_process():
    """Against SciPy's frequency response of the generating filter."""
    found = modelled(process(PHI, 400_000, 5)[:, None])
    w, response = freqz([1.0], [1.0, *-PHI], worN=200)
    power = np.abs(response) ** 2
    np.testing.assert_allclose(found.spectrum(w / (2 * np.pi))[:, 0], power / power.mean(), rtol=0.06)


def test_innovations_are_white_and_are_those_put_in():
    noise = np.random.default_rng(6).normal(size=20_500)
    sequence = lfilter([1.0], [1.0, *-PHI], noise)[500:]
    innovations = modelled(sequence[:, None]).innovations(np.ones((20_000, 1), bool), sequence[:, None])[:, 0]
    known = np.isfinite(innovations)
    np.testing.assert_allclose(innovations[known], noise[500:][known], atol=0.15)
    left = autocorrelation(known, np.where(known, innovations, 0.0), 20)
    assert np.abs(left[1:]).max() < 4.0 / np.sqrt(known.sum())


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_inflation_of_a_constant_is_that_of_a_mean(rho: float):
    """(1 + rho) / (1 - rho) for the mean of an AR(1) sequence."""
    exact = autoregression((rho ** np.arange(30))[:, None], np.array([10_000]))
    constant = np.ones((5000, 1, 1))
    assert variance_inflation(exact, constant)[0] == pytest.approx((1 + rho) / (1 - rho), rel=1e-9)


@pytest.mark.parametrize("cycles", [0.02, 0.1, 0.3])
def test_inflation_is_the_variance_of_a_score_over_that_of_white_residuals(cycles: float):
    """J' r over many sequences, for a column J that swings at one frequency; never below 1."""
    count = 1000
    column = np.hanning(count) * np.sin(2 * np.pi * cycles * np.arange(count))
    sequences = np.stack([process(PHI, count, seed) for seed in range(3000)], axis=1)
    ratio = np.var(column @ sequences) / (np.var(sequences) * column @ column)
    exact = modelled(process(PHI, 400_000, 5)[:, None])
    found = float(variance_inflation(exact, column[:, None, None])[0])
    assert found == pytest.approx(max(ratio, 1.0), rel=0.1)


@pytest.mark.parametrize("count", [1009, 1024])
def test_inflation_is_that_of_the_exact_covariance(count: int):
    """J' R J over J' J with the Toeplitz matrix of an AR(1) sequence, for prime numbers of samples too."""
    rho = 0.8
    column = np.hanning(count) * np.sin(2 * np.pi * 0.03 * np.arange(count))
    exact = column @ toeplitz(rho ** np.arange(count)) @ column / (column @ column)
    model = autoregression((rho ** np.arange(40))[:, None], np.array([10_000]))
    assert float(variance_inflation(model, column[:, None, None])[0]) == pytest.approx(exact, rel=2e-9)


def test_alternating_residuals_are_never_better_than_independent():
    exact = autoregression(((-0.5) ** np.arange(30))[:, None], np.array([10_000]))
    assert variance_inflation(exact, np.ones((100, 1, 1)))[0] == 1.0


def test_missing_samples_bias_no_correlation():
    sequence = process(np.array([0.8]), 60_000, 7)
    mask = np.random.default_rng(8).random(sequence.shape) > 0.3
    found = autocorrelation(mask, sequence * mask, 10)
    np.testing.assert_allclose(found, 0.8 ** np.arange(10), atol=0.03)


def test_a_channel_without_readings_has_a_model():
    found = autoregression(autocorrelation(np.zeros((50, 1), bool), np.zeros((50, 1)), 10), np.zeros(1))
    assert found.order[0] == 0
    assert np.isfinite(variance_inflation(found, np.zeros((50, 1, 1)))).all()


@pytest.mark.parametrize("missing", [0.02, 0.1, 0.3])
def test_gaps_change_an_inflation_little(missing: float):
    """A resonance read with dropouts, at the frequency of the resonance; without any it is the closed form's."""
    count = 1200
    sequences = np.stack([process(PHI, count, seed) for seed in range(12)], axis=1)
    column = np.sin(2 * np.pi * 0.1 * np.arange(count))[:, None, None] * np.ones((1, 12, 1))
    whole = variance_inflation(modelled(sequences), column)
    measured = np.random.default_rng(3).random(sequences.shape) > missing
    found = variance_inflation(fitted_autoregression(measured, sequences * measured, 60), column)
    assert np.isfinite(found).all()
    assert np.median(found) == pytest.approx(np.median(whole), rel=0.05 + missing)


@pytest.mark.parametrize(("before", "after"), [(0, 600), (600, 0), (200, 1500)])
def test_time_without_readings_changes_no_model(before: int, after: int):
    """A run that is shorter than the others of its load case, or begins later, has the model of its own readings."""
    sequences = 3.0 + np.stack([process(PHI, 800, seed) for seed in range(8)], axis=1)
    padding = ((before, after), (0, 0))
    measured = np.pad(np.ones(sequences.shape, bool), padding)
    padded = fitted_autoregression(measured, np.pad(sequences, padding), 60)
    whole = modelled(sequences)
    np.testing.assert_array_equal(padded.order, whole.order)
    np.testing.assert_allclose(padded.coefficients, whole.coefficients, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(padded.innovation, whole.innovation, rtol=1e-12)


@pytest.mark.parametrize("gap", [100, 400])
def test_a_long_gap_correlates_no_white_residuals(gap: int):
    """Of independent residuals no order is supported, and no inflation."""
    noise = np.random.default_rng(9).normal(size=(1000, 40))
    measured = np.ones(noise.shape, bool)
    measured[300 : 300 + gap] = False
    slow = np.hanning(1000)[:, None, None] * measured[..., None]
    found = variance_inflation(fitted_autoregression(measured, noise * measured, 60), slow)
    np.testing.assert_array_equal(found, 1.0)


@pytest.mark.parametrize("size", [3.0, 10.0, 30.0, 100.0, 1000.0])
def test_smooth_errors_of_any_size_inflate(size: float):
    """A swing that dies away, in units of the noise: the larger it is, the less is a reading worth; never more."""
    time = np.arange(800) * 0.005
    smooth = np.exp(-time / 1.5) * np.sin(2 * np.pi * 2.0 * time)
    residual = size * smooth[:, None] + np.random.default_rng(4).normal(size=(800, 6))
    column = np.broadcast_to(smooth[:, None, None], (800, 6, 1))
    for measured in (np.ones((800, 6), bool), np.random.default_rng(5).random((800, 6)) > 0.1):
        model = fitted_autoregression(measured, residual * measured, 120)
        found = variance_inflation(model, column)
        # A swing of 2 Hz over 1.5 s: some tens of readings at 200 Hz are one.
        assert np.all((found > 10.0 if size >= 10.0 else found > 3.0) & (found < 800.0))
        assert np.all((model.innovation > 0.0) & (model.innovation <= 1.0))


def test_a_channel_s_factor_is_the_mean_over_parameters_weighted_by_what_it_tells():
    rho = 0.8
    lags = rho ** np.arange(60)
    exact = autoregression(np.repeat(lags[:, None], 2, axis=1), np.full(2, 4000))
    slow, fast = np.ones(400), np.tile([1.0, -1.0], 200)
    # Parameter 0 acts slowly and is told by both channels, parameter 1 fast and by the first channel alone.
    columns = np.stack([np.stack([slow, 2.0 * fast], axis=-1), np.stack([slow, 0.0 * fast], axis=-1)], axis=1)
    inflated = (1 + rho) / (1 - rho)
    # The fast one would be deflated, which does not count.  Shares of channel 0: 1 of the first, 2 of the second.
    found = variance_inflation(exact, columns)
    np.testing.assert_allclose(found, [(inflated + 2.0) / 3.0, inflated], rtol=1e-6)


def test_a_little_more_sensitivity_changes_a_factor_a_little():
    """Of channels that tell alike, one that tells one per cent more does not take the factor from the others."""
    lags = 0.9 ** np.arange(60)
    exact = autoregression(np.repeat(lags[:, None], 3, axis=1), np.full(3, 4000))
    column = np.cumsum(np.random.default_rng(4).normal(size=(500, 1, 2)), axis=0)
    columns = np.repeat(column, 3, axis=1)
    before = variance_inflation(exact, columns)
    assert np.all(before > 5.0)
    for channel, parameter in np.ndindex(3, 2):
        more = columns.copy()
        more[:, channel, parameter] *= 1.01
        np.testing.assert_allclose(variance_inflation(exact, more), before, rtol=2e-4)
