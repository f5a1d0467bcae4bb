"""Departures from the model: against the other contact law itself, and scales against closed forms."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rigid_truck import EMPTY, LADEN, VEHICLE, bump, campaign, empty_run

from sysid.campaign.records import Campaign
from sysid.campaign.vehicle_records import AxleGroup
from sysid.estimation.parameters.axle_laws import axle_laws
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.parameters.parameter_set import ParameterSet
from sysid.estimation.residuals.bump_model import BumpModel, bump_model
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs
from sysid.estimation.uncertainty.allowances import Allowances, campaign_allowances
from sysid.estimation.uncertainty.departure_scale import PLAUSIBLE, departure_columns, departure_scale, least_sd
from sysid.estimation.uncertainty.departures import (
    BUSHING,
    ENVELOPE,
    FRICTION,
    REACH,
    RIGID,
    SPOKES,
    TIRE_DAMPING,
    TIRE_LOAD,
    TRAILING,
    Departure,
    Departures,
)
from sysid.estimation.uncertainty.residual_columns import STEP
from sysid.estimation.uncertainty.uncertain_masses import uncertain_masses
from sysid.vehicle_model.contact import contact_damping
from sysid.vehicle_model.passes import EffectiveRoads, Pass

MOTION = RunMotion.steady(np.array([6.0, 7.0]), np.array([0.2, 0.2]))


@pytest.fixture(scope="module")
def model():
    runs = [empty_run("a.csv", 6.0, samples=150), empty_run("b.csv", 7.0, load_case="laden", samples=150)]
    data = campaign(runs, load_cases=(EMPTY, LADEN))
    parameters = campaign_parameters(data, None)
    return data, parameters, bump_model(data, parameters, {"bump": bump()})


def known_departures(data: Campaign, parameters: ParameterSet, model: BumpModel) -> Departures:
    return campaign_allowances(data, parameters, model.felt).departures


def amplitudes(known: Departures, kind: str, value: float) -> np.ndarray:
    return np.array([value * (d.kind == kind and d.axle is None) for d in known.directions])


def test_no_departure_is_the_model(model):
    data, parameters, ours = model
    known = known_departures(data, parameters, ours)
    moved = known.model(ours, np.zeros(len(known.directions)))
    for one, two in zip(
        simulate_runs(ours, parameters.start, MOTION), simulate_runs(moved, parameters.start, MOTION), strict=True
    ):
        np.testing.assert_allclose(one, two, rtol=1e-7, atol=1e-7 * np.abs(one).max())


def test_the_whole_way_to_the_other_contact_law_is_that_law(model):
    data, parameters, ours = model
    known = known_departures(data, parameters, ours)
    whole = known.model(ours, amplitudes(known, ENVELOPE, 1.0))
    cams = bump_model(data, parameters, {"bump": bump()}, contact="cams")
    motion, x = MOTION, parameters.start
    parts = zip(*(simulate_runs(m, x, motion) for m in (ours, whole, cams)), strict=True)
    for plain, one, two in parts:
        # What a wheel does clear of the road is left as it is, so agreement is not to rounding.
        assert np.sqrt(np.mean((one - two) ** 2)) < 0.02 * np.sqrt(np.mean((plain - two) ** 2))


def test_common_direction_moves_every_axle_in_its_own_load_cases_only(model):
    known = known_departures(*model)
    spread = known.spread(TIRE_LOAD, amplitudes(known, TIRE_LOAD, 0.05), ["empty", "laden"])
    np.testing.assert_allclose(spread, [[0.0] * 3, [0.05] * 3])
    assert [d.name for d in known.directions if d.kind == FRICTION] == [f"friction_{i}" for i in (1, 2, 3)] + [FRICTION]


def test_friction_of_a_group_is_a_share_of_what_its_suspension_carries():
    """Two axles on a beam: their loads together, less their unsprung masses and the beam's."""
    vehicle = replace(VEHICLE, groups=(AxleGroup("bogie", (1, 2), 300.0, 90.0),))
    case = replace(EMPTY, sprung_mass_kg=(EMPTY.sprung_mass_kg[0] - 300.0,))
    data = campaign([empty_run("a.csv", 6.0, samples=150)], load_cases=(case,), vehicle=vehicle)
    parameters = campaign_parameters(data, None)
    ours = bump_model(data, parameters, {"bump": bump()})
    known = known_departures(data, parameters, ours)
    found = known.laws(ours.arrays[0].laws, amplitudes(known, FRICTION, 0.01), ["empty"]).elements["friction"]
    own = EMPTY.axle_loads_kg[0] - 520.0, EMPTY.axle_loads_kg[1] + EMPTY.axle_loads_kg[2] - 980.0 - 760.0 - 300.0
    np.testing.assert_allclose(found.neutral[:2], 0.01 * 9.81 * np.array(own), rtol=1e-9)


