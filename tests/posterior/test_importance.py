"""Importance sampling: a posterior near its approximation is said to be, others are not, and means are exact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from sysid.posterior.importance import importance_sample
from sysid.posterior.options import SamplingOptions
from sysid.posterior.sampling import sample_posterior

CENTRE, SD = np.array([13.0, 9.0, 8.0]), np.array([0.01, 0.05, 0.2])
COVARIANCE = np.diag(SD**2)
PREVIEW = SamplingOptions(min_steps=10, max_steps=10, preview=True)


def gaussian(x: np.ndarray) -> np.ndarray:
    return -0.5 * (((x - CENTRE) / SD) ** 2).sum(axis=1)


def skewed(x: np.ndarray) -> np.ndarray:
    """The first parameter is a skew normal: twice a normal times its distribution function."""
    return gaussian(x) + norm.logcdf(1.5 * (x[:, 0] - CENTRE[0]) / SD[0])


def test_a_gaussian_needs_no_chain() -> None:
    found = importance_sample(gaussian, CENTRE, COVARIANCE, 1, 400)
    assert found.pareto_k < 0.5
    assert found.effective > 0.9 * len(found.draws)
    assert "a chain was not needed" in found.sentence(chain=False)
    assert "not needed" not in found.sentence(chain=True)


def test_weights_give_the_mean_of_a_posterior_that_leans() -> None:
    found = importance_sample(skewed, CENTRE, COVARIANCE, 1, 4000)
    # Of a skew normal with shape a: a / sqrt(1 + a^2) sqrt(2 / pi) standard deviations.
    lean = 1.5 / np.hypot(1.0, 1.5) * np.sqrt(2.0 / np.pi)
    off = (found.draws[:, 0] - CENTRE[0]) / SD[0]
    assert found.is_reliable
    assert found.weights @ off == pytest.approx(lean, abs=0.05)
    assert abs(off.mean()) < 0.1
    groups, logs = found.resampled(4, np.random.default_rng(2))
    assert groups.shape == (4, 1000, 1, 3)
    assert (groups[..., 0].mean() - CENTRE[0]) / SD[0] == pytest.approx(lean, abs=0.08)
    np.testing.assert_array_equal(logs[0, :, 0], skewed(groups[0, :, 0]))


@pytest.mark.parametrize("wide", [10.0, 100.0])
def test_a_posterior_that_is_wider_than_its_approximation_needs_one(wide: float) -> None:
    found = importance_sample(lambda x: gaussian(CENTRE + (x - CENTRE) / wide), CENTRE, COVARIANCE, 1, 400)
    assert not found.is_reliable
    assert "a chain is needed" in found.sentence(chain=True)


def test_a_density_that_is_finite_nowhere_is_no_answer() -> None:
    found = importance_sample(lambda x: np.full(len(x), np.nan), CENTRE, COVARIANCE, 1, 400)
    assert not found.is_reliable


def test_a_preview_is_the_importance_sample_where_that_suffices() -> None:
    names = ("k_1", "c_1", "kt_1")
    found = sample_posterior(gaussian, names, CENTRE, COVARIANCE, "test", PREVIEW)
    assert found.message.startswith("Preview without a chain")
    assert np.log(found.draws).std(axis=(0, 1, 2)) == pytest.approx(SD, rel=0.15)
    other = sample_posterior(lambda x: gaussian(CENTRE + (x - CENTRE) / 10.0), names, CENTRE, COVARIANCE, "", PREVIEW)
    assert "10 steps" in other.message
    # A run that is no preview has its chain, and a line about it.
    whole = sample_posterior(gaussian, names, CENTRE, COVARIANCE, "test", replace(PREVIEW, preview=False))
    assert "10 steps" in whole.message
    assert "draws effective; they would do for a preview" in whole.message
    assert "a chain was not needed" in found.message


def log_exponential(x: np.ndarray) -> np.ndarray:
    """Logarithm u of a spread that may be zero: its density falls as exp(u) on one side, and at once on the other."""
    u = x[:, 0] - CENTRE[0]
    return u - np.exp(u) - 0.5 * (((x[:, 1:] - CENTRE[1:]) / SD[1:]) ** 2).sum(axis=1)


def test_proposals_with_sides_reach_a_spread_of_zero() -> None:
    """The mean of exp(u) is 1, that of u is minus Euler's constant, for every exponential distribution."""
    covariance = np.diag(np.r_[1.0, SD[1:] ** 2])
    found = importance_sample(log_exponential, CENTRE, covariance, 1, 4000, sided=True)
    assert found.pareto_k < 0.5
    assert found.effective > 0.5 * len(found.draws)
    u = found.draws[:, 0] - CENTRE[0]
    assert found.weights @ u == pytest.approx(-np.euler_gamma, abs=0.05)
    assert found.weights @ np.exp(u) == pytest.approx(1.0, abs=0.05)
    # Without sides the tail is not reached.
    plain = importance_sample(log_exponential, CENTRE, covariance, 1, 4000)
    assert plain.pareto_k > found.pareto_k
    assert plain.effective < found.effective


def test_importance_draws_are_the_posterior_where_they_suffice() -> None:
    names, options = ("k_1", "c_1", "kt_1"), replace(PREVIEW, preview=False, importance_draws=2000)
    enough = replace(options, importance_suffices=True, min_effective=1000.0)
    found = sample_posterior(gaussian, names, CENTRE, COVARIANCE, "test", enough)
    assert found.converged
    assert not found.preview
    assert found.message.startswith("Importance sampling")
    assert np.log(found.draws).std(axis=(0, 1, 2)) == pytest.approx(SD, rel=0.1)
    # Fewer effective draws than are wanted, or a posterior that they do not reach: a chain.
    chain = sample_posterior(gaussian, names, CENTRE, COVARIANCE, "test", replace(enough, min_effective=2001.0))
    assert "10 steps" in chain.message
