"""Bump stops that nobody declared and the runs reach: found by the comparison of laws, but not where there are none."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from rigid_truck import AXLES, SENSORS, STIFFNESS, VEHICLE, bump, campaign, empty_run, true_log_parameters, with_values

from sysid.campaign.records import Campaign
from sysid.campaign.vehicle_records import MassTolerances
from sysid.estimation.fit import law_comparison, law_screen, stop_search, travel_scan
from sysid.estimation.fit.joint_optimum import joint_optimum
from sysid.estimation.fit.law_choice import fit_with_laws
from sysid.estimation.fit.law_screen import promising, reached_travels
from sysid.estimation.fit.least_squares import optimise
from sysid.estimation.fit.options import FitOptions, Phase
from sysid.estimation.fit.reweighted_search import optimise_from
from sysid.estimation.fit.search_plan import before_joint, first_sight
from sysid.estimation.fit.travel_scan import with_touched_stops
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.parameters.law_families import STOPS, Laws
from sysid.estimation.parameters.map_tires import map_tires
from sysid.estimation.parameters.parameter_set import Parameter, ParameterSet
from sysid.estimation.parameters.suspension_elements import TRAVELS
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs
from sysid.estimation.uncertainty import allowance_columns, departure_scale
from sysid.estimation.uncertainty.allowances import campaign_allowances
from sysid.estimation.uncertainty.departure_scale import departure_columns
from sysid.estimation.uncertainty.information import optimum_information
from sysid.estimation.uncertainty.normal_equations import NormalEquations
from sysid.progress import unwatched
from sysid.road.road_profile import RoadProfile

PROFILES = {"bump": bump(0.1, 0.9)}
NOISE = {"suspension_deflection": 2e-4, "axle_acceleration": 0.15, "body_acceleration": 0.05}
OPTIONS = FitOptions(weight_rounds=1, second_solver=False, tolerance=1e-5, target_step_s=0.0025)
#: Travels [m] of the axles that declare them here, and that the runs reach.
JOUNCE_M, REBOUND_M = (0.062, 0.088, 0.07), (0.068, 0.061, 0.072)
STOP_N_PER_M = 2.4e6


def recorded(stops: bool, jounce_m=JOUNCE_M, rebound_m=REBOUND_M, profiles=PROFILES) -> Campaign:
    """Two runs of a truck with or without stops; the campaign that is fitted says nothing about them."""
    runs = [empty_run(f, v, samples=400) for f, v in (("slow.csv", 6.0), ("fast.csv", 9.0))]
    axles = tuple(
        replace(a, jounce_travel_m=j, rebound_travel_m=r) for a, j, r in zip(AXLES, jounce_m, rebound_m, strict=True)
    )
    true = campaign(runs, vehicle=replace(VEHICLE, axles=axles) if stops else VEHICLE)
    parameters = campaign_parameters(true, None)
    plain = campaign_parameters(campaign(runs), None)
    values = dict(zip(plain.names, true_log_parameters(plain.names), strict=True))
    x = np.array([values.get(n, np.log(STOP_N_PER_M)) for n in parameters.names])
    model = bump_model(true, parameters, profiles, tires=map_tires(plain, np.array(list(values.values()))))
    (signals,) = simulate_runs(model, x, RunMotion.steady(np.array([6.05, 8.92]), np.array([0.41, 0.38])))
    random = np.random.default_rng(8)
    sd = np.array([NOISE[s.kind] for s in SENSORS])
    order = list(model.groups[0].runs)
    filled = [
        with_values(run, signals[:, order.index(r)] + sd * random.normal(size=(400, len(SENSORS))))
        for r, run in enumerate(runs)
    ]
    return replace(campaign(runs), bump_runs=tuple(filled))


@pytest.fixture(scope="module")
def found():
    return fit_with_laws(recorded(True), None, PROFILES, OPTIONS)[0]


def test_stops_are_found_with_their_travels(found):
    assert found.laws == ("estimated_bump_stops",) * 3
    by_name = {p.name: p for p in found.parameters}
    for i in range(3):
        assert by_name[f"k_{i + 1}"].value == pytest.approx(STIFFNESS[i], rel=0.01)
        for travel, truth in ((f"jounce_{i + 1}", JOUNCE_M[i]), (f"rebound_{i + 1}", REBOUND_M[i])):
            assert by_name[travel].value == pytest.approx(truth, abs=0.003), travel
            assert by_name[travel].unit == "m"


def nearer() -> tuple[Campaign, dict[str, RoadProfile], tuple[tuple[float, ...], ...]]:
    """A truck with stops at 31 to 44 mm, over a bump that takes it nowhere near to where stops usually are."""
    low = {"bump": bump(0.06, 0.9)}
    travels = tuple(tuple(0.5 * travel for travel in of) for of in (JOUNCE_M, REBOUND_M))
    return recorded(True, *travels, profiles=low), low, travels


def test_stops_much_nearer_than_usual_are_promised(monkeypatch):
    """Those of the drive axles at once; the steer axle's are judged again when these are fitted."""
    data, low, _ = nearer()
    laws = (frozenset(),) * 3
    optimum = optimise(data, campaign_parameters(data, None), low, OPTIONS, unwatched, plan=first_sight)
    reached = reached_travels(optimum)
    assert set(reached) == {(quantity, axle) for quantity in TRAVELS for axle in range(3)}
    assert max(reached.values()) < 0.078
    rich = (frozenset({STOPS}),) * 3
    assert promising(data, laws, rich, optimum)[1:] == rich[1:]
    # Negative control: tried where stops usually are, they show nothing.
    monkeypatch.setattr(law_screen, "reached_travels", lambda optimum: {})
    assert not any(promising(data, laws, rich, optimum))