def test_bushings_of_an_amplitude_are_those_of_the_law_and_none_is_a_rigid_damper(model):
    """0.2 mm/kN against 5 MN/m that every axle declares."""
    data, parameters, ours = model
    axles = tuple(replace(a, suspension_law="damper_bushing") for a in VEHICLE.axles)
    declared = replace(data, vehicle=replace(data.vehicle, axles=axles))
    of_law = campaign_parameters(declared, None)
    values = np.where([p.quantity == "bushing_stiffness" for p in of_law.parameters], np.log(5e6), of_law.start)
    theirs = bump_model(declared, of_law, {"bump": bump()})
    known = known_departures(data, parameters, ours)
    assert not any(d.kind == BUSHING for d in known_departures(declared, of_law, theirs).directions)
    moved = known.model(ours, amplitudes(known, BUSHING, 0.2))
    stiff = known.model(ours, amplitudes(known, BUSHING, 1e-7))
    start = parameters.start
    parts = (simulate_runs(m, x, MOTION) for m, x in ((ours, start), (moved, start), (theirs, values)))
    for plain, one, two in zip(*parts, strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-9, atol=1e-12)
        assert np.abs(one - plain).max() > 1e-2 * np.abs(plain).max()
    for one, two in zip(*(simulate_runs(m, start, MOTION) for m in (ours, stiff)), strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-4, atol=1e-6 * np.abs(one).max())


def test_the_whole_way_to_constant_damping_of_tires_is_that_law(model):
    """A tire at a quarter of its reference deflection: constant, half of it, and as its contact grows, by hand."""
    data, parameters, ours = model
    known = known_departures(data, parameters, ours)
    soft = 0.25 * np.sqrt(1.1 / 0.35)
    for amplitude, share in ((1.0, 1.0), (0.5, 0.5 + 0.5 * soft), (0.0, soft)):
        moved = known.model(ours, amplitudes(known, TIRE_DAMPING, amplitude))
        _, tire = axle_laws(moved.arrays[0].laws, parameters.start[:, None])
        np.testing.assert_allclose(tire.growth, 1.0 - amplitude)
        found = contact_damping(np.full(3, 2.5e3), np.full(3, 0.25), np.asarray(tire.growth)[0, :, 0])
        np.testing.assert_allclose(found, share * 2.5e3)
        signals = (simulate_runs(m, parameters.start, MOTION) for m in (ours, moved))
        changed = max(np.abs(one - two).max() / np.abs(one).max() for one, two in zip(*signals, strict=True))
        assert changed > 1e-3 if amplitude else changed < 1e-6
    assert {d.axle for d in known.directions if d.kind == TIRE_DAMPING} == {0, 1, 2, None}


def test_links_lead_wheels_by_their_amplitude_but_not_those_of_a_beam(model):
    data, parameters, ours = model
    known = known_departures(data, parameters, ours)
    straight, aft = (known.model(ours, amplitudes(known, TRAILING, b)) for b in (0.0, 0.07))
    assert straight.arrays[0].laws.trailing is None
    np.testing.assert_allclose(aft.arrays[0].laws.trailing, [0.07] * 3)
    suspension, _ = axle_laws(aft.arrays[0].laws, parameters.start[:, None])
    np.testing.assert_allclose(suspension.trailing, 0.07)
    for plain, moved in zip(*(simulate_runs(m, parameters.start, MOTION) for m in (straight, aft)), strict=True):
        assert np.abs(plain - moved).max() > 1e-3 * np.abs(plain).max()
    vehicle = replace(VEHICLE, groups=(AxleGroup("bogie", (1, 2), 300.0, 90.0),))
    case = replace(EMPTY, sprung_mass_kg=(EMPTY.sprung_mass_kg[0] - 300.0,))
    grouped = campaign([empty_run("a.csv", 6.0, samples=150)], load_cases=(case,), vehicle=vehicle)
    of_group = bump_model(grouped, campaign_parameters(grouped, None), {"bump": bump()})
    directions = known_departures(grouped, campaign_parameters(grouped, None), of_group).directions
    assert [d.axle for d in directions if d.kind == TRAILING] == [0, None]


