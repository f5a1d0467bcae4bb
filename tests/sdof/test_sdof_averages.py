"""Averages over swings and repeats, and errors of correlated residuals, against textbook results."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.sdof.averages import mean_with_scatter, random_effects
from sysid.sdof.decay_modes import correlated_covariance


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
