"""What a joint optimum is worth: noise said to be smaller than it is comes back as a factor of model error."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from synthetic_fit import synthetic_fit

from sysid.campaign.loggers import ClockFinding
from sysid.estimation.fit.evaluation import _fit_point
from sysid.estimation.fit.joint_optimum import NEAR_SD
from sysid.estimation.fit.state import FitState
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.problem import Problem
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_clocks import run_clocks
from sysid.estimation.residuals.run_motion import RUN_UNKNOWNS
from sysid.estimation.uncertainty import information
from sysid.estimation.uncertainty.clock_columns import clock_columns
from sysid.estimation.uncertainty.information import (
    AdjustedInformation,
    BlockInformation,
    adjusted_information,
    footprints_following,
    information_with,
    model_error,
    optimum_information,
)
from sysid.estimation.uncertainty.joint_step import JointStep
from sysid.estimation.uncertainty.normal_equations import NormalEquations
from sysid.estimation.uncertainty.part_agreement import PartAgreement, part_agreement

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
    left = NormalEquations.of(data.matrix, sd=data.sd).eliminate(slice(count, None)).left.matrix
    assert np.allclose(found.inflation, data.factor)  # no direction of its own
    expected = np.linalg.solve(data.flattening, np.linalg.solve(data.factor * left, pull))
    np.testing.assert_allclose(np.linalg.solve(found.information, found.slope), expected, rtol=1e-6)


def test_the_information_is_the_precision_of_the_data(found):
    np.testing.assert_allclose(found.information, found.data.precision(), rtol=1e-9)
    assert found.response.amounts.shape == found.data.sd.shape


def test_masses_follow_the_truck_that_the_data_show(fit, found):
    """Against the joint normal distribution of parameters x, model error e, and masses and departures y given x."""
    state, count = fit.state, fit.truth.size
    problem, allowances = state.problem(), state.allowances
    laws = np.zeros((1, count))
    laws[0, :2] = 0.1, -0.05
    known = problem.vector(state.point.log_parameters), allowances, state.point.amounts
    found = adjusted_information(state.campaign, problem, *known, laws)
    matrix, sd, follow = found.data.matrix, found.data.sd, found.integrated.following
    free = sd > 0.0
    # What the data show of (x, e, y).
    shown = np.zeros((len(matrix), count + 1 + sd.size))
    shown[:count, :count], shown[:count, count], shown[count:, count + 1 :] = follow, follow @ laws[0], np.eye(sd.size)
    dense = shown.T @ matrix @ shown
    dense[count, count] += 1.0
    for j in np.flatnonzero(free):
        dense[count + 1 + j, count + 1 + j] += sd[j] ** -2
    chosen = np.array([count, *(count + 1 + np.flatnonzero(free))])
    given_x = np.linalg.inv(dense[np.ix_(chosen, chosen)])
    response = -given_x @ dense[chosen][:, :count]
    scale = np.sqrt(np.diag(given_x))[1:, None]
    np.testing.assert_allclose(found.response.response[free] / scale, response[1:] / scale, rtol=1e-4, atol=1e-3)
    covariance = found.response.factor[free] @ found.response.factor[free].T
    np.testing.assert_allclose(covariance / scale / scale.T, given_x[1:, 1:] / scale / scale.T, atol=1e-4)
    without = adjusted_information(state.campaign, problem, *known).response.response[free]
    assert np.abs((without - response[1:]) / scale).max() > 1.0


@pytest.mark.parametrize("held", [True, False])
def test_what_data_push_against_the_end_of_its_range_stays_there(fit, monkeypatch, held):
    """The density of one unknown, whose records want it below zero, has no slope there."""
    state, count = fit.state, fit.truth.size
    problem, allowances = state.problem(), state.allowances
    names = [d.name for d in allowances.departures.directions]
    one = len(allowances.masses.factors) + names.index("friction_3")
    alone = np.where(np.arange(allowances.count) == one, 0.01, 0.0)

    def of_one(*arguments):
        whole = model_error(*arguments)
        return replace(whole, sd=alone, held=(alone > 0.0) & held)

    compared = []

    def of_parts(*arguments):
        compared.append(arguments[-1])
        return part_agreement(*arguments)

    monkeypatch.setattr(information, "model_error", of_one)
    monkeypatch.setattr(information, "part_agreement", of_parts)
    known = state.campaign, problem, problem.vector(state.point.log_parameters), allowances, state.point.amounts
    integrated = adjusted_information(*known).integrated
    score = optimum_information(*known).score
    along = integrated.directions[:, 0]
    assert integrated.sizes.size == 1
    assert score[count + one] > 0.0
    slope = (along @ score / integrated.factor + integrated.pull[0]) / np.sqrt(integrated.sizes[0])
    assert abs(slope) < 1e-9 if held else abs(slope) > 0.05
    np.testing.assert_array_equal(compared, [np.zeros_like(alone) if held else alone])


def test_masses_and_tires_have_settled_where_the_fit_ends(fit):
    assert fit.result.converged
    assert remaining(fit.state).largest < NEAR_SD
    # Moved off, the step leads back: by what it was, but for what the directions bend.
    change = np.zeros(fit.state.allowances.count)
    names = [d.name for d in fit.state.allowances.departures.directions]
    at = len(fit.state.allowances.masses.factors) + names.index("footprint_1[empty]")
    change[at] = 0.02
    assert remaining(fit.state, change).amounts[at] == pytest.approx(-0.02, abs=0.006)


SD_S, SD_RATE, MOVED_S, MOVED_RATE = 5e-4, 1.5e-4, 2e-4, -5e-5


def deflections(sensor) -> bool:
    return sensor.kind == "suspension_deflection"


def of_two_loggers(fit, of_second, moved_s: float = 0.0, late_s: float = 0.0, late_rate: float = 0.0):
    """Problem and campaign of the fit with a second logger of late stamps, whose clock a fit has moved by `moved_s`."""
    state, about_s = fit.state, 1.0
    runs = []
    for run in state.campaign.bump_runs:
        channels = []
        for c in run.log.channels:
            if of_second(c.sensor):
                time_s = c.time_s + late_s + late_rate * (c.time_s - about_s)
                c = replace(c, sensor=replace(c.sensor, logger="b"), time_s=time_s)
            channels.append(c)
        runs.append(replace(run, log=replace(run.log, channels=tuple(channels), span_s=run.log.duration_s)))
    clocks = tuple(
        ClockFinding(r.log.file, "b.csv", "b", "motion", 0.0, SD_S, about_s, 0.0, SD_RATE, moved_s=moved_s)
        for r in runs
    )
    campaign = replace(state.campaign, bump_runs=tuple(runs), clocks=clocks)
    model = bump_model(campaign, state.parameters, state.profiles, tires=state.model.tires)
    model = state.allowances.moved(model, state.point.amounts)
    return Problem(model, campaign, state.point.motion, state.point.weights), campaign


def with_clocks(fit, *arguments, **choices) -> BlockInformation:
    problem, campaign = of_two_loggers(fit, *arguments, **choices)
    vector = problem.vector(fit.state.point.log_parameters)
    return information_with(campaign, problem, vector, clocks=run_clocks(campaign), with_parts=True)


def test_late_stamps_are_found(fit):
    # Offset and rate by which the stamps were made late; the readings know 0.05 ms and some 50 ppm here.
    before = with_clocks(fit, deflections).clocks
    after = with_clocks(fit, deflections, late_s=MOVED_S, late_rate=MOVED_RATE).clocks
    assert np.max(before.sd[:, 0]) < 0.1
    found = after.alone - before.alone
    np.testing.assert_allclose(found[:, 0] * SD_S, -MOVED_S, rtol=0.05)
    np.testing.assert_allclose(found[:, 1] * SD_RATE, -MOVED_RATE, atol=0.3 * abs(MOVED_RATE))


def test_a_clock_of_all_sensors_is_the_start_of_the_run(fit):
    # That is free anyway, and what follows some sensors follows all others the other way.  Clocks known to less than
    # readings tell, so that what they take is the square of how they are followed.
    state = fit.state
    problem, campaign = of_two_loggers(fit, deflections)
    vector = problem.vector(state.point.log_parameters)
    known = run_clocks(campaign)
    offsets = replace(known, sd=known.sd * np.array([1e-3, 0.0]))
    free = information_with(campaign, problem, vector).matrix
    lost = {}
    for name, of_second in (("all", lambda s: True), ("some", deflections), ("others", lambda s: not deflections(s))):
        problem, campaign = of_two_loggers(fit, of_second)
        lost[name] = free - information_with(campaign, problem, vector, clocks=offsets).matrix
    largest = np.abs(lost["some"]).max()
    assert np.abs(lost["all"]).max() < 0.05 * largest
    np.testing.assert_allclose(lost["some"], lost["others"], atol=0.1 * largest)


def test_clocks_follow_as_in_one_dense_least_squares_problem(fit):
    problem, campaign = of_two_loggers(fit, deflections, moved_s=MOVED_S)
    vector, clocks = problem.vector(fit.state.point.log_parameters), run_clocks(campaign)
    found = information_with(campaign, problem, vector, clocks=clocks, with_parts=True)
    count, runs = problem.count, len(campaign.bump_runs)
    _, motion = problem.unpack(vector)
    blocks, values = [], []
    for position, group in enumerate(problem.model.groups):
        here = problem.linearise_one(vector, position)
        own = clock_columns(problem, position, here, clocks)
        prior, by_motion = problem.expected.rows(motion, group.runs)
        for r, run in enumerate(group.runs):
            of_run = slice(count + 5 * run, count + 5 * run + 5)
            rows = np.concatenate(
                [np.asarray(here.residual_jacobian)[:, r].reshape(-1, count + 3), np.asarray(here.gain_jacobian)[r]]
            )
            more = np.concatenate([own.residual[:, r].reshape(-1, 2), own.gain[r]])
            block = np.zeros((rows.shape[0] + 4, count + 5 * runs))
            block[: rows.shape[0], :count], block[: rows.shape[0], of_run] = (
                rows[:, :count],
                np.hstack([rows[:, count:], more]),
            )
            block[-4:-2, count + 5 * run : count + 5 * run + RUN_UNKNOWNS] = by_motion[r]
            block[-2:, count + 5 * run + RUN_UNKNOWNS : count + 5 * run + 5] = np.eye(2)
            blocks.append(block)
            residual = [np.asarray(here.residual)[:, r].ravel(), np.asarray(here.gain_residual)[r]]
            # The fit has moved the clock by this many standard deviations.
            values.append(np.concatenate([*residual, prior[r], [MOVED_S / SD_S, 0.0]]))
    dense, value = np.vstack(blocks), np.concatenate(values)
    step = -np.linalg.solve(dense.T @ dense, dense.T @ value)
    of_clocks = step[count:].reshape(runs, 5)[:, RUN_UNKNOWNS:]
    np.testing.assert_allclose(found.clocks.step(step[:count]), of_clocks, rtol=1e-6, atol=1e-9)
    covariance = np.linalg.inv(dense.T @ dense)[:count, :count]
    np.testing.assert_allclose(np.linalg.inv(found.matrix), covariance, rtol=1e-5, atol=1e-12)
    np.testing.assert_allclose(-np.linalg.solve(found.matrix, found.score), step[:count], rtol=2e-5)
    assert len(found.blocks) == len(found.scores) == len(found.parts)
    np.testing.assert_allclose(found.parts.sum(axis=0), found.matrix, atol=2e-10 * np.abs(found.matrix).max())


@pytest.mark.parametrize("faster", [1.0, 1.03])
def test_the_pull_on_speeds_counts_as_in_one_dense_least_squares_problem(fit, faster: float):
    """Runs whose nominal speeds are a standard deviation off pull k and c along: the step of the parameters alone."""
    state = fit.state
    campaign = replace(
        state.campaign,
        bump_runs=tuple(replace(r, nominal_speed_m_s=r.nominal_speed_m_s * faster) for r in state.campaign.bump_runs),
    )
    problem = Problem(state.model, campaign, state.point.motion, state.point.weights)
    vector = problem.vector(state.point.log_parameters)
    found = information_with(campaign, problem, vector, with_parts=True)
    count, runs = problem.count, len(campaign.bump_runs)
    _, motion = problem.unpack(vector)
    rows, values = [], []
    for position, group in enumerate(problem.model.groups):
        here = problem.linearise_one(vector, position)
        prior, by_motion = problem.expected.rows(motion, group.runs)
        for r, run in enumerate(group.runs):
            of_run = slice(count + RUN_UNKNOWNS * run, count + RUN_UNKNOWNS * (run + 1))
            of_data = [np.asarray(here.residual_jacobian)[:, r].reshape(-1, count + RUN_UNKNOWNS)]
            of_data.append(np.asarray(here.gain_jacobian)[r])
            block = np.zeros((sum(map(len, of_data)) + len(by_motion[r]), count + RUN_UNKNOWNS * runs))
            block[: -len(by_motion[r]), :count] = np.concatenate(of_data)[:, :count]
            block[: -len(by_motion[r]), of_run] = np.concatenate(of_data)[:, count:]
            block[-len(by_motion[r]) :, of_run] = by_motion[r]
            rows.append(block)
            values += [np.asarray(here.residual)[:, r].ravel(), np.asarray(here.gain_residual)[r], prior[r]]
    dense, value = np.vstack(rows), np.concatenate(values)
    step = -np.linalg.solve(dense.T @ dense, dense.T @ value)[:count]
    np.testing.assert_allclose(-np.linalg.solve(found.matrix, found.score), step, rtol=1e-8)
    np.testing.assert_allclose(found.parts.sum(axis=0), found.matrix, atol=2e-10 * np.abs(found.matrix).max())


def test_one_logger_has_no_clock_to_follow(fit):
    assert run_clocks(fit.state.campaign) is None
    assert fit.state.point.clocks == ()


@pytest.mark.parametrize("maps_follow", [False, True])
def test_the_mode_is_that_of_the_posterior(maps_follow: bool):
    """A linear model whose noise is nine times as large in variance as the likelihood has it; priors pull strongly."""
    random, factor = np.random.default_rng(8), 9.0
    root = random.normal(size=(6, 3))
    data, rows = root.T @ root, np.diag([1.0, 2.0, 0.7])
    value, targets = random.normal(size=3), random.normal(size=3)
    follow = np.eye(3) + 0.3 * maps_follow * random.normal(size=(3, 3))
    prior = rows.T @ rows
    optimum = np.linalg.solve(data + prior, data @ value + rows.T @ targets)

    def mode(larger: float) -> np.ndarray:
        """Of the density with residuals taken at the optimum plus `follow` times the change."""
        information = follow.T @ data @ follow / larger
        gradient = follow.T @ data @ (value - optimum) / larger + rows.T @ (targets - rows @ optimum)
        return optimum + np.linalg.solve(information + prior, gradient)

    pull = rows.T @ (rows @ optimum - targets)
    own = follow.T @ data @ follow
    known = AdjustedInformation(
        information=own / factor,
        integrated=None,
        inflation=np.full(3, factor),
        slope=follow.T @ pull / factor,
        data=None,
        response=SimpleNamespace(amounts=np.zeros(0)),
        parts=PartAgreement((), np.zeros((0, 3))),
        mode=np.zeros(0),
    )
    model = SimpleNamespace(
        parameters=SimpleNamespace(prior_pull=lambda x: (rows.T @ (rows @ x - targets), prior)),
        felt=SimpleNamespace(contact="footprint"),
        tires=None,
        target_step_s=0.001,
    )
    problem = SimpleNamespace(model=model, weights=None, unpack=lambda vector: (vector, None))
    point = _fit_point(problem, optimum, known, np.linalg.inv(own / factor + prior))
    np.testing.assert_allclose(point.mode, mode(factor), rtol=1e-10)
    assert np.abs(mode(1.0) - mode(factor)).max() > 0.1
    np.testing.assert_allclose(point.covariance, np.linalg.inv(own / factor + prior))