def test_the_slope_by_bushings_of_rigid_dampers_is_that_of_stiff_ones(model):
    """Rigid at the optimum, yet seen by derivatives: a step of 1e-7 shows the slope of 1 um/kN."""
    data, parameters, ours = model
    known = known_departures(data, parameters, ours)
    small, start = 1e-3, parameters.start
    steps = (simulate_runs(known.model(ours, amplitudes(known, BUSHING, a)), start, MOTION) for a in (STEP, small))
    for plain, one, two in zip(simulate_runs(ours, start, MOTION), *steps, strict=True):
        slope, chord = (one - plain) / STEP, (two - plain) / small
        assert np.abs(slope - chord).max() < 0.05 * np.abs(chord).max()
    allowances = Allowances(uncertain_masses(data), known)
    amounts = np.concatenate([np.zeros(len(allowances.masses.factors)), amplitudes(known, BUSHING, 0.9 * RIGID)])
    assert not allowances.within_reach(amounts).any()
    assert allowances.within_reach(2.0 * amounts).any()


def test_scale_is_the_root_mean_square_of_what_exact_data_ask_for():
    """With data far sharper than the scale, tau^2 is the mean square of the amplitudes behind the data."""
    random = np.random.default_rng(4)
    jacobian = 1e4 * random.normal(size=(80, 9))
    behind = np.array([0.3, -0.1, 0.4, 0.2])
    residual = -jacobian[:, 5:] @ behind
    # The optimum of the four parameters for departures of zero; one mass as well.
    solved = np.linalg.lstsq(jacobian[:, :4], -residual, rcond=None)[0]
    score = jacobian.T @ (residual + jacobian[:, :4] @ solved)
    directions = [Departure(ENVELOPE, i) for i in range(4)]
    found = departure_scale(jacobian.T @ jacobian, score, 1e-9 * np.eye(4), np.array([0.03]), directions)
    np.testing.assert_allclose(found.estimate[1:], behind, rtol=1e-4)
    # The same from where masses and departures have been moved already.
    here = np.array([0.01, 0.2, 0.0, 0.3, 0.1])
    moved = jacobian[:, :4] @ np.linalg.lstsq(jacobian[:, :4], -(residual + jacobian[:, 4:] @ here), rcond=None)[0]
    there = jacobian.T @ (residual + jacobian[:, 4:] @ here + moved)
    again = departure_scale(jacobian.T @ jacobian, there, 1e-9 * np.eye(4), np.array([0.03]), directions, here)
    np.testing.assert_allclose(again.estimate, found.estimate, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.sd, np.sqrt(np.mean(behind**2)), rtol=1e-3)


def test_readings_of_a_scale_that_are_further_off_than_said_get_the_scale_that_they_have():
    """Exact data about five readings: the root mean square of their errors, the tolerance where that is more."""
    jacobian = 1e5 * np.random.default_rng(9).normal(size=(80, 8))
    readings = np.array([True] * 5 + [False])
    for behind, wanted in (([0.01, -0.012, 0.004, 0.009, -0.011], None), ([0.001] * 5, 0.005), ([0.1] * 5, 0.015)):
        residual = -jacobian[:, 2:7] @ np.array(behind)
        solved = np.linalg.lstsq(jacobian[:, :2], -residual, rcond=None)[0]
        score = jacobian.T @ (residual + jacobian[:, :2] @ solved)
        tolerance = np.array([0.005] * 5 + [0.03])
        found = departure_scale(jacobian.T @ jacobian, score, 1e-9 * np.eye(2), tolerance, [], None, readings).mass_sd
        assert found[5] == 0.03
        np.testing.assert_allclose(found[:5], wanted or np.sqrt(np.mean(np.square(behind))), rtol=1e-3)
        # What they share is taken to be off by as much more than said.
        given = (jacobian.T @ jacobian, score, 1e-9 * np.eye(2), tolerance, [], None, readings)
        shared = departure_scale(*given, scales=~readings).mass_sd
        np.testing.assert_allclose(shared, np.append(found[:5], 0.03 * found[0] / 0.005), rtol=1e-3)


def test_scales_of_readings_settle_also_where_those_of_departures_have():
    """Readings that tell their errors only together with a mass take many rounds; the departures take none."""
    readings = np.array([True] * 4)
    information = np.diag([1.0, *[1.0 / 0.008**2] * 4, 1e12, 1e12])
    error = np.array([0.012, -0.01, 0.013, -0.011])
    score = np.array([0.0, *(-error / 0.008**2), 0.0, 0.0])
    directions = [Departure(ENVELOPE, i) for i in range(2)]
    given = information, score, 1e-9 * np.eye(1), np.full(4, 0.005), directions, None, readings
    found = departure_scale(*given).mass_sd
    # The fixed point of the mean square: s^2 = mean of (shrunk error)^2 + remaining variance, at most three tolerances.
    sd = 0.005
    for _ in range(5000):
        left = 1.0 / (1.0 / 0.008**2 + sd**-2)
        sd = min(max(np.sqrt(np.mean((left * error / 0.008**2) ** 2) + left), 0.005), 0.015)
    np.testing.assert_allclose(found, sd, rtol=3e-3)


