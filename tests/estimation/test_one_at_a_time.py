"""What is done run by run, group by group or stretch by stretch to save memory is what all at once would be."""

from __future__ import annotations

import weakref
from time import sleep

import numpy as np
import pytest
from fit_states import state_at
from rigid_truck import EMPTY, LADEN, bump, campaign, empty_run, true_log_parameters

from sysid import limits
from sysid.campaign.records import Campaign
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.residuals import problem as problem_module
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.by_group import AT_ONCE, each_group
from sysid.estimation.residuals.compressed import run_normals
from sysid.estimation.residuals.problem import Problem
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RUN_UNKNOWNS, RunMotion
from sysid.estimation.uncertainty.allowances import campaign_allowances
from sysid.estimation.uncertainty.information import BlockInformation, optimum_information
from sysid.estimation.uncertainty.residual_columns import ResidualColumns, channel_columns
from sysid.estimation.weights.reweighting import reweighted
from sysid.vehicle_model.engines.protocol import Linearisation

#: Three hundred samples are more than go through one block, and no multiple of them.
SAMPLES, RUNS, CHANNELS, PARAMETERS = 300, 3, 2, 4


@pytest.fixture
def linearisation() -> Linearisation:
    random, width = np.random.default_rng(3), PARAMETERS + RUN_UNKNOWNS
    shapes = (SAMPLES, RUNS, CHANNELS), (SAMPLES, RUNS, CHANNELS, width), (RUNS, CHANNELS), (RUNS, CHANNELS, width)
    return Linearisation(*(random.normal(size=shape) for shape in shapes), random.normal(size=shapes[0]))


def two_runs() -> Campaign:
    runs = [empty_run("a.csv", 6.0, samples=300), empty_run("b.csv", 8.5, samples=900, load_case="laden")]
    return campaign(runs, load_cases=(EMPTY, LADEN))


@pytest.fixture
def problem() -> Problem:
    """Two runs so unlike in length that they make two groups."""
    data = two_runs()
    model = bump_model(data, campaign_parameters(data, None), {"bump": bump()})
    assert len(model.groups) == 2
    shapes = [group.value.shape[1:] for group in model.groups]
    weights = Weights(
        tuple(np.full(s, 0.1) for s in shapes), tuple(np.full(s, 1.0 - 0.3 * k) for k, s in enumerate(shapes))
    )
    motion = RunMotion(np.array([6.1, 8.3]), np.array([0.44, 0.61]), np.zeros(2))
    return state_at(data, model, true_log_parameters(model.parameters.names), motion, weights).problem()


def test_normal_matrices_of_runs_are_those_of_all_rows(linearisation: Linearisation) -> None:
    for r, normal in enumerate(run_normals(linearisation)):
        rows = np.concatenate([linearisation.residual_jacobian[:, r].reshape(-1, 7), linearisation.gain_jacobian[r]])
        right = np.concatenate([linearisation.residual[:, r].ravel(), linearisation.gain_residual[r]])
        whole = np.column_stack([rows, right])
        np.testing.assert_allclose(normal, whole.T @ whole, rtol=1e-12, atol=1e-10)


def test_columns_of_several_kinds_stand_before_those_of_the_runs_own_unknowns(linearisation: Linearisation) -> None:
    random = np.random.default_rng(4)
    kinds = [
        ResidualColumns(random.normal(size=(SAMPLES, RUNS, CHANNELS, n)), random.normal(size=(RUNS, CHANNELS, n)))
        for n in (2, 1)
    ]
    for r, c in np.ndindex(RUNS, CHANNELS):
        rows, gain = channel_columns(linearisation, r, c, *kinds)
        np.testing.assert_array_equal(rows[:, [0, 1, 2, 3, 7, 8, 9]], linearisation.residual_jacobian[:, r, c])
        np.testing.assert_array_equal(gain[[0, 1, 2, 3, 7, 8, 9]], linearisation.gain_jacobian[r, c])
        np.testing.assert_array_equal(rows[:, 4:6], kinds[0].residual[:, r, c])
        np.testing.assert_array_equal(rows[:, 6], kinds[1].residual[:, r, c, 0])
        np.testing.assert_array_equal(gain[4:6], kinds[0].gain[r, c])
        np.testing.assert_array_equal(gain[6:7], kinds[1].gain[r, c])