@pytest.mark.long
def test_stops_much_nearer_than_usual_are_found():
    data, low, (jounce_m, rebound_m) = nearer()
    fit = fit_with_laws(data, None, low, OPTIONS)[0]
    assert all(STOPS in law for law in fit.laws)
    by_name = {p.name: p.value for p in fit.parameters}
    # Steer axle: 0.1 mm off were seen.
    assert by_name["jounce_1"] == pytest.approx(jounce_m[0], abs=3e-4)
    assert by_name["rebound_1"] == pytest.approx(rebound_m[0], abs=3e-4)


def stand_in(stop_N_per_m: list[float], sd: list[float], monkeypatch) -> Laws:
    """Laws that are kept of two axles with springs of 4e5 N/m and stops of given stiffness, known to `sd`."""
    kinds = [("stiffness", 0), ("stiffness", 1), ("stop_stiffness", 0), ("stop_stiffness", 1)]
    parameters = ParameterSet(tuple(Parameter(f"{q}_{i}", q, "N/m", 1.0, 1.0, 0.7, axle=i) for q, i in kinds), ())
    model = SimpleNamespace(parameters=parameters)
    optimum = SimpleNamespace(problem=SimpleNamespace(model=model), vector=np.log([4e5, 4e5, *stop_N_per_m]))
    monkeypatch.setattr(stop_search, "parameter_sd", lambda optimum: np.array([0.01, 0.01, *sd]))
    return stop_search.with_stops_that_act((frozenset({"friction", STOPS}), frozenset({STOPS})), optimum)


def test_stops_that_the_data_do_not_know_or_that_are_none_are_taken_away(monkeypatch):
    assert stand_in([2e6, 2e6], [0.1, 0.6], monkeypatch) == (frozenset({"friction", STOPS}), frozenset({STOPS}))
    assert stand_in([2e6, 2e6], [0.1, 0.69], monkeypatch) == (frozenset({"friction", STOPS}), frozenset())
    assert stand_in([4e4, 2e6], [0.1, 0.1], monkeypatch) == (frozenset({"friction"}), frozenset({STOPS}))


