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
from sysid.estimation.uncertainty.clock_response import ClockResponse, clock_response
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


def by_clocks(fit, logger_of, sd_s: float = 1e-3) -> ClockResponse:
    """How the optimum follows a clock by which some sensors go, known to `sd_s` in every run."""
    state = fit.state
    sensors = tuple(replace(s, logger="b" if logger_of(s) else "") for s in state.model.layout.sensors)
    model = replace(state.model, layout=replace(state.model.layout, sensors=sensors))
    clocks = tuple(
        ClockFinding(run.log.file, "b.csv", "b", "motion", 0.0, sd_s, 1.0, 0.0, 0.0) for run in state.campaign.bump_runs
    )
    campaign = replace(state.campaign, clocks=clocks)
    problem = Problem(model, campaign, state.point.motion, state.problem().weights)
    found = clock_response(campaign, problem, problem.vector(state.point.log_parameters), [])
    assert found is not None
    return found


def test_a_clock_of_all_sensors_is_the_start_of_the_run(fit):
    # That is free anyway: nothing follows, and what follows some sensors follows all others the other way.
    everything = by_clocks(fit, lambda s: True).across
    some = by_clocks(fit, lambda s: s.kind == "suspension_deflection").across
    others = by_clocks(fit, lambda s: s.kind != "suspension_deflection").across
    assert some.shape == (len(fit.state.parameters.parameters), len(fit.state.campaign.bump_runs))
    assert np.linalg.norm(everything) < 0.1 * np.linalg.norm(some)
    np.testing.assert_allclose(some, -others, atol=0.1 * np.abs(some).max())


def test_clocks_widen_the_covariance_by_what_the_optimum_follows():
    # Three unknowns, two clocks: the covariance of x + K t in closed form.
    random = np.random.default_rng(2)
    root = random.normal(size=(3, 3))
    information, across, sd = root @ root.T + np.eye(3), random.normal(size=(3, 2)), np.array([0.3, 2.0])
    without = np.linalg.inv(information)
    moved = without @ across
    left = information - ClockResponse(2.0 * across, sd).lost(information, 2.0)
    np.testing.assert_allclose(np.linalg.inv(left), without + moved @ np.diag(sd**2) @ moved.T, rtol=1e-9)


def test_one_logger_has_no_clock_to_follow(fit):
    state = fit.state
    problem = state.problem()
    assert clock_response(state.campaign, problem, problem.vector(state.point.log_parameters), []) is None
