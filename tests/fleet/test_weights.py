"""Weights of campaigns that are not Gaussian: against quadrature, and Pareto tails of known index."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import fftconvolve

from sysid.fleet.draws import CampaignDraws
from sysid.fleet.hierarchy import HyperPriors, TypeData
from sysid.fleet.likelihood import likelihood_of
from sysid.fleet.population import fit_population
from sysid.fleet.weights import smoothed
from sysid.posterior.options import SamplingOptions


def skewed_fleet(seed: int, trucks: int = 8) -> tuple[TypeData, list[CampaignDraws], np.ndarray, np.ndarray]:
    """Campaigns with log-gamma likelihoods of one parameter: data, draws, a grid (g,) and log-likelihoods (t, g)."""
    random, grid, prior_sd = np.random.default_rng(seed), np.linspace(-3.0, 3.0, 6001), 0.7
    shape, truth = 2.0, 0.1 * random.standard_normal(trucks)
    width = 0.12 * np.sqrt(shape)
    at = (grid - (truth + 0.1 * random.standard_normal(trucks))[:, None]) / width
    log = shape * (at - np.exp(at))
    posterior = np.exp(log - log.max(axis=1, keepdims=True) - 0.5 * (grid / prior_sd) ** 2).cumsum(axis=1)
    records = []
    for row in posterior:
        level = (np.arange(1000) + random.uniform(size=1000)) / 1000
        draws = random.permutation(np.interp(level, row / row[-1], grid))[:, None]
        words = ("k_1",), ("stiffness",), ("1",), (0,), ("",), ("linear",)
        records.append(CampaignDraws(*words, draws, np.zeros(1), np.array([[prior_sd**2]])))
    forms = [likelihood_of(r) for r in records]
    names = tuple(f"T{t}" for t in range(trucks))
    data = TypeData(
        ("k_1",), ("stiffness",), names, names, np.arange(trucks), np.array([f.precision for f in forms]),
        np.array([f.shift for f in forms]), np.zeros(1),
    )  # fmt: skip
    return data, records, grid, log


def exact_quantiles(grid: np.ndarray, log: np.ndarray, priors: HyperPriors) -> tuple[np.ndarray, np.ndarray]:
    """Quantiles of mean and spread of trucks with these likelihoods, by quadrature."""
    mean, log_spread = np.linspace(-1.0, 1.0, 201), np.linspace(-6.5, 1.0, 120)
    density = np.zeros((mean.size, log_spread.size))
    for j, spread in enumerate(np.exp(log_spread)):
        kernel = np.exp(-0.5 * (grid / spread) ** 2)
        for row in log:
            mixed = fftconvolve(np.exp(row - row.max()), kernel / kernel.sum(), mode="same")
            density[:, j] += np.log(np.maximum(np.interp(mean, grid, mixed), 1e-300))
        density[:, j] += np.log(spread) - np.log1p((spread / priors.spread_scale) ** 2)
    weights = np.exp(density - 0.5 * (mean[:, None] / priors.mean_sd) ** 2 - density.max())
    of_mean, of_spread = weights.sum(axis=1).cumsum(), weights.sum(axis=0).cumsum()
    levels = (0.05, 0.5, 0.95)
    quantiles = np.interp(levels, of_spread / of_spread[-1], log_spread)
    return np.interp(levels, of_mean / of_mean[-1], mean), np.exp(quantiles)


def test_campaigns_that_are_not_gaussian_are_corrected_for() -> None:
    data, records, grid, log = skewed_fleet(2)
    mean, spread = exact_quantiles(grid, log, HyperPriors())
    sampling = SamplingOptions(
        ensembles=4, segment_steps=100, adapting_steps=0, min_steps=400, max_steps=4000, min_effective=2000.0
    )
    found = fit_population("t", data, ("1",), records, sampling=sampling)
    gaussian = fit_population("t", data, ("1",), [None] * len(records), sampling=sampling)
    assert found.corrected
    assert max(found.pareto_k) < 0.5

    def shown(q) -> np.ndarray:
        return np.array([q.q05[0], q.q50[0], q.q95[0]])

    # Gaussians alone put the median of the spread a third too low, and its lower end at less than half.
    assert shown(gaussian.spread)[1] < 0.75 * spread[1]
    assert shown(gaussian.spread)[0] < 0.5 * spread[0]
    assert shown(found.spread)[1] == pytest.approx(spread[1], rel=0.03)
    assert shown(found.spread) == pytest.approx(spread, rel=0.13)
    sd = (mean[2] - mean[0]) / (2.0 * 1.6448536)
    assert np.abs(np.log(shown(found.mean)) - mean).max() < 0.06 * sd


@pytest.mark.parametrize("index", [0.2, 0.5, 0.9])
def test_pareto_k_is_the_index_of_the_tail(index: float) -> None:
    # exp(a x) of an exponential x has the Pareto tail index a; the reciprocals have none.
    x = np.random.default_rng(0).exponential(size=20_000)
    assert smoothed(index * x).pareto_k == pytest.approx(index, abs=0.1)
    assert smoothed(-index * x).pareto_k < 0.0
    assert smoothed(50.0 * x).pareto_k == np.inf
