"""What a joint optimum is worth: noise said to be smaller than it is comes back as a factor of model error."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic_fit import synthetic_fit

from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.uncertainty.information import AdjustedInformation, adjusted_information
from sysid.estimation.uncertainty.joint_step import integrated

TOO_SMALL = 3.0


@pytest.fixture(scope="module")
def fit():
    return synthetic_fit()


@pytest.fixture(scope="module")
def found(fit) -> AdjustedInformation:
    state = fit.state
    problem = state.problem()
    weights = problem.weights
    smaller = Weights(tuple(n / TOO_SMALL for n in weights.noise_sd), weights.tempering, weights.reading)
    problem = problem.with_weights(smaller)
    vector = problem.vector(state.point.log_parameters)
    return adjusted_information(state.campaign, problem, vector, state.allowances, state.point.amounts)


def test_noise_that_is_said_three_times_too_small_is_found_out(fit, found):
    # 24 histories leave the factor 9 to within a quarter or so.
    assert found.data.factor == pytest.approx(TOO_SMALL**2, rel=0.35)
    sd = np.sqrt(np.diag(found.data.covariance()))
    np.testing.assert_allclose(sd, np.sqrt(np.diag(fit.result.covariance)), rtol=0.35)


def test_the_likelihood_has_its_maximum_where_the_data_have_theirs(fit, found):
    """The factor widens it and does not move it: off the joint optimum by what the priors pulled."""
    data, count = found.data, fit.truth.size
    rows, targets = fit.parameters.prior_rows()
    pull = rows.T @ (rows @ fit.state.point.log_parameters - targets)
    left = integrated(data.matrix, count, data.sd).information
    assert np.allclose(found.adjustment.inflation, data.factor)  # no direction of its own
    expected = np.linalg.solve(data.flattening, np.linalg.solve(data.factor * left, pull))
    np.testing.assert_allclose(np.linalg.solve(found.adjustment.information, found.slope), expected, rtol=1e-6)


def test_the_engine_s_likelihood_is_flattened_to_the_precision_of_the_data(found):
    np.testing.assert_allclose(found.adjustment.information, found.data.precision(), rtol=1e-9)
    assert found.response.amounts.shape == found.data.sd.shape
