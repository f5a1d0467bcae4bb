"""Evidence for laws and promised gains against a joint linear least-squares problem solved by LAPACK."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from sysid.estimation.fit import law_evidence
from sysid.estimation.fit.law_evidence import Evidence, LawEvidence, evidence
from sysid.estimation.uncertainty.normal_equations import Eliminated, NormalEquations

PARAMETERS, FURTHER, CANDIDATES = 4, 3, 2
SD = np.array([0.5, 2.0, 1e-3])


@pytest.fixture
def linear():
    """Rows, readings and prior of a linear problem in parameters, masses and candidates; the parameters' optimum."""
    random = np.random.default_rng(8)
    rows = random.standard_normal((60, PARAMETERS + FURTHER + CANDIDATES))
    readings = random.standard_normal(60) + rows @ random.standard_normal(rows.shape[1])
    prior = np.diag([0.3, 0.0, 2.0, 1.0])
    target = random.standard_normal(PARAMETERS)
    own = np.concatenate([rows[:, :PARAMETERS], prior])
    optimum = np.linalg.lstsq(own, np.concatenate([readings, prior @ target]), rcond=None)[0]
    return rows, readings, prior, target, optimum


def least_squares(linear, columns: list[int], sd: np.ndarray) -> tuple[float, np.ndarray]:
    """Half the least sum of squares over the parameters and further columns with prior deviations, and where it is."""
    rows, readings, prior, target, _ = linear
    width = PARAMETERS + len(columns)
    used = rows[:, [*range(PARAMETERS), *columns]]
    priors = np.zeros((width, width))
    priors[:PARAMETERS, :PARAMETERS] = prior
    priors[PARAMETERS:, PARAMETERS:] = np.diag(1.0 / sd)
    whole = np.concatenate([used, priors])
    right = np.concatenate([readings, prior @ target, np.zeros(len(columns))])
    solution = np.linalg.lstsq(whole, right, rcond=None)[0]
    return 0.5 * float(((whole @ solution - right) ** 2).sum()), solution


def least_cost(linear, columns: list[int], sd: np.ndarray) -> float:
    return least_squares(linear, columns, sd)[0]


def data_of(linear):
    rows, readings, _, _, optimum = linear
    residual = rows[:, :PARAMETERS] @ optimum - readings
    return rows.T @ rows, rows.T @ residual


def judged(cost: float, information: np.ndarray, score: np.ndarray, prior: np.ndarray, sd: np.ndarray) -> Evidence:
    equations = NormalEquations.of(information, score, prior=prior, sd=sd)
    return evidence(cost, equations, len(prior))


def candidates_of(information: np.ndarray, score: np.ndarray, prior: np.ndarray, sd: np.ndarray) -> Eliminated:
    """Equations of the candidates, which come last, with a prior of standard deviation 1."""
    known = len(prior) + sd.size
    every = np.concatenate([sd, np.ones(score.size - known)])
    return NormalEquations.of(information, score, prior=prior, sd=every).eliminate(slice(known))


def test_cost_and_covariance_are_those_of_the_joint_problem(linear):
    rows, _, prior, _, _ = linear
    information, score = data_of(linear)
    known = PARAMETERS + FURTHER
    cost = least_cost(linear, [], np.empty(0))
    left = judged(cost, information[:known, :known], with_pull(linear, score)[:known], prior.T @ prior, SD)
    assert left.cost == pytest.approx(least_cost(linear, [4, 5, 6], SD), rel=1e-13)
    # Negative control: with masses known exactly more is left.
    assert left.cost < 0.9 * cost
    whole = rows[:, :known].T @ rows[:, :known]
    whole[:PARAMETERS, :PARAMETERS] += prior.T @ prior
    whole[PARAMETERS:, PARAMETERS:] += np.diag(SD**-2.0)
    np.testing.assert_allclose(left.covariance, np.linalg.inv(whole)[:PARAMETERS, :PARAMETERS], rtol=1e-12)


@pytest.mark.parametrize("away", [0.03, 3.0])
def test_a_search_that_ended_early_leaves_the_same(linear, away: float):
    """Cost and step from anywhere lead to the joint optimum; here one mass acts almost as a parameter does."""
    rows, readings, prior, target, optimum = linear
    rows[:, 5] = rows[:, 0] + 1e-3 * rows[:, 5]
    here = optimum + away * np.array([0.3, -1.0, 0.2, 2.0])
    residual, of_prior = rows[:, :PARAMETERS] @ here - readings, prior @ (here - target)
    known = rows[:, : PARAMETERS + FURTHER]
    score = known.T @ residual
    score[:PARAMETERS] += prior.T @ of_prior
    cost = 0.5 * float(residual @ residual + of_prior @ of_prior)
    found = judged(cost, known.T @ known, score, prior.T @ prior, SD)
    joint, solution = least_squares(linear, [4, 5, 6], SD)
    assert found.cost == pytest.approx(joint, rel=3e-14)
    np.testing.assert_allclose(here + found.step, solution[:PARAMETERS], rtol=3e-11)
    # Negative control: as if the search had reached the optimum, masses get what it left over.
    score[:PARAMETERS] = 0.0
    assert abs(judged(cost, known.T @ known, score, prior.T @ prior, SD).cost / joint - 1.0) > 0.02


