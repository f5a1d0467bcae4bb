"""What a joint optimum is worth: noise said to be smaller than it is comes back as a factor of model error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_fit import synthetic_fit

from sysid.campaign.clocks.settings import ClockFinding
from sysid.estimation.fit.joint_optimum import NEAR_SD
from sysid.estimation.fit.state import FitState
from sysid.estimation.residuals.problem import Problem
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.uncertainty.clock_loss import clock_loss
from sysid.estimation.uncertainty.information import (
    AdjustedInformation,
    adjusted_information,
    footprints_following,
    model_error,
    optimum_information,
)
from sysid.estimation.uncertainty.joint_step import JointStep, integrated

TOO_SMALL = 3.0


def remaining(state: FitState, change: np.ndarray | None = None) -> JointStep:
    """The step that is left at an optimum, or `change` (q,) off it in masses and departures."""
    allowances, problem = state.allowances, state.problem()
    vector, amounts = problem.vector(state.point.log_parameters), state.point.amounts
    if change is not None:
        amounts = amounts + change
        problem = Problem(allowances.moved(state.model, amounts), state.campaign, state.point.motion, problem.weights)
    rows, targets = state.parameters.prior_rows()
    pull = rows.T @ (rows @ state.point.log_parameters - targets)
    following = footprints_following(problem, state.point.log_parameters, allowances)
    data = optimum_information(state.campaign, problem, vector, allowances, amounts)
    return model_error(data, rows.T @ rows, pull, allowances, amounts, following).step


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


def test_masses_and_tires_have_settled_where_the_fit_ends(fit):
    assert fit.result.converged
    assert remaining(fit.state).largest < NEAR_SD
    # Moved off, the step leads back: by what it was, but for what the directions bend.
    change = np.zeros(fit.state.allowances.count)
    names = [d.name for d in fit.state.allowances.departures.directions]
    at = len(fit.state.allowances.masses.factors) + names.index("footprint_1[empty]")
    change[at] = 0.02
    assert remaining(fit.state, change).amounts[at] == pytest.approx(-0.02, abs=0.006)


def clocks_known_to(fit, sd_s: float, logger_of) -> np.ndarray | None:
    """Information that is lost where some sensors go by another clock, known to `sd_s` in every run."""
    state = fit.state
    sensors = tuple(replace(s, logger="b" if logger_of(s) else "") for s in state.model.layout.sensors)
    model = replace(state.model, layout=replace(state.model.layout, sensors=sensors))
    clocks = tuple(
        ClockFinding(run.log.file, "b.csv", "b", "motion", 0.0, sd_s, 1.0, 0.0, 0.0) for run in state.campaign.bump_runs
    )
    campaign = replace(state.campaign, clocks=clocks)
    problem = Problem(model, campaign, state.point.motion, state.problem().weights)
    return clock_loss(campaign, problem, problem.vector(state.point.log_parameters), [])


def test_a_clock_of_all_sensors_is_the_start_of_the_run(fit):
    # That is free anyway, so nothing is lost; with the clock of one axle much is.
    everything = clocks_known_to(fit, 1e-3, lambda s: True)
    one_axle = clocks_known_to(fit, 1e-3, lambda s: s.axle == 1)
    assert np.trace(everything) < 1e-3 * np.trace(one_axle)
    assert np.linalg.eigvalsh(one_axle).min() > -1e-9 * np.trace(one_axle)


def test_a_clock_of_some_sensors_is_one_of_all_others_the_other_way(fit):
    some = clocks_known_to(fit, 1e-3, lambda s: s.kind == "suspension_deflection")
    others = clocks_known_to(fit, 1e-3, lambda s: s.kind != "suspension_deflection")
    np.testing.assert_allclose(some, others, atol=2e-2 * np.abs(some).max())


def test_nothing_is_lost_with_a_clock_that_is_known(fit):
    assert clock_loss(fit.state.campaign, fit.state.problem(), np.zeros(0), []) is None
    losses = [np.trace(clocks_known_to(fit, sd, lambda s: s.axle == 1)) for sd in (1e-6, 1e-3, 1e-2)]
    # By the variance while it is small.
    assert losses[0] == pytest.approx(1e-6 * losses[1], rel=0.5)
    assert losses[1] < losses[2]
