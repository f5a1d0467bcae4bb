"""Readings that stand out: found where they are, left alone where noise is normal and where the model is wrong."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import norm, t

from sysid.estimation.weights.heavy_tails import DECISIVE, DEGREES_OF_FREEDOM, Tails, best_distribution, heavy_tails

SHAPE = (600, 3, 8)


def noise(rho: float, seed: int) -> np.ndarray:
    """Normal noise (T, R, C) of unit variance, correlated from one reading to the next."""
    plain = np.random.default_rng(seed).normal(size=(SHAPE[0] + 100, *SHAPE[1:]))
    return lfilter([1.0], [1.0, -rho], plain, axis=0)[100:] * np.sqrt(1.0 - rho**2)


def tails(residual: np.ndarray, measured: np.ndarray | None = None) -> Tails:
    """Tails of residuals of readings that are finer than any residual."""
    return heavy_tails(np.ones(residual.shape, bool) if measured is None else measured, residual, residual)


@pytest.mark.parametrize("rho", [0.0, 0.6])
def test_normal_noise_keeps_full_weights(rho: float):
    found = tails(noise(rho, 1))
    assert np.isfinite(found.degrees_of_freedom).sum() <= 1
    assert found.weight[..., ~np.isfinite(found.degrees_of_freedom)].min() == 1.0


@pytest.mark.parametrize("rho", [0.0, 0.6])
def test_outliers_lose_their_weight(rho: float):
    residual = noise(rho, 2)
    bad = np.random.default_rng(3).random(SHAPE) < 0.01
    found = tails(residual + 15.0 * bad)
    assert np.isfinite(found.degrees_of_freedom).all()
    # Neighbours that are off alike do not stand out of each other, nor do bad readings that come in a row.
    assert np.quantile(found.weight[bad], 0.93) < 0.2
    assert np.median(found.weight[~bad]) > 0.9


def test_weights_follow_a_model_that_is_wrong_for_a_while():
    """A burst at wheel-hop frequency, ten times the noise, that no single reading stands out of."""
    time = np.arange(SHAPE[0]) * 0.005
    burst = 10.0 * np.exp(-(((time - 1.5) / 0.25) ** 2)) * np.sin(2 * np.pi * 11.0 * time)
    found = tails(noise(0.0, 4) + burst[:, None, None])
    inside = np.abs(time - 1.5) < 0.25
    assert found.weight[inside].mean() > 0.8


@pytest.mark.parametrize("nu", [3.0, 6.0])
def test_degrees_of_freedom_of_a_t_distribution(nu: float):
    values = t.rvs(nu, size=40_000, random_state=5)
    found, scale = best_distribution(values)
    assert found == nu
    assert scale == pytest.approx(1.0, rel=0.03)
    assert best_distribution(np.random.default_rng(6).normal(size=40_000))[0] == np.inf


@pytest.mark.parametrize("seed", range(12))
def test_the_choice_is_that_by_the_distributions_of_scipy(seed: int):
    """Small samples, some of which are told from normal ones and some not."""
    values = 0.02 * t.rvs(1.5 + 0.7 * seed, size=600, random_state=seed)
    middle = np.median(np.abs(values))
    scales = {nu: middle / t.ppf(0.75, nu) for nu in DEGREES_OF_FREEDOM}
    criteria = {nu: np.log(600) - 2.0 * t.logpdf(values, nu, scale=scale).sum() for nu, scale in scales.items()}
    criteria[np.inf] = -2.0 * norm.logpdf(values, scale=values.std()).sum() - DECISIVE
    wanted = min(criteria, key=lambda nu: criteria[nu])
    found, scale = best_distribution(values)
    assert found == wanted
    assert scale == pytest.approx(scales.get(wanted, values.std()), rel=1e-12)


def test_information_is_that_of_a_location_of_t_readings():
    """The variance of estimates of a location by these weights, against the share of information that they claim."""
    nu, count = 4.0, 400
    values = t.rvs(nu, size=(1000, count), random_state=7)
    claimed = Tails(np.array([nu, np.inf]), np.ones((1, 1, 2))).information
    np.testing.assert_allclose(claimed, [(nu + 1.0) / (nu + 3.0), 1.0])
    estimates = []
    for row in values:
        place = 0.0
        for _ in range(30):
            w = (nu + 1.0) / (nu + (row - place) ** 2)
            place = (w * row).sum() / w.sum()
        estimates.append(place)
    assert np.var(estimates) * count == pytest.approx(1.0 / claimed[0], rel=0.12)


def test_few_and_missing_readings_are_left_alone():
    measured = np.zeros((60, 1, 1), bool)
    measured[:30] = True
    assert tails(np.random.default_rng(8).standard_cauchy((60, 1, 1)) * measured, measured).weight.min() == 1.0
    assert tails(np.zeros((60, 1, 1)), np.zeros((60, 1, 1), bool)).weight.min() == 1.0


def test_a_smooth_error_with_gaps_has_no_heavy_tails():
    """A reading beside a gap has no neighbours to stand out of."""
    time = np.arange(SHAPE[0]) * 0.005
    smooth = np.sin(2 * np.pi * 3.0 * time)[:, None, None] + 0.02 * noise(0.0, 9)
    measured = np.random.default_rng(10).random(SHAPE) > 0.05
    found = tails(smooth * measured, measured)
    assert np.isinf(found.degrees_of_freedom).all()


def test_resolution_coarser_than_the_noise_is_no_heavy_tail():
    """At rest a reading repeats; in motion it is off by up to half a step: no single one is bad."""
    random = np.random.default_rng(11)
    time = np.arange(SHAPE[0]) * 0.005
    moving = np.where((time > 1.0) & (time < 2.5), np.sin(2 * np.pi * 1.5 * (time - 1.0)), 0.0)
    clean = 20.0 * moving[:, None, None] + np.zeros(SHAPE)
    reading = np.round((clean + 0.01 * random.normal(size=SHAPE)) / 0.1) * 0.1
    found = heavy_tails(np.ones(SHAPE, bool), reading - clean, reading)
    assert found.weight.min() > 0.2
    assert found.weight.mean() > 0.98


def test_runs_at_rest_do_not_decide_about_the_others():
    residual = noise(0.0, 12)
    residual[80:, :2] = 0.0
    found = tails(residual)
    assert np.isinf(found.degrees_of_freedom).all()


def test_steps_of_a_slow_staircase_are_no_bad_readings():
    """A drift of a fiftieth of the resolution per reading: one reading in fifty jumps by a whole step."""
    clean = 0.002 * np.arange(SHAPE[0])[:, None, None] + 0.01 * np.arange(24).reshape(1, 3, 8)
    reading = np.round(clean / 0.1) * 0.1
    assert heavy_tails(np.ones(SHAPE, bool), reading - clean, reading).weight.min() == 1.0