def test_one_group_is_linearised_as_among_all_and_not_kept(problem: Problem) -> None:
    vector = problem.vector(problem.model.parameters.start)
    alone = [problem.linearise_one(vector, position) for position in range(2)]
    assert problem._latest is None
    together = problem.linearise(vector)
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(np.asarray(one.residual_jacobian), np.asarray(other.residual_jacobian))
    assert problem.linearise_one(vector, 1) is together[1]


@pytest.fixture
def little_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "DERIVATIVES_BYTES", 0)


def test_group_by_group_the_compressed_problem_is_the_same_and_nothing_is_kept(
    problem: Problem, little_memory: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    vector = problem.vector(problem.model.parameters.start) + 1e-3
    assert problem.by_group
    in_turn = problem.compressed(vector)
    assert problem._latest is None
    monkeypatch.undo()
    whole = Problem(problem.model, two_runs(), problem.reference_motion, problem.weights)
    assert not whole.by_group
    together = whole.compressed(vector)
    np.testing.assert_array_equal(in_turn.residual, together.residual)
    np.testing.assert_array_equal(in_turn.jacobian, together.jacobian)
    # The small problem is stored for its point and for no other.
    assert whole.compressed(vector) is together
    assert whole.compressed(vector + 1e-3) is not together
    # Nor under other weights.
    first = whole.compressed(vector)
    halved = tuple(0.5 * of_group for of_group in problem.weights.tempering)
    whole.weights = Weights(problem.weights.noise_sd, halved)
    assert not np.allclose(whole.compressed(vector).jacobian, first.jacobian, rtol=1e-3)


def test_group_by_group_masses_and_departures_give_the_same_information_and_weights(
    problem: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    data, vector = two_runs(), problem.vector(problem.model.parameters.start)
    allowances = campaign_allowances(data, problem.model.parameters, problem.model.felt)
    amounts = 0.3 * np.concatenate([allowances.masses.sd, np.full(len(allowances.departures.directions), 0.01)])

    def found() -> tuple[BlockInformation, Weights]:
        information = optimum_information(data, problem, vector, allowances, amounts)
        return information, reweighted(problem, problem.linearise(vector))

    together, weights = found()
    monkeypatch.setattr(limits, "DERIVATIVES_BYTES", 0)
    del problem.__dict__["by_group"]
    in_turn, of_groups = found()
    assert problem.by_group
    # What was asked for under other weights stays what it was.
    asked, before = problem.linearise(vector), problem.linearise(vector)[0]
    problem.weights = weights
    np.testing.assert_array_equal(np.asarray(asked[0].residual), np.asarray(before.residual))
    np.testing.assert_allclose(in_turn.matrix, together.matrix, rtol=1e-9, atol=1e-9 * np.abs(together.matrix).max())
    np.testing.assert_allclose(in_turn.scores, together.scores, rtol=1e-9, atol=1e-9 * np.abs(together.scores).max())
    assert in_turn.blocks == together.blocks
    for one, other in zip(of_groups.noise_sd, weights.noise_sd, strict=True):
        np.testing.assert_array_equal(one, other)
    for one, other in zip(of_groups.tempering, weights.tempering, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)


def test_no_more_than_two_groups_are_in_memory(problem: Problem, little_memory: None) -> None:
    alive, most = 0, 0

    def one(k: int) -> int:
        nonlocal alive, most
        alive += 1
        most = max(most, alive)
        sleep(0.01)
        alive -= 1
        return k

    assert each_group(one, 7) == tuple(range(7))
    assert most <= AT_ONCE


def test_derivatives_of_the_last_point_go_before_those_of_the_next_are_made(
    problem: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    vector = problem.vector(problem.model.parameters.start)
    kept = weakref.ref(problem.linearise(vector)[0].residual_jacobian)
    assert kept() is not None
    gone = []
    monkeypatch.setattr(problem_module, "linearise", lambda *given: gone.append(kept() is None))
    problem.linearise(vector + 1e-3)
    assert gone == [True]