def test_stops_are_fitted_before_what_imitates_them(monkeypatch):
    gas, stop = frozenset({"gas_spring"}), frozenset({STOPS})
    promises = [(gas | stop,), (gas,), ()]
    monkeypatch.setattr(law_comparison, "promising", lambda *unused: promises.pop(0))
    for name in ("with_nearer_stops", "with_released_stops"):
        monkeypatch.setattr(law_comparison, name, lambda laws, optimum, fitted: optimum)
    asked: list[Laws] = []
    law_comparison._enriched(
        None, (frozenset(),), (gas | stop,), None, lambda laws, near, plan=before_joint: asked.append(laws), False
    )
    assert asked == [(stop,), (gas | stop,), (gas | stop,)]


@dataclass(frozen=True)
class FakeOptimum:
    problem: SimpleNamespace
    vector: np.ndarray
    cost: float

    @property
    def minimum(self) -> SimpleNamespace:
        return SimpleNamespace(cost=self.cost)


def released(travel_m: float, reached_m: float, cost_without: float, monkeypatch):
    """Travel [m] after the search; usually it is 78 mm, and the cost of the optimum is 50."""
    kinds = (("stiffness", "N/m", 4e5, 0.7), ("rebound_travel", "m", 0.078, 0.12))
    parameters = ParameterSet(tuple(Parameter(q, q, unit, m, m, sd, axle=0) for q, unit, m, sd in kinds), ())

    def at(vector, cost):
        return FakeOptimum(SimpleNamespace(model=SimpleNamespace(parameters=parameters)), vector, cost)

    monkeypatch.setattr(stop_search, "reached_travels", lambda optimum: {("rebound_travel", 0): reached_m})

    def fitted(laws, near, plan):
        return at(near.vector, cost_without)

    best = stop_search.with_released_stops((frozenset({STOPS}),), at(np.log([4e5, travel_m]), 50.0), fitted)
    assert best.vector[0] == np.log(4e5)
    return float(np.exp(best.vector[1]))


def test_stops_that_the_runs_only_touch_are_tried_out_of_reach(monkeypatch):
    assert released(0.0467, 0.0470, 42.0, monkeypatch) == pytest.approx(0.078)
    # Their usual place is within reach: just beyond it.
    assert released(0.0770, 0.0780, 42.0, monkeypatch) == pytest.approx(0.0858)
    # The search without them ends worse.
    assert released(0.0467, 0.0470, 51.0, monkeypatch) == pytest.approx(0.0467)
    # Compressed by a tenth of their travel, far beyond reach, or farther away than usual: they stay.
    for travel, reached in ((0.0467, 0.0520), (0.0467, 0.0400), (0.0800, 0.0790)):
        assert released(travel, reached, 42.0, monkeypatch) == pytest.approx(travel)


def test_every_suspension_has_to_show_its_own_stops():
    """Axles 2 and 3 are one suspension."""
    vehicle = SimpleNamespace(suspension_axle=(0, 1, 1))
    stop, both = frozenset({STOPS}), frozenset({"friction", STOPS})
    none = (frozenset(),) * 3
    assert stop_search.axles_with(STOPS, vehicle, (stop, both, both), none) == [0, 1]
    assert stop_search.axles_with(STOPS, vehicle, (frozenset(), both, both), none) == [1]
    # Those of the campaign file stay.
    assert stop_search.axles_with(STOPS, vehicle, (stop, both, both), (stop, *none[1:])) == [1]
    rubbing = frozenset({"friction"})
    assert stop_search.without_on_axle(STOPS, vehicle, (stop, both, both), 1) == (stop, rubbing, rubbing)