def test_data_without_departures_leave_scales_of_their_own_accuracy_and_no_data_the_plausible_one():
    jacobian = np.random.default_rng(5).normal(size=(200, 30)) * 1e3
    residual = np.random.default_rng(6).normal(size=200)
    solved = np.linalg.lstsq(jacobian[:, :4], -residual, rcond=None)[0]
    score = jacobian.T @ (residual + jacobian[:, :4] @ solved)
    directions = [Departure(ENVELOPE, i) for i in range(26)]
    found = departure_scale(jacobian.T @ jacobian, score, np.zeros((4, 4)), np.zeros(0), directions)
    assert found.sd[0] < 3.0 / (1e3 * np.sqrt(200))
    silent = departure_scale(np.eye(2) * 1e-12, np.zeros(2), np.eye(1), np.zeros(0), [Departure(FRICTION, 0)])
    assert silent.sd[0] == pytest.approx(PLAUSIBLE[FRICTION])


def test_links_are_let_in_only_where_the_data_show_them():
    """Amplitudes known to `sd`: their mean square, and the ratio of evidence in closed form, as for one scale."""
    directions = [Departure(TRAILING, i) for i in range(4)] + [Departure(ENVELOPE, 0)]
    shape, other = np.array([1.0, -1.2, 1.0, -0.8]), 0.3

    def found(behind, sd):
        information = np.diag([1.0, *[sd**-2] * 4, 1e4])
        score = np.array([0.0, *(-behind / sd**2), -1e4 * other])
        return departure_scale(information, score, 1e-9 * np.eye(1), np.zeros(0), directions)

    def more_evident(behind, sd):
        square = max(float(np.mean(np.square(behind))) / sd**2, 1.0)
        return 0.5 * behind.size * (square - 1.0 - np.log(square))

    cases = ((0.05, 0.01, True), (0.05, 0.03, False), (0.025, 0.001, False), (0.036, 0.001, True), (0.0, 0.01, False))
    for size, sd, shown in cases:
        behind = size * shape
        assert (more_evident(behind, sd) > 5.0 and size > 0.03) == shown
        here = found(behind, sd)
        assert (here.sd[:4] > 0.0).all() == shown
        assert (here.estimate[:4] != 0.0).all() == shown
        # Other kinds are always let in.
        assert here.estimate[4] == pytest.approx(other, rel=1e-2)


def test_without_masses_and_departures_there_is_no_scale():
    found = departure_scale(np.eye(3), np.ones(3), np.zeros((3, 3)), np.zeros(0), [])
    assert (found.sd.size, found.estimate.size, found.mass_sd.size) == (0, 0, 0)


def test_friction_counts_from_a_hundredth_of_its_plausible_share_on_and_a_mass_always():
    np.testing.assert_allclose(least_sd(1, [Departure(FRICTION, 0), Departure(ENVELOPE, 1)]), [0.0, 3e-4, 0.01])


def test_stiffening_spokes_are_the_maps_of_their_exponent(model):
    """Half way to the exponent that the direction was taken at, against maps made for that half way."""
    data, parameters, ours = model
    own = EffectiveRoads(data.vehicle, data.load_cases, {"bump": bump()}).tires
    stiffer = replace(own, spoke_exponent=own.spoke_exponent + 0.05)
    exact = bump_model(data, parameters, {"bump": bump()}, tires=stiffer)
    known = known_departures(data, parameters, ours)
    moved = known.model(ours, amplitudes(known, SPOKES, 0.05))
    for plain, one, two in zip(
        *(simulate_runs(m, parameters.start, MOTION) for m in (ours, moved, exact)), strict=True
    ):
        assert np.sqrt(np.mean((one - two) ** 2)) < 0.05 * np.sqrt(np.mean((plain - two) ** 2))