@pytest.mark.parametrize(("score", "left"), [((0.0, 283.0), 100.0), ((6.0, 0.0), 100.0 - 0.5 * 6.0**2 / 2.0)])
def test_the_slope_beside_a_stop_that_a_run_just_reaches_is_no_way_down(score, left, monkeypatch):
    """The cost rises on the other side of such a travel; what is left of the gradient by a stiffness leads down."""
    data = SimpleNamespace(matrix=np.diag([2.0, 1e4, 0.0]), score=np.array([*score, 0.0]))
    monkeypatch.setattr(law_evidence, "information_with", lambda *rest: data)
    monkeypatch.setattr(LawEvidence, "sd", property(lambda self: np.ones(1)))
    monkeypatch.setattr(LawEvidence, "_columns", lambda self, optimum: ())
    quantities = [SimpleNamespace(quantity=q) for q in ("stiffness", "jounce_travel")]
    parameters = SimpleNamespace(parameters=quantities, prior_pull=lambda x: (0.0 * x, np.zeros((2, 2))))
    problem = SimpleNamespace(model=SimpleNamespace(parameters=parameters, felt=None), count=2)
    optimum = SimpleNamespace(problem=problem, vector=np.zeros(2), minimum=SimpleNamespace(cost=100.0))
    assert LawEvidence(None, optimum).judge(optimum).evidence.cost == pytest.approx(left, rel=1e-14)


def test_the_promised_gain_is_the_fall_of_the_joint_cost(linear):
    """Wherever the parameters are: a linear problem promises the same from everywhere."""
    rows, readings, prior, target, optimum = linear
    away = optimum + np.array([0.3, -1.0, 0.2, 2.0])
    information = rows.T @ rows
    score = rows.T @ (rows[:, :PARAMETERS] @ away - readings)
    score[:PARAMETERS] += prior.T @ (prior @ away - prior @ target)
    promised = candidates_of(information, score, prior.T @ prior, SD).left.gain
    without = least_cost(linear, [4, 5, 6], SD)
    joint = least_cost(linear, [4, 5, 6, 7, 8], np.concatenate([SD, np.ones(CANDIDATES)]))
    assert promised == pytest.approx(without - joint, rel=1e-13)


def test_what_a_mass_explains_is_promised_to_no_element():
    """A candidate whose column is that of a mass gains nothing beside it, and all beside a mass known exactly."""
    random = np.random.default_rng(3)
    column = random.standard_normal((50, 1))
    rows = np.concatenate([random.standard_normal((50, 2)), column, column], axis=1)
    residual = 3.0 * column[:, 0]
    residual -= rows[:, :2] @ np.linalg.lstsq(rows[:, :2], residual, rcond=None)[0]
    information, score = rows.T @ rows, rows.T @ residual
    gains = []
    for sd in (100.0, 1e-6):
        gains.append(candidates_of(information, score, np.zeros((2, 2)), np.array([sd])).left.gain)
    assert gains[0] < 1e-3 * gains[1]


def test_parameters_follow_masses_and_candidates_as_in_the_joint_problem(linear):
    """The step to free masses, and the change by candidates, against joint least squares."""
    _, _, prior, _, optimum = linear
    information, score = data_of(linear)
    known, masses, candidates = PARAMETERS + FURTHER, [4, 5, 6], [7, 8]
    found = judged(0.0, information[:known, :known], with_pull(linear, score)[:known], prior.T @ prior, SD)
    with_masses = least_squares(linear, masses, SD)[1][:PARAMETERS]
    np.testing.assert_allclose(optimum + found.step, with_masses, rtol=1e-9)
    assert np.abs(found.step).max() > 0.01
    left, response = candidates_of(information, with_pull(linear, score), prior.T @ prior, SD)
    amounts = left.step()
    everything = least_squares(linear, masses + candidates, np.concatenate([SD, np.ones(CANDIDATES)]))[1]
    np.testing.assert_allclose(amounts, everything[known:], rtol=1e-9)
    np.testing.assert_allclose(with_masses + response[:PARAMETERS] @ amounts, everything[:PARAMETERS], rtol=1e-9)


def with_pull(linear, score: np.ndarray) -> np.ndarray:
    """The gradient with that of the priors."""
    _, _, prior, target, optimum = linear
    whole = score.copy()
    whole[:PARAMETERS] += prior.T @ (prior @ optimum - prior @ target)
    return whole
