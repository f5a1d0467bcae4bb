"""What is done run by run, group by group or stretch by stretch to save memory is what all at once would be."""

from __future__ import annotations

import weakref

import numpy as np
import pytest
from fit_states import state_at
from rigid_truck import bump, campaign, empty_run, true_log_parameters

from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.residuals import problem as problem_module
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.compressed import run_normals
from sysid.estimation.residuals.problem import Problem
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RUN_UNKNOWNS, RunMotion
from sysid.estimation.uncertainty.residual_columns import ResidualColumns, channel_columns
from sysid.vehicle_model.engines.protocol import Linearisation

#: Three hundred samples are more than go through one block, and no multiple of them.
SAMPLES, RUNS, CHANNELS, PARAMETERS = 300, 3, 2, 4


@pytest.fixture
def linearisation() -> Linearisation:
    random, width = np.random.default_rng(3), PARAMETERS + RUN_UNKNOWNS
    shapes = (SAMPLES, RUNS, CHANNELS), (SAMPLES, RUNS, CHANNELS, width), (RUNS, CHANNELS), (RUNS, CHANNELS, width)
    return Linearisation(*(random.normal(size=shape) for shape in shapes), random.normal(size=shapes[0]))


@pytest.fixture
def problem() -> Problem:
    """Two runs so unlike in length that they make two groups."""
    runs = [empty_run("a.csv", 6.0, samples=300), empty_run("b.csv", 8.5, samples=900)]
    data = campaign(runs)
    model = bump_model(data, campaign_parameters(data, None), {"bump": bump()})
    assert len(model.groups) == 2
    shapes = [group.value.shape[1:] for group in model.groups]
    weights = Weights(tuple(np.full(s, 0.1) for s in shapes), tuple(np.ones(s) for s in shapes))
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