def test_stops_of_one_axle_that_gain_little_are_taken_away(monkeypatch):
    """Without those of axle 2 the cost is 3 higher: 6 - 3 ln n is no gain.  Without those of axle 1 it is 60 higher."""
    stop, none = frozenset({STOPS}), frozenset()
    costs = {(stop, stop): 50.0, (none, stop): 110.0, (stop, none): 53.0, (none, none): 400.0}

    def fitted(laws, near, plan=before_joint):
        problem = SimpleNamespace(count=4 + 3 * sum(map(len, laws)))
        return SimpleNamespace(laws=laws, problem=problem, minimum=SimpleNamespace(cost=costs[laws]), misfit=2.0)

    def judge(optimum):
        return SimpleNamespace(optimum=optimum, count=optimum.problem.count, evidence=optimum.minimum)

    rich = fitted((stop, stop), None)
    monkeypatch.setattr(law_comparison, "_enriched", lambda *rest: ((stop, stop), rich))
    monkeypatch.setattr(law_comparison, "LawEvidence", lambda *rest: SimpleNamespace(judge=judge))
    monkeypatch.setattr(law_comparison, "effective_residuals", lambda optimum: 1000.0)
    monkeypatch.setattr(law_comparison, "_sure", lambda *rest: False)
    monkeypatch.setattr(law_comparison, "_trial", lambda laws, optimum, gain: (laws, gain))
    monkeypatch.setattr(law_comparison, "with_stops_that_act", lambda laws, optimum: laws)
    for name in ("by_trial", "by_score"):
        monkeypatch.setattr(law_comparison, name, lambda *rest: ())
    axles = (SimpleNamespace(suspension="leaf"),) * 2
    data = SimpleNamespace(vehicle=SimpleNamespace(axles=axles, suspension_axle=(0, 1)))
    best, comparison = law_comparison.compare_laws(data, (none, none), (stop, stop), fitted((none, none), None), fitted)
    assert best.laws == (stop, none)
    tried = dict(comparison.trials[1:])
    assert tried[stop, none] - tried[stop, stop] == pytest.approx(3.0 * np.log(1000.0) - 6.0)


def test_laws_without_stops_were_worse(found):
    linear = found.law_comparison.trials[0]
    assert set(linear.laws) == {"linear"}
    assert linear.misfit > 2.0


def test_none_are_found_on_a_truck_without_stops():
    """It goes through the travels that trucks usually have."""
    fit, _ = fit_with_laws(recorded(False), None, PROFILES, replace(OPTIONS, laws="compare"))
    assert set(fit.laws) == {"linear"}
    assert max(abs(p.value / k - 1.0) for p, k in zip(fit.parameters[:3], STIFFNESS, strict=True)) < 0.01


def found_by_search(data: Campaign, near, phase: Phase):
    """The optimum from the vector of another one, under its weights or, on request, with its own."""
    problem, (values, motion) = near.problem, near.problem.unpack(near.vector)
    noise, weights = near.instrument, problem.weights
    return optimise_from(data, problem.model, motion, noise, values, phase, unwatched, weights=weights)


@pytest.fixture(scope="module", params=[0.071, 0.0724])
def touched(request):
    """Data with a stop of axle 2 that the runs just reach, and optima by searches from within and beyond.

    By the optima from beyond, they reach 72.7 and 73.1 mm.
    """
    data = recorded(True, (0.2, JOUNCE_M[1], 0.2), (0.2, request.param, 0.2))
    parameters = campaign_parameters(data, None, (frozenset(), frozenset({STOPS}), frozenset()))
    optimum = optimise(data, parameters, PROFILES, OPTIONS, unwatched)
    place = parameters.index("rebound_travel", 1)
    beyond = optimum.vector.copy()
    beyond[place] = np.log(0.09)
    stuck = found_by_search(data, replace(optimum, vector=beyond), OPTIONS.phase())
    return SimpleNamespace(data=data, travel_m=request.param, optimum=optimum, stuck=stuck, place=place)