def test_amounts_stay_within_reach_and_friction_bushings_and_tires_do_not_push():
    masses = SimpleNamespace(sd=np.array([0.03]), factors=("one",))
    kinds = (Departure(FRICTION, 0), Departure(BUSHING, 0), Departure(TIRE_DAMPING, 0), Departure(ENVELOPE, 0))
    allowances = Allowances(masses, Departures(None, kinds))
    found = allowances.within_reach(np.array([-0.5, -0.02, -0.1, -0.2, -9.0]))
    np.testing.assert_allclose(found, [-0.12, 0.0, 0.0, 0.0, -REACH[ENVELOPE]])
    np.testing.assert_allclose(allowances.within_reach(np.full(5, 9.0)), [0.12, *(REACH[d.kind] for d in kinds)])


def test_an_axle_goes_no_further_than_its_reach_together_with_what_all_have_in_common():
    masses = SimpleNamespace(sd=np.zeros(0), factors=())
    directions = tuple(Departure(kind, axle) for kind in (FRICTION, ENVELOPE) for axle in (0, 1, None))
    allowances = Allowances(masses, Departures(None, directions))
    found = allowances.within_reach(np.array([0.05, 0.01, 0.06, -1.5, 0.4, -1.0]))
    np.testing.assert_allclose(found, [0.04, 0.01, 0.06, -1.0, 0.4, -1.0])
    np.testing.assert_array_equal(allowances.within_reach(found), found)


@pytest.mark.parametrize(("own", "common"), [(0.1, 0.0), (0.04, 0.06)])
def test_derivatives_do_not_vanish_at_the_end_of_the_reach(model, own: float, common: float):
    """Friction of a tenth of the load, in two ways, against a little less of it."""
    data, parameters, ours = model
    allowances = campaign_allowances(data, parameters, ours.felt)
    names = [*range(len(allowances.masses.factors)), *allowances.departures.directions]
    axle = names.index(Departure(FRICTION, 0))
    amounts = np.zeros(allowances.count)
    amounts[axle], amounts[names.index(Departure(FRICTION, None))] = own, common
    np.testing.assert_array_equal(allowances.within_reach(amounts), amounts)
    ones = tuple(np.ones(g.measured.shape[1:]) for g in ours.groups)

    def column(less: float) -> np.ndarray:
        there = amounts - less * (np.arange(amounts.size) == axle)
        found = departure_columns(ours, allowances, Weights(ones, ones), parameters.start, MOTION, there)
        return found[0].by_channel[..., axle - len(allowances.masses.factors)]

    inside = column(1e-5)
    assert np.abs(inside).max() > 1e-3
    np.testing.assert_allclose(column(0.0), inside, atol=1.5e-4 * np.abs(inside).max())


def test_roads_of_several_passes_are_the_maps_of_each(model):
    """At the stations, splines of degree five have the weights 1, 26, 66, 26, 1 over 120."""
    data, _, _ = model
    roads = EffectiveRoads(data.vehicle, data.load_cases, {"bump": bump()})
    passes = [Pass(case.name, "bump") for case in (LADEN, EMPTY, LADEN)]
    road = roads.stacked(passes)
    weights = np.array([1.0, 26.0, 66.0, 26.0, 1.0]) / 120.0
    seen = [roads.maps(p.load_case, p.bump) for p in passes]
    assert np.abs(seen[0][0].rise_m - seen[1][0].rise_m).max() > 1e-4
    for run, maps in enumerate(seen):
        for axle, table in enumerate(maps):
            first = round((table.station_m[0] - road.first_station_m) / road.step_m)
            here = slice(first, first + table.station_m.size)
            shown = [(road.rise, table.rise_m), (road.stretch[3], table.lift_m)]
            shown += [(road.drag[k], table.drag[k]) for k in range(3)]
            for coefficients, exact in shown:
                found = np.convolve(coefficients[run, axle], weights, mode="same")[here]
                assert np.abs(found - exact).max() < 1e-14 * np.abs(exact).max()


def test_loads_of_a_run_change_its_own_road():
    runs = [empty_run("a.csv", 6.0, samples=150), empty_run("b.csv", 7.0, load_case="laden", samples=900)]
    data = campaign(runs, load_cases=(EMPTY, LADEN))
    parameters = campaign_parameters(data, None)
    ours = bump_model(data, parameters, {"bump": bump()})
    assert len(ours.groups) == 2
    known = known_departures(data, parameters, ours)

    def heavier(cases):
        return np.array([[0.2 if case == "laden" else 0.0] * len(data.vehicle.axles) for case in cases])

    none = np.zeros(len(known.directions))
    moved = known.model(ours, none, heavier)
    for passes, before, after in zip(ours.passes, ours.roads, moved.roads, strict=True):
        changed = np.abs(after.rise).max() != np.abs(before.rise).max()
        assert changed == (passes[0].load_case == "laden")
