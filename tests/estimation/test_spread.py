"""Masses and model error added to draws: against the exact posterior of linear and of curved models."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from sysid.estimation.uncertainty.spread import Spread, covariance_root, spread_between
from sysid.posterior.diagnostics import effective_draws
from sysid.posterior.options import SamplingOptions
from sysid.posterior.sampling import chain_identity, posterior_so_far, sample_posterior


def test_the_spread_of_a_linear_model_is_how_parameters_follow_masses() -> None:
    """Sigma - A = G V G', with G the response of the parameters and V what is left of the masses' variance."""
    random = np.random.default_rng(4)
    by_parameters, by_masses = random.normal(size=(40, 3)), random.normal(size=(40, 2))
    prior, masses = np.diag([0.5, 0.1, 2.0]), np.diag([4.0, 9.0])
    both = np.hstack([by_parameters, by_masses])
    joint = np.linalg.inv(both.T @ both + np.block([[prior, np.zeros((3, 2))], [np.zeros((2, 3)), masses]]))
    own = np.linalg.inv(by_parameters.T @ by_parameters + prior)
    response = own @ by_parameters.T @ by_masses
    found = spread_between(own, joint[:3, :3])
    np.testing.assert_allclose(found.covariance, response @ joint[3:, 3:] @ response.T, rtol=1e-9)
    assert not np.any(found.shift)


def test_what_does_not_exceed_the_own_covariance_adds_nothing() -> None:
    own = np.diag([1.0, 4.0])
    found = spread_between(own, np.diag([1.0 - 1e-12, 9.0]))
    np.testing.assert_allclose(found.covariance, np.diag([0.0, 5.0]), atol=1e-15)


def test_draws_get_the_mean_and_covariance_that_are_said() -> None:
    random = np.random.default_rng(7)
    half = random.normal(size=(3, 2))
    # Of rank two: one direction gets nothing.
    spread = Spread(np.array([1.0, -2.0, 0.5]), half @ half.T, 0.3 * random.normal(size=(3, 3)))
    x = np.tile(np.array([0.2, 0.1, -0.4]), (4, 200, 50, 1))
    d = (spread.added(x, 5) - x).reshape(-1, 3)
    np.testing.assert_allclose(d.mean(axis=0), spread.shift - spread.lever @ x[0, 0, 0], atol=0.01)
    np.testing.assert_allclose(np.cov(d.T), spread.covariance, atol=0.015)
    silent = np.linalg.svd(half)[0][:, 2]
    assert np.std(d @ silent) < 1e-7
    np.testing.assert_allclose(covariance_root(half @ half.T) @ covariance_root(half @ half.T).T, half @ half.T)


def test_a_step_gets_the_same_however_long_the_chain_and_wherever_it_begins() -> None:
    spread = Spread(np.zeros(2), np.diag([1.0, 0.25]))
    x = np.random.default_rng(1).normal(size=(2, 12, 5, 2))
    whole = spread.added(x, 3)
    np.testing.assert_array_equal(spread.added(x[:, :7], 3), whole[:, :7])
    np.testing.assert_array_equal(spread.added(x[:, 4:], 3, 4), whole[:, 4:])
    assert not np.array_equal(spread.added(x, 4), whole)
    np.testing.assert_allclose(spread.taken_away(whole[:, 4:], 3, 4), x[:, 4:], atol=1e-14)
    with pytest.raises(ValueError, match="depends on the draws"):
        Spread(np.zeros(2), np.eye(2), np.eye(2)).taken_away(x, 3)


def test_campaigns_with_one_seed_get_deviations_of_their_own() -> None:
    x = np.zeros((2, 5, 20, 2))
    one, two = (Spread(np.zeros(2), np.diag([1.0, 0.25]) * size).added(x, 3).ravel() for size in (1.0, 1.1))
    assert abs(np.corrcoef(one, two)[0, 1]) < 0.2


def test_the_root_does_not_depend_on_the_order_of_equal_eigenvectors() -> None:
    covariance = np.diag([1.0, 4.0, 9.0])
    turned = covariance + 1e-15 * np.random.default_rng(2).normal(size=(3, 3))
    np.testing.assert_allclose(covariance_root(turned + turned.T), covariance_root(2.0 * covariance), atol=1e-12)


def test_a_scale_that_no_motion_shows_leaves_the_shape_of_the_posterior() -> None:
    """log k follows a scale error s ~ N(0, 0.5 %) one to one, and curves with a damper's knee, as narrow as 0.05 %.

    The posterior of log k is that of s, moved by what the knee makes of it. With the likelihood flattened by a linear
    map (the curvature adjustment) the curve would grow by the ratio of both widths, to 2.5 %.
    """
    narrow, of_scale, bend = 5e-4, 5e-3, 2.5e-3

    def density(x: np.ndarray) -> np.ndarray:
        return np.asarray(-0.5 * ((x[:, 0] + bend * x[:, 1] ** 2) / narrow) ** 2 - 0.5 * (x[:, 1] / 0.3) ** 2)

    own = np.diag([narrow**2, 0.09])
    spread = spread_between(own, np.diag([narrow**2 + of_scale**2, 0.09]))
    options = SamplingOptions(adapting_steps=0, min_steps=400, max_steps=400, seed=2)
    found = sample_posterior(density, ("k", "knee"), np.zeros(2), own, "test", options, spread=spread)
    k = np.log(found.draws[..., 0]).ravel()
    # Exactly: a normal about -bend times the square of the knee.
    knee = norm.ppf((np.arange(2000) + 0.5) / 2000) * 0.3
    at = np.linspace(-0.03, 0.03, 4001)
    exact = norm.cdf((at[:, None] + bend * knee**2) / np.hypot(narrow, of_scale)).mean(axis=1)
    for share in (0.05, 0.5, 0.95):
        assert np.quantile(k, share) == pytest.approx(np.interp(share, exact, at), abs=0.02 * of_scale)
    # Effective draws are those of the sampled part: what is kept scatters more, and is less correlated.
    kept = effective_draws(np.log(found.draws[..., 0]).reshape(4, -1))
    assert found.summaries[0].ess < 0.2 * kept


def test_draws_of_a_chain_that_is_still_written_are_those_of_the_finished_one(tmp_path) -> None:
    centre, own = np.zeros(2), np.diag([0.01, 0.04])
    spread = spread_between(own, 3.0 * own, np.array([0.1, 0.0]))

    def density(x: np.ndarray) -> np.ndarray:
        return np.asarray(-0.5 * (x**2 / np.diag(own)).sum(axis=1))

    options = SamplingOptions(min_steps=40, max_steps=40)
    found = sample_posterior(density, ("k", "c"), centre, own, "test", options, spread=spread, folder=tmp_path)
    again = posterior_so_far(tmp_path, chain_identity(options, centre, own, {}), ("k", "c"), "test", options, spread)
    assert again is not None
    np.testing.assert_array_equal(again.draws, found.draws)
    assert np.log(found.draws[..., 0]).mean() == pytest.approx(0.1, abs=0.02)
    assert np.log(found.draws).std(axis=(0, 1, 2)) == pytest.approx(np.sqrt(3.0 * np.diag(own)), rel=0.05)