def test_a_stop_that_the_runs_just_reach_is_found_by_a_scan(touched):
    # The search from beyond goes where the prior has its median: no derivative says anything else.
    assert np.exp(touched.stuck.vector[touched.place]) == pytest.approx(0.085, rel=1e-6)
    stuck = replace(touched.stuck, amounts=np.array([0.25]))
    found = with_touched_stops(touched.data, stuck, OPTIONS.phase(), unwatched)
    assert np.exp(found.vector[touched.place]) == pytest.approx(touched.travel_m, abs=2e-4)
    assert found.minimum.cost < stuck.minimum.cost - 20.0
    # All else is as it was: weights, model, masses and departures.
    assert found.problem.weights is stuck.problem.weights
    assert found.problem.model is stuck.problem.model
    assert found.amounts is stuck.amounts
    assert found.minimum.iterations > stuck.minimum.iterations


@pytest.mark.parametrize("touched", [0.071], indirect=True)
def test_a_scan_looks_closely_where_the_runs_begin_to_reach(touched, monkeypatch):
    """Its first values are 85, 75, 67 mm and less: none of them is better."""
    monkeypatch.setattr(travel_scan, "_VALUES", 6)
    found = with_touched_stops(touched.data, touched.stuck, OPTIONS.phase(), unwatched)
    assert np.exp(found.vector[touched.place]) == pytest.approx(touched.travel_m, abs=2e-4)


@pytest.mark.parametrize("touched", [0.071], indirect=True)
def test_the_joint_optimum_finds_a_stop_that_the_search_before_it_missed(touched):
    found = joint_optimum(touched.data, touched.stuck, PROFILES, OPTIONS, unwatched)
    assert np.exp(found.vector[touched.place]) == pytest.approx(0.071, abs=2e-4)
    assert found.misfit < 0.95 * touched.stuck.misfit


def test_a_scan_that_finds_nothing_leaves_the_optimum(touched, monkeypatch):
    # A search that ends higher is not taken.
    higher = replace(touched.stuck, minimum=replace(touched.stuck.minimum, cost=1.0 + touched.stuck.minimum.cost))
    monkeypatch.setattr(travel_scan, "_searched", lambda *rest: higher)
    assert with_touched_stops(touched.data, touched.stuck, OPTIONS.phase(), unwatched) is touched.stuck

    def never(*rest):
        raise AssertionError

    monkeypatch.setattr(travel_scan, "_searched", never)
    # All travels are determined.
    assert with_touched_stops(touched.data, touched.optimum, OPTIONS.phase(), unwatched) is touched.optimum
    # All values of the scan are beyond reach, 77 mm at least.
    monkeypatch.setattr(travel_scan, "_FURTHEST", 0.09)
    assert with_touched_stops(touched.data, touched.stuck, OPTIONS.phase(), unwatched) is touched.stuck


def test_stops_that_explain_the_same_are_not_both_moved(monkeypatch):
    """Two travels that each lower the cost by 30 and 20, and together by 12, or by 45."""
    kinds = (("jounce_travel", 0), ("rebound_travel", 1))
    parameters = ParameterSet(tuple(Parameter(f"{q}_{i}", q, "m", 0.08, 0.08, 0.12, axle=i) for q, i in kinds), ())
    optimum = FakeOptimum(SimpleNamespace(model=SimpleNamespace(parameters=parameters)), np.log([0.08, 0.09]), 500.0)
    monkeypatch.setattr(travel_scan, "parameter_sd", lambda optimum: np.array([0.12, 0.12]))
    for together, moved in ((45.0, [0.07, 0.08]), (12.0, [0.07, 0.09]), (np.nan, [0.07, 0.09])):
        lowest = {0: (np.log(0.07), 30.0), 1: (np.log(0.08), 20.0)}
        costs = SimpleNamespace(lowest=lowest.get, fall=lambda vector, gain=together: gain)
        monkeypatch.setattr(travel_scan, "_Costs", lambda optimum, costs=costs: costs)
        assert np.exp(travel_scan._nearer_stops(optimum)) == pytest.approx(moved)


