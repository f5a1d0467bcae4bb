"""What is integrated out of the density, against dense normal distributions and a quadrature."""

from __future__ import annotations

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
    found = integrated_unknowns(
        both.T @ both / f, 0.1 * np.eye(p), effects, sd, amounts, np.array([1.0, 0.0]), f, following
    )
    points = 0.5 * random.normal(size=(20, p))

    def density(known) -> np.ndarray:
        change, share = known.simulated(points)
        residual = value + change @ by_x.T
        squares, products = (residual**2).sum(axis=1), (residual @ both @ known.directions).T
        return known.log_density(squares, products, share)

    covariance = f * np.eye(40) + (by_y * sd**2) @ by_y.T + by_x @ effects @ effects.T @ by_x.T
    # The prior of y has its mean at 0, the residuals are those at y_0.
    dense = multivariate_normal(by_y @ amounts, covariance).logpdf(value + points @ following.T @ by_x.T)
    # What is left out moves half a thousandth at most for each direction.
    np.testing.assert_allclose(density(found) - density(found)[0], dense - dense[0], atol=5e-3)
    known = both.T @ both / f, 0.1 * np.eye(p), effects[:, :0], 0.0 * sd, amounts, np.zeros(2), f, following
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
    found = integrated_unknowns(*given, np.ones(1), 1.0, np.eye(2))
    frozen = integrated_unknowns(*given, np.zeros(1), 1.0, np.eye(2))

    def shown(x: np.ndarray) -> np.ndarray:
        return (np.exp(np.array([4.0, -1.0]) * x) - 1.0) / noise

    points = np.array([[0.0, 0.0], [far, far], [far + 3e-4, far - 2e-4], [-far, -far]])

    def density(known) -> np.ndarray:
        change, share = known.simulated(points)
        residual = shown(change)
        return known.log_density((residual**2).sum(axis=1), (residual @ both @ known.directions).T, share)

    y = np.linspace(-0.04, 0.04, 16001)
    squares = (shown(points[:, None, :] - y[:, None]) ** 2).sum(axis=-1) + (y / sd) ** 2
    exact = logsumexp(-0.5 * squares, axis=1)
    np.testing.assert_allclose(density(found) - density(found)[0], exact - exact[0], atol=0.02)
    if far > 0.01:
        assert np.abs(density(frozen) - density(frozen)[0] - exact + exact[0]).max() > 1.0
