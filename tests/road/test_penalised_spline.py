"""Penalised spline against dense Gaussian formulas."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import BSpline
from scipy.stats import multivariate_normal

from sysid.road.penalised_spline import BinnedHeights, bin_heights, fit_spline


@pytest.fixture
def data() -> BinnedHeights:
    rng = np.random.default_rng(4)
    station = np.sort(rng.uniform(0.0, 1.0, 60))
    height = 0.08 * np.sin(np.pi * station) + 1e-3 * rng.standard_normal(60)
    return BinnedHeights(station, height, np.ones(60), 0.0, 60.0)


def dense(
    data: BinnedHeights, start: float, end: float, spacing: float
) -> tuple[np.ndarray, np.ndarray, list[BSpline]]:
    """Basis at the data and its penalty matrix, by adaptive quadrature of second derivatives."""
    breaks = np.linspace(start, end, round((end - start) / spacing) + 1)
    knots = np.concatenate([[start] * 3, breaks, [end] * 3])
    size = knots.size - 4
    basis = [BSpline(knots, np.eye(size)[i], 3) for i in range(1, size - 1)]
    second = [b.derivative(2) for b in basis]
    penalty = np.array(
        [
            [sum(quad(lambda s, p=p, q=q: p(s) * q(s), a, b)[0] for a, b in pairwise(breaks)) for q in second]
            for p in second
        ]
    )
    inside = (data.station_m > start) & (data.station_m < end)
    design = np.array([np.where(inside, b(np.clip(data.station_m, start, end)), 0.0) for b in basis]).T
    return design, penalty, basis


def minus_two_log_likelihood(data: BinnedHeights, start: float, end: float, smoothness: float) -> float:
    design, penalty, _ = dense(data, start, end, 0.1)
    shape = np.eye(data.height_m.size) + design @ np.linalg.solve(smoothness * penalty, design.T)
    variance = data.height_m @ np.linalg.solve(shape, data.height_m) / data.height_m.size
    return -2 * multivariate_normal(np.zeros(data.height_m.size), variance * shape).logpdf(data.height_m)


def test_criterion_is_the_marginal_likelihood(data: BinnedHeights) -> None:
    cases = [(0.0, 1.0, 1e-3), (0.0, 1.0, 1e-1), (0.2, 1.0, 1e-3), (0.0, 0.7, 1e-2)]
    ours = [fit_spline(data, a, b, knot_spacing_m=0.1, smoothness=s).criterion for a, b, s in cases]
    theirs = [minus_two_log_likelihood(data, a, b, s) for a, b, s in cases]
    np.testing.assert_allclose(np.diff(ours), np.diff(theirs), rtol=1e-7)


def test_smoothness_maximises_the_marginal_likelihood(data: BinnedHeights) -> None:
    best = fit_spline(data, 0.0, 1.0, knot_spacing_m=0.1)
    at_best = minus_two_log_likelihood(data, 0.0, 1.0, best.smoothness)
    for factor in (0.5, 2.0):
        assert minus_two_log_likelihood(data, 0.0, 1.0, factor * best.smoothness) > at_best


def test_mean_and_variance_are_those_of_bayesian_regression(data: BinnedHeights) -> None:
    fit = fit_spline(data, 0.0, 1.0, knot_spacing_m=0.1, smoothness=1e-3)
    design, penalty, basis = dense(data, 0.0, 1.0, 0.1)
    precision = design.T @ design + 1e-3 * penalty
    at = np.linspace(0.01, 0.99, 37)
    rows = np.array([b(at) for b in basis]).T
    coefficients = np.linalg.solve(precision, design.T @ data.height_m)
    np.testing.assert_allclose(fit.height_m(at), rows @ coefficients, rtol=1e-9)
    expected = fit.noise_m**2 * np.einsum("ij,ji->i", rows, np.linalg.solve(precision, rows.T))
    np.testing.assert_allclose(fit.variance_m2(at), expected, rtol=1e-9)


def test_zero_outside_and_at_the_ends(data: BinnedHeights) -> None:
    fit = fit_spline(data, 0.1, 0.9, knot_spacing_m=0.05)
    outside = np.array([-1.0, 0.1, 0.9, 2.0])
    assert np.all(fit.height_m(outside) == 0.0)
    assert np.all(fit.slope(outside) == 0.0)
    assert np.all(fit.variance_m2(outside) == 0.0)
    assert fit.height_m(np.array([0.1 + 1e-9]))[0] == pytest.approx(0.0, abs=1e-8)


def test_slope_is_the_derivative(data: BinnedHeights) -> None:
    fit = fit_spline(data, 0.0, 1.0, knot_spacing_m=0.05)
    at = np.linspace(0.05, 0.95, 19)
    numeric = (fit.height_m(at + 1e-6) - fit.height_m(at - 1e-6)) / 2e-6
    np.testing.assert_allclose(fit.slope(at), numeric, atol=1e-7)


def test_bins_keep_weights_means_and_scatter() -> None:
    rng = np.random.default_rng(5)
    station, height, weight = rng.random(300), rng.random(300), rng.random(300)
    bins = bin_heights(station, height, weight, width_m=0.05)
    assert np.sum(bins.weight) == pytest.approx(np.sum(weight))
    assert np.sum(bins.weight * bins.height_m) == pytest.approx(np.sum(weight * height))
    # Sum of squares about any level = within + between the bins.
    total = np.sum(weight * (height - 0.3) ** 2)
    assert bins.scatter_m2 + np.sum(bins.weight * (bins.height_m - 0.3) ** 2) == pytest.approx(total)
