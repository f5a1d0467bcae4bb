"""Laws about which the data do not decide: weights and mixtures against closed forms."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sysid.estimation.fit.fit_result import UndecidedLaw
from sysid.estimation.fit.law_comparison import _still_so
from sysid.estimation.fit.law_evidence import Evidence, Judged
from sysid.estimation.fit.law_screen import LawCandidate, Screen, travel_penalty, tried_travel
from sysid.estimation.fit.thresholds import DECISIVE
from sysid.estimation.fit.undecided_laws import _further_parameters, _possible, by_trial, spread_rows, weight_of
from sysid.estimation.parameters.suspension_elements import quantities
from sysid.estimation.uncertainty.data_information import MASSES, SCALES, TIRES, DataInformation
from sysid.estimation.uncertainty.interval_shares import LAWS, MODEL_FORM, SOURCES, interval_shares, share_sentences
from sysid.estimation.uncertainty.normal_equations import NormalEquations

NAMES = ("k_1", "c_1", "kt_1")


def judged(names: tuple[str, ...], values: list[float], step: list[float]) -> Judged:
    problem = SimpleNamespace(count=len(names), model=SimpleNamespace(parameters=SimpleNamespace(names=names)))
    optimum = SimpleNamespace(problem=problem, vector=np.array([*values, 77.0]))
    return Judged(optimum, Evidence(0.0, np.eye(len(names)), np.array(step)))


POOR = judged(NAMES, [1.0, 2.0, 3.0], [0.1, 0.0, 0.0])
RICH = judged(("k_1", "friction_1", "c_1", "kt_1"), [1.5, 6.0, 1.8, 3.0], [0.0, 0.0, 0.05, 0.0])


def test_at_the_deciding_gain_both_laws_are_equally_likely_and_ten_more_are_148_to_1():
    assert weight_of(DECISIVE) == 0.5
    odds = weight_of(DECISIVE + 10.0) / (1.0 - weight_of(DECISIVE + 10.0))
    assert odds == pytest.approx(np.exp(5.0))


@pytest.mark.parametrize(("gain", "chosen"), [(8.0, False), (12.0, True)])
def test_the_other_choice_moves_what_both_laws_have(gain, chosen):
    (law,) = by_trial("friction", POOR, RICH, gain)
    assert law.is_chosen is chosen
    assert law.doubt == pytest.approx(1.0 / (1.0 + np.e))
    towards_rich = {"k_1": 0.4, "c_1": -0.15, "kt_1": 0.0}
    sign = -1.0 if chosen else 1.0
    assert dict(zip(law.names, law.shift, strict=True)) == pytest.approx({k: sign * v for k, v in towards_rich.items()})


@pytest.mark.parametrize("gain", [-3.0, 3.0, 17.0, 400.0])
def test_clear_cases_are_decided(gain):
    assert by_trial("friction", POOR, RICH, gain) == ()


def test_the_covariance_grows_by_the_second_moment_of_the_mixture():
    """Against a million draws of the mixture of two normal distributions."""
    law = UndecidedLaw("friction", 9.0, 0.3, False, ("c_1", "k_1"), (0.2, -0.5))
    rows = spread_rows([law], NAMES)
    random = np.random.default_rng(2)
    root = np.tril(random.normal(size=(3, 3))) * 0.1 + 0.2 * np.eye(3)
    other = random.random(1_000_000) < law.doubt
    draws = random.standard_normal((1_000_000, 3)) @ root.T + other[:, None] * np.array([-0.5, 0.2, 0.0])
    second = draws.T @ draws / len(draws)
    covariance = root @ root.T
    data = DataInformation(np.linalg.inv(covariance), np.eye(3), np.zeros((3, 3)), np.zeros(0), 0, laws=rows)
    np.testing.assert_allclose(data.covariance(), second, atol=4e-4)
    np.testing.assert_allclose(data.with_laws(None).covariance(), covariance, rtol=1e-10)
    # The maximum of the likelihood stays where it is: precision^-1 gradient.
    gradient = np.array([1.0, -2.0, 0.5])
    np.testing.assert_allclose(
        np.linalg.solve(data.precision(), data.slope(gradient)), covariance @ gradient, rtol=1e-9
    )


def test_friction_that_would_push_is_left_out():
    (friction,) = (q for q in quantities(frozenset({"friction"})) if q.decides)
    members = [LawCandidate("friction", friction, (i,)) for i in range(3)]
    screen = Screen.__new__(Screen)
    screen._listed, screen._against = members, np.array([0.0, 0.0, 0.5])
    # With their priors of 1.
    screen._equations = NormalEquations(np.diag([2.0, 2.0, 4.0]), np.array([-4.0, 3.0, -1.0]), np.ones(3))
    screen._response = np.ones((2, 3))
    assert _possible(screen, members) == [members[0], members[2]]
    np.testing.assert_allclose(screen.amounts([members[0], members[2]]), [2.0, 0.25])
    # By hand: 4^2 / 2 + 1^2 / 4 - 2 ln n, and what is against the last.
    assert screen.gain([members[0], members[2]], np.e) == pytest.approx(8.25 - 2.0 - 0.5)
    np.testing.assert_allclose(screen.shift([members[0], members[2]]), [2.25, 2.25])


def information() -> DataInformation:
    random = np.random.default_rng(4)
    jacobian = random.normal(size=(80, 6)) * [3.0, 1.0, 20.0, 9.0, 5.0, 7.0]
    laws = np.array([[0.02, 0.03]])
    kinds = (MASSES, SCALES, TIRES, TIRES)
    sd = np.array([0.03, 0.05, 0.04, 0.02])
    flat = np.diag([0.8, 0.7])
    return DataInformation(jacobian.T @ jacobian / 1.5, flat, np.diag([0.5, 0.0]), sd, 2, 1.5, laws, kinds)


def test_shares_are_what_each_source_adds_to_the_variance():
    """Noise alone and masses known by dense inverses; the others by leaving the last source out."""
    data = information()
    shares = interval_shares(data)
    np.testing.assert_allclose(shares.sum(axis=1), 1.0)
    variance = np.diag(data.covariance())
    known = data.matrix[:2, :2] * data.factor + data.prior
    by = {source: shares[:, k] * variance for k, source in enumerate(SOURCES)}
    np.testing.assert_allclose(by["noise"], np.diag(np.linalg.inv(known)), rtol=1e-10)
    joint = data.matrix[:3, :3] * data.factor
    joint[:2, :2] += data.prior
    joint[2, 2] += data.sd[0] ** -2.0
    np.testing.assert_allclose(by["noise"] + by[MASSES], np.diag(np.linalg.inv(joint))[:2], rtol=1e-10)
    np.testing.assert_allclose(variance - by[LAWS], np.diag(data.with_laws(None).covariance()), rtol=1e-10)
    assert (shares > 0.0).all()
    # Without model error and laws these sources have nothing.
    plain = replace(data, flattening=np.eye(2), factor=1.0, matrix=data.matrix * 1.5, laws=np.zeros((0, 2)))
    np.testing.assert_allclose(interval_shares(plain)[:, [SOURCES.index(MODEL_FORM), SOURCES.index(LAWS)]], 0.0)


def test_the_largest_sources_are_named_with_what_lowers_them():
    shares = np.zeros((3, 6))
    shares[0, SOURCES.index(SCALES)], shares[0, 0] = 0.7, 0.3
    shares[1, 0] = 1.0
    first, second = share_sentences(("k_1", "c_1", "kt_1"), shares)
    assert first == (
        "The variance of k comes mostly from scale readings (70 %) and noise (30 %). What would lower it: weighing the "
        "axles more accurately."
    )
    assert second.startswith("The variance of c comes mostly from noise (100 %).")


def test_what_a_later_trial_has_changed_is_no_longer_open():
    stop, none = frozenset({"estimated_bump_stops"}), frozenset()
    assert _still_so((stop, stop), True, (stop, stop))
    assert not _still_so((stop, stop), True, (stop, none))
    assert _still_so((stop, none), False, (none, stop))
    assert not _still_so((stop, stop), False, (none, stop))


def test_a_stop_is_tried_inside_the_travel_of_the_runs_but_not_anywhere():
    assert tried_travel(0.07, None) == 0.07
    assert tried_travel(0.07, 0.2) == 0.07
    assert tried_travel(0.07, 0.06) == pytest.approx(0.051)
    assert tried_travel(0.07, 0.02) == pytest.approx(0.0385)
    (deciding,) = (q for q in quantities(frozenset({"estimated_bump_stops"})) if q.decides)
    vehicle = SimpleNamespace(axles=(SimpleNamespace(suspension="leaf"),))
    candidate = LawCandidate("estimated_bump_stops", deciding, (0,))
    reached = {("jounce_travel", 0): 0.06, ("rebound_travel", 0): 0.2}
    assert travel_penalty(vehicle, reached, candidate) == pytest.approx((np.log(0.051 / 0.07) / 0.12) ** 2)
    assert travel_penalty(vehicle, {}, candidate) == 0.0


def test_every_parameter_of_an_element_counts_once_where_it_is_shared():
    """Friction of three axles shares its slip; each damper has a knee of its own beside what decides."""
    (friction,) = (q for q in quantities(frozenset({"friction"})) if q.decides)
    assert _further_parameters([LawCandidate("friction", friction, (i,)) for i in range(3)]) == 1
    asymmetry, *_ = (q for q in quantities(frozenset({"asymmetric_damper"})) if q.decides and not q.shared)
    members = [LawCandidate("asymmetric_damper", asymmetry, (i,)) for i in range(2)]
    assert _further_parameters(members) == 3
