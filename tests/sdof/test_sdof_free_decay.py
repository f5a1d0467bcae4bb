"""Free-decay model against closed forms, and the statistics of averages against textbook results."""

from __future__ import annotations

import numpy as np
import pytest
from decay_oracles import damped_cosine, nonlinear_decay

from sysid.sdof.averages import mean_with_scatter, random_effects
from sysid.sdof.decay import prepare_record
from sysid.sdof.decay_modes import correlated_covariance
from sysid.sdof.free_decay import fit_free_decay

TIME = np.arange(0.0, 5.0, 0.005)


def noisy(value, sd, seed=0):
    return value + sd * np.random.default_rng(seed).standard_normal(value.size)


@pytest.mark.parametrize(("period", "decrement"), [(0.6, 0.5), (0.38, 0.55), (0.9, 1.6)])
def test_exact_single_mass_to_eight_digits(period, decrement):
    fit = fit_free_decay(prepare_record(TIME, damped_cosine(TIME, period, decrement, offset=0.003)))
    assert fit.usable
    assert not fit.poor
    assert fit.damped_period == pytest.approx(period, rel=1e-8)
    assert fit.log_decrement == pytest.approx(decrement, rel=1e-8)


def test_exact_two_modes_to_eight_digits():
    u = np.maximum(TIME - 0.5, 0.0)
    hop = 0.012 * np.exp(-7.0 * u) * np.sin(2 * np.pi * 10.5 * u)
    fit = fit_free_decay(prepare_record(TIME, damped_cosine(TIME, 0.6, 0.5) + hop))
    assert fit.damped_period == pytest.approx(0.6, rel=1e-8)
    assert fit.log_decrement == pytest.approx(0.5, rel=1e-8)
    assert fit.hop == pytest.approx((7.0, 2 * np.pi * 10.5), rel=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_errors_cover_the_truth_under_noise(seed):
    fit = fit_free_decay(prepare_record(TIME, noisy(damped_cosine(TIME, 0.6, 0.5), 3e-4, seed)))
    sd = np.sqrt(np.diagonal(fit.covariance))
    assert abs(fit.decay_rate - 0.5 / 0.6) < 4 * sd[0]
    assert abs(fit.angular_frequency - 2 * np.pi / 0.6) < 4 * sd[1]
    assert sd[0] < 0.02
    assert fit.noise_ratio == pytest.approx(1.0, abs=0.2)


def test_a_drift_is_taken_out():
    value = noisy(damped_cosine(TIME, 0.6, 0.5) + 0.001 * TIME, 1e-4)
    fit = fit_free_decay(prepare_record(TIME, value))
    assert "drift" in fit.note
    assert fit.log_decrement == pytest.approx(0.5, rel=0.01)


def test_friction_is_seen_and_the_fit_called_poor():
    value = noisy(nonlinear_decay(TIME, 2 * np.pi / 0.6, 0.04, friction=0.0008, linear=0.5), 1e-4)
    fit = fit_free_decay(prepare_record(TIME, value))
    assert fit.poor
    assert "poor fit" in fit.note
    assert "dry friction" in fit.note


def test_creep_is_not_an_oscillation():
    u = np.maximum(TIME - 0.5, 0.0)
    fit = fit_free_decay(prepare_record(TIME, noisy(0.04 * (1 + 8 * u) * np.exp(-8 * u), 2e-4)))
    assert not fit.usable
    assert np.isnan(fit.log_decrement)


def test_autocorrelated_residuals_widen_the_error_of_a_mean():
    # First-order autoregressive noise: the variance of a mean grows by (1 + phi)/(1 - phi).
    rng = np.random.default_rng(5)
    phi, count, found = 0.8, 4000, []
    for _ in range(20):
        noise = np.zeros(count)
        shocks = rng.standard_normal(count)
        for i in range(1, count):
            noise[i] = phi * noise[i - 1] + shocks[i]
        covariance = correlated_covariance(np.ones((count, 1)), noise - noise.mean())
        found.append(covariance[0, 0] * count / noise.var())
    assert np.mean(found) == pytest.approx((1 + phi) / (1 - phi), rel=0.25)


def test_random_effects_between_weighted_and_plain_mean():
    value = np.array([1.0, 1.1, 0.9, 1.05])
    own = np.array([0.2, 0.1, 0.4, 0.2]) ** 2
    mean, error = mean_with_scatter(value, np.diag(own))
    assert mean == pytest.approx(np.sum(value / own) / np.sum(1 / own), rel=1e-9)
    assert error == pytest.approx(np.sum(1 / own) ** -0.5, rel=1e-9)
    far = np.array([1.0, 3.0, 2.0, 7.0])
    mean, error = mean_with_scatter(far, np.diag(1e-6 * own))
    assert mean == pytest.approx(far.mean(), rel=1e-5)
    assert error == pytest.approx(far.std(ddof=1) / 2.0, rel=1e-4)


def test_random_effects_line_recovers_its_scatter():
    rng = np.random.default_rng(3)
    x = np.linspace(-1.0, 1.0, 100)
    design = np.stack([np.ones(100), x], axis=1)
    value = 2.0 + 3.0 * x + 0.5 * rng.standard_normal(100)
    fit = random_effects(design, value, 0.09 * np.eye(100))
    # With equal noise the weights are equal, so this is ordinary least squares with the residual's own variance.
    ordinary, rest, _, _ = np.linalg.lstsq(design, value, rcond=None)
    np.testing.assert_allclose(fit.value, ordinary, rtol=1e-10)
    assert fit.extra_sd == pytest.approx(np.sqrt(rest[0] / 98 - 0.09), rel=1e-6)
