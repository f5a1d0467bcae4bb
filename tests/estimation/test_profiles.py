"""Profiles of the deviance: parabolas of linear problems, closed forms of bent ones, and a fit of a truck."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic_fit import synthetic_fit

from sysid.estimation.fit.profiles import LIMIT, _words, interval_of, profile_deviance, profile_parameter


def linear(seed: int = 1):
    """A straight-line model of 3 unknowns: evaluation, optimum, covariance."""
    random = np.random.default_rng(seed)
    design, data = random.normal(size=(40, 3)) * [1.0, 5.0, 0.2], random.normal(size=40)
    covariance = np.linalg.inv(design.T @ design)
    return lambda x: (design @ x - data, design), covariance @ design.T @ data, covariance


@pytest.mark.parametrize("index", [0, 2])
def test_the_profile_of_a_linear_problem_is_the_parabola_of_its_covariance(index):
    evaluate, optimum, covariance = linear()
    sd = np.sqrt(covariance[index, index])
    steps = np.array([-2.0, -1.0, 1.0, 3.0])
    deviance, converged = profile_deviance(evaluate, optimum, index, optimum[index] + sd * steps)
    assert converged.all()
    np.testing.assert_allclose(deviance, steps**2, rtol=1e-6)
    values = optimum[index] + sd * np.append(steps, 0.0)
    low, high = interval_of(values, np.append(deviance, 0.0), optimum[index])
    assert low == pytest.approx(optimum[index] - 1.6448536 * sd, abs=1e-6 * sd)
    assert high == pytest.approx(optimum[index] + 1.6448536 * sd, abs=1e-6 * sd)


def test_the_profile_of_a_bent_valley_is_its_closed_form():
    """r = (10 (y - x^2), x - 1, 2 (z - x)): with y and z at their best the deviance is (x - 1)^2."""

    def evaluate(v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x, y, z = v
        slopes = np.array([[-20.0 * x, 10.0, 0.0], [1.0, 0.0, 0.0], [-2.0, 0.0, 2.0]])
        return np.array([10.0 * (y - x**2), x - 1.0, 2.0 * (z - x)]), slopes

    values = np.array([-1.0, 0.5, 2.0, 4.0])
    deviance, converged = profile_deviance(evaluate, np.ones(3), 0, values, relative_tolerance=1e-12)
    assert converged.all()
    np.testing.assert_allclose(deviance, (values - 1.0) ** 2, rtol=1e-6)
    # Along y: x is the root of its cubic 200 x (x^2 - y) + x - 1 = 0.
    deviance, _ = profile_deviance(evaluate, np.ones(3), 1, np.array([0.5, 2.0]), relative_tolerance=1e-12)
    for y, found in zip((0.5, 2.0), deviance, strict=True):
        roots = np.roots([200.0, 0.0, 1.0 - 200.0 * y, -1.0])
        x = roots[np.isreal(roots)].real.max()
        assert found == pytest.approx((10.0 * (y - x**2)) ** 2 + (x - 1.0) ** 2, rel=1e-5)


def test_an_uneven_interval_comes_from_the_likelihood_ratio():
    """D = (exp(v) - 1)^2 / 0.25: its ends are ln(1 +- 0.5 z)."""
    values = np.linspace(-3.0, 1.5, 19)
    deviance = (np.exp(values) - 1.0) ** 2 / 0.25
    low, high = interval_of(values, deviance, 0.0)
    assert high == pytest.approx(np.log(1.0 + 0.5 * LIMIT**0.5), abs=2e-3)
    assert low == pytest.approx(np.log(1.0 - 0.5 * LIMIT**0.5), abs=0.02)
    # Below, the deviance never exceeds 1 / 0.5^2 = 4: nothing bounds the parameter at a limit of 5.
    low, high = interval_of(values, deviance, 0.0, limit=5.0)
    assert np.isnan(low)
    assert np.isfinite(high)


def test_a_stiffness_of_the_synthetic_truck():
    fit = synthetic_fit()
    seen: list[float] = []
    found = profile_parameter(fit.state, fit.result, "k_2", (-2.0, 2.0), lambda message, share: seen.append(share))
    assert found.converged.all()
    assert seen == [0.5, 1.0]
    assert found.inflation >= 1.0
    # Near the optimum of precise data the cost is a parabola.
    np.testing.assert_allclose(found.adjusted, [4.0, 0.0, 4.0], rtol=0.03, atol=1e-9)
    np.testing.assert_allclose(found.interval, found.covariance_interval, rtol=1e-3)
    assert "parabola" in found.message
    assert list(found.summary()["value"]) == list(found.value)


@pytest.mark.parametrize("outwards", [1.0, -1.0])
def test_values_without_a_finite_simulation_end_a_side_of_the_profile_and_nothing_else(outwards):
    evaluate, optimum, covariance = linear()
    sd = np.sqrt(covariance[1, 1])

    def breaks_down(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        residual, jacobian = evaluate(x)
        return np.where(outwards * (x[1] - optimum[1]) > 1.5 * sd, np.nan, residual), jacobian

    steps = outwards * np.array([-2.0, -1.0, 1.0, 2.0, 3.0])
    deviance, converged = profile_deviance(breaks_down, optimum, 1, optimum[1] + sd * steps)
    np.testing.assert_allclose(deviance[:3], steps[:3] ** 2, rtol=1e-6)
    assert np.isnan(deviance[3:]).all()
    np.testing.assert_array_equal(converged, [True, True, True, False, False])


def test_what_a_profile_says_of_ends_it_does_not_reach():
    low, both = np.array([np.nan, 1.0]), np.array([np.nan, np.nan])
    assert "not bounded below within" in _words("c_6", low, 1.0, 0.0, converged=True)
    assert "not bounded above within" in _words("c_6", low[::-1], 1.0, 0.0, converged=True)
    assert "bounded on no side" in _words("c_6", both, 1.0, 0.0, converged=True)
    assert "incomplete" in _words("c_6", both, 1.0, 0.0, converged=False)
