"""What is integrated out of the density, against dense normal distributions and a quadrature."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from sysid.estimation.uncertainty.integrated_unknowns import integrated_unknowns


def test_a_linear_model_has_the_density_of_the_dense_covariance() -> None:
    """Masses, model error and a factor on the noise: r ~ N(0, f I + J_y S J_y' + J_x E E' J_x')."""
    random, p, q, f = np.random.default_rng(4), 3, 2, 2.5
    by_x, by_y, value = random.normal(size=(40, p)), random.normal(size=(40, q)), random.normal(size=40)
    sd, amounts, effects = np.array([0.1, 0.3]), np.array([0.05, -0.2]), 0.2 * random.normal(size=(p, 1))
    following = np.eye(p) + 0.2 * random.normal(size=(p, p))
    both = np.hstack([by_x, by_y])
    found = integrated_unknowns(both.T @ both / f, 0.1 * np.eye(p), effects, sd, amounts, f, following)
    points = 0.5 * random.normal(size=(20, p))

    def density(known) -> np.ndarray:
        followed = known.followed(points)
        residual = value + known.simulated(followed) @ by_x.T
        squares, products = (residual**2).sum(axis=1), (residual @ both @ known.directions).T
        return known.log_density(squares, products, followed)

    covariance = f * np.eye(40) + (by_y * sd**2) @ by_y.T + by_x @ effects @ effects.T @ by_x.T
    # The prior of y has its mean at 0, the residuals are those at y_0.
    dense = multivariate_normal(by_y @ amounts, covariance).logpdf(value + points @ following.T @ by_x.T)
    # What is left out moves half a thousandth at most for each direction.
    np.testing.assert_allclose(density(found) - density(found)[0], dense - dense[0], atol=5e-3)
    known = both.T @ both / f, 0.1 * np.eye(p), effects[:, :0], 0.0 * sd, amounts, f, following
    alone = density(integrated_unknowns(*known))
    assert np.ptp(alone - alone[0] - dense + dense[0]) > 1.0


@pytest.mark.parametrize("far", [0.005, 0.015])
def test_a_share_that_no_motion_shows_is_integrated_exactly(far: float) -> None:
    """Readings show exp(4 (x_1 - y)) and exp(y - x_2): a mass y that forces x follow, known far worse than by data.

    Columns of the optimum alone would be wrong by a whole unit of log-density three standard deviations away.
    """
    noise, sd = 5e-4, 5e-3
    by_x, by_y = np.array([[4.0, 0.0], [0.0, -1.0]]), np.array([[-4.0], [1.0]])
    both = np.hstack([by_x, by_y]) / noise
    effects = np.zeros((2, 0))
    given = both.T @ both, 1e-12 * np.eye(2), effects, np.array([sd]), np.zeros(1)
    found = integrated_unknowns(*given, 1.0, np.eye(2))
    frozen = replace(found, simulated_share=np.eye(2), pull_by_change=0.0 * found.pull_by_change, rest=0.0 * found.rest)

    def shown(x: np.ndarray) -> np.ndarray:
        return (np.exp(np.array([4.0, -1.0]) * x) - 1.0) / noise

    points = np.array([[0.0, 0.0], [far, far], [far + 3e-4, far - 2e-4], [-far, -far]])

    def density(known) -> np.ndarray:
        followed = known.followed(points)
        residual = shown(known.simulated(followed))
        return known.log_density((residual**2).sum(axis=1), (residual @ both @ known.directions).T, followed)

    y = np.linspace(-0.04, 0.04, 16001)
    squares = (shown(points[:, None, :] - y[:, None]) ** 2).sum(axis=-1) + (y / sd) ** 2
    exact = logsumexp(-0.5 * squares, axis=1)
    np.testing.assert_allclose(density(found) - density(found)[0], exact - exact[0], atol=0.02)
    if far > 0.01:
        assert np.abs(density(frozen) - density(frozen)[0] - exact + exact[0]).max() > 1.0


def test_model_error_leaves_the_truck_where_the_data_want_it() -> None:
    """Readings show x + x^2 and have a misfit, and model error moves x much further than the data let it go.

    With the truck simulated at x, and the error taken back along the columns of the optimum, what is left of x^2 would
    explain the misfit.
    """
    noise, effect, random = 0.02, 0.3, np.random.default_rng(8)
    slope, curve = random.normal(size=(2, 60)) / noise / np.sqrt(60.0)
    # At the optimum the misfit has no share of the slope.
    misfit = -0.3 * curve + random.normal(size=60)
    misfit -= slope * (slope @ misfit) / (slope @ slope)
    nothing = np.zeros(0)
    found = integrated_unknowns(
        np.array([[slope @ slope]]), np.eye(1), np.array([[effect]]), nothing, nothing, 1.0, np.eye(1)
    )
    points = np.linspace(-0.6, 0.6, 7)[:, None]

    def shown(x: np.ndarray) -> np.ndarray:
        return misfit + slope * x[..., None] + curve * x[..., None] ** 2

    def density(known) -> np.ndarray:
        followed = known.followed(points)
        residual = shown(known.simulated(followed)[:, 0])
        products = (residual @ slope[:, None] @ known.directions).T
        values = known.log_density((residual**2).sum(axis=1), products, followed)
        return values - values[3]

    e = np.linspace(-6.0, 6.0, 24001)
    squares = (shown(points + effect * e) ** 2).sum(axis=-1) + e**2
    exact = logsumexp(-0.5 * squares, axis=1)
    assert np.ptp(exact) > 1.5
    np.testing.assert_allclose(density(found), exact - exact[3], atol=0.02)
    at_x = replace(found, simulated_share=np.eye(1), pull_by_change=np.zeros((1, 1)), rest=0.0 * found.rest)
    assert np.abs(density(at_x) - exact + exact[3]).max() > 20.0