def just_untouched(optimum, place: int) -> np.ndarray:
    """The vector of an optimum with a travel that the runs miss by less than two millionths of it."""
    model = optimum.problem.model
    base = simulate_runs(model, *optimum.problem.unpack(optimum.vector))
    near, far = optimum.vector[place] - 0.3, optimum.vector[place]
    while far - near > 2e-6:
        vector = optimum.vector.copy()
        vector[place] = middle = 0.5 * (near + far)
        shown = simulate_runs(model, *optimum.problem.unpack(vector))
        same = all(np.array_equal(a, b) for a, b in zip(shown, base, strict=True))
        near, far = (near, middle) if same else (middle, far)
    vector = optimum.vector.copy()
    vector[place] = far
    return vector


def with_tolerances(optimum):
    """A campaign with tolerances of its masses, and the allowances of an optimum for it."""
    runs = [empty_run(f, v, samples=400) for f, v in (("slow.csv", 6.0), ("fast.csv", 9.0))]
    data, model = campaign(runs, vehicle=replace(VEHICLE, tolerances=MassTolerances())), optimum.problem.model
    return data, campaign_allowances(data, model.parameters, model.felt)


def known_scale(optimum, vector) -> float:
    """Standard deviation of the scale's common error, with all parameters and masses free, over its tolerance."""
    problem, (data, allowances) = optimum.problem, with_tolerances(optimum)
    masses, count = allowances.masses, problem.count
    information = optimum_information(data, problem, vector, allowances, np.zeros(allowances.count)).matrix
    size = count + masses.sd.size
    rows, _ = problem.model.parameters.prior_rows()
    joint = NormalEquations.of(information[:size, :size], prior=rows.T @ rows, sd=masses.sd)
    sd = np.sqrt(joint.variances)
    return float(sd[count:][masses.scales][0] / masses.sd[masses.scales][0])


def by_departures(optimum, vector) -> np.ndarray:
    """Derivatives of all residuals by departures from the model."""
    problem, (_, allowances) = optimum.problem, with_tolerances(optimum)
    here = problem.unpack(vector)
    columns = departure_columns(problem.model, allowances, problem.weights, *here, np.zeros(allowances.count))
    return np.concatenate([of.residual.ravel() for of in columns])


@pytest.mark.parametrize("touched", [0.071], indirect=True)
def test_a_run_that_just_misses_a_stop_does_not_tell_the_error_of_the_scale(touched, monkeypatch):
    """A truck with all masses, loads, springs, dampers and stops larger by the same share moves in the same way."""
    # Under the weights of the noise; those of residuals without the stop hide most of it.
    stuck = replace(touched.stuck, problem=touched.stuck.problem.with_weights(touched.optimum.problem.weights))
    corner = just_untouched(stuck, touched.place)
    # Tolerances of other masses say a little: they weigh the axle beams.
    far, departures = known_scale(stuck, stuck.vector), by_departures(stuck, stuck.vector)
    assert 0.95 < far < 1.0
    assert known_scale(stuck, corner) == pytest.approx(far, abs=1e-5)
    np.testing.assert_allclose(by_departures(stuck, corner), departures, atol=1e-6 * np.abs(departures).max())
    # Negative controls: steps that cross the corner, with derivatives from both sides.
    for step, at_most in ((1e-4, far - 0.001), (1e-3, 0.7)):
        monkeypatch.setattr(allowance_columns, "STEP", step)
        assert known_scale(stuck, corner) < at_most
    monkeypatch.setattr(departure_scale, "STEP", 0.01)
    crossed = by_departures(stuck, corner) - by_departures(stuck, stuck.vector)
    assert np.abs(crossed).max() > 3e-4 * np.abs(departures).max()
