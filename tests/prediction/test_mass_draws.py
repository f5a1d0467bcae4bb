"""Passes whose draws have masses of their own, against passes of vehicles that were declared with these masses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fit_states import state_at
from rigid_truck import EMPTY, LADEN, VEHICLE, bump, campaign, empty_run
from scipy.stats import norm

from sysid.campaign.records import Campaign, PredictionRequest
from sysid.campaign.vehicle_records import AxleGroup, Equaliser, FrameBending, MassTolerances
from sysid.errors import CampaignError
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.uncertainty.allowances import Allowances
from sysid.estimation.uncertainty.departures import BUSHING, Departure, Departures
from sysid.estimation.uncertainty.mass_response import MassResponse
from sysid.estimation.uncertainty.uncertain_masses import uncertain_masses
from sysid.prediction.predict_passes import predict, predict_pass
from sysid.prediction.vehicle_draws import CONTACT_ERROR, VehicleDraws, with_contact_error
from sysid.vehicle_model.passes import EffectiveRoads

REQUEST = PredictionRequest("empty", 10.0)
PROFILES = {"bump": bump()}


def made(**changes) -> Campaign:
    # Loads as declared: another vehicle, declared with other loads, has other footprints and reference loads of tires.
    vehicle = replace(VEHICLE, tolerances=MassTolerances(axle_load=0.0, axle_load_scale=0.0), **changes)
    return campaign([empty_run("a.csv", 9.0)], predictions=[REQUEST], vehicle=vehicle)


def felt(data: Campaign) -> EffectiveRoads:
    """What the wheels feel of the bump, by the default contact law and declared tires."""
    return EffectiveRoads(data.vehicle, data.load_cases, PROFILES)


def only_masses(data: Campaign) -> Allowances:
    """Uncertain masses, and no departure from the model."""
    return Allowances(uncertain_masses(data), Departures(felt(data), ()))


@pytest.mark.parametrize("law", [None, "friction + bump_stops + gas_spring"])
def test_every_draw_is_a_vehicle_of_its_own(law):
    axles = tuple(replace(a, suspension_law=law, jounce_travel_m=0.03, rebound_travel_m=0.04) for a in VEHICLE.axles)
    data = made(axles=axles)
    parameters = campaign_parameters(data, None)
    random = np.random.default_rng(2)
    draws = parameters.start + 0.05 * random.normal(size=(3, parameters.start.size))
    masses = uncertain_masses(data)
    factors = masses.sd * random.normal(size=(3, masses.sd.size))
    roads = felt(data)
    found = predict_pass(data, parameters, roads, REQUEST, draws, VehicleDraws(only_masses(data), factors))
    peaks = []
    for x, log_factors in zip(draws, factors, strict=True):
        vehicle, cases = masses.applied(log_factors)
        own = replace(data, vehicle=vehicle, load_cases=cases)
        peaks.append(predict_pass(own, parameters, roads, REQUEST, x[None]).peak_ratio_q50)
    for ours, quantile in ((found.peak_ratio_q05, 0.05), (found.peak_ratio_q50, 0.5), (found.peak_ratio_q95, 0.95)):
        np.testing.assert_allclose(ours, np.quantile(peaks, quantile, axis=0), rtol=1e-9)
    plain = predict_pass(data, parameters, roads, REQUEST, draws)
    assert np.abs(plain.peak_ratio_q50 / found.peak_ratio_q50 - 1.0).max() > 1e-3


def test_peaks_are_over_the_load_that_was_weighed_and_what_is_dynamic_over_the_one_that_a_vehicle_has():
    """A scale that showed 2 % too little: heavier axles and bodies on the same springs, at rest before the bump."""
    data = made()
    data = replace(data, vehicle=replace(VEHICLE, tolerances=MassTolerances()))
    parameters = campaign_parameters(data, None)
    masses = uncertain_masses(data)
    factors = np.array([[0.02 * (f.name == "axle_load_scale") for f in masses.factors]])
    vehicles = VehicleDraws(only_masses(data), factors)
    found = predict_pass(data, parameters, felt(data), REQUEST, parameters.start[None], vehicles)
    plain = predict_pass(data, parameters, felt(data), REQUEST, parameters.start[None])
    at_rest = found.tire_force_q50_N[:, 0] / plain.tire_force_q50_N[:, 0]
    # Reached in 4 standard deviations of half a per cent.
    np.testing.assert_allclose(at_rest, np.exp(0.02), rtol=1e-6)
    np.testing.assert_allclose(found.peak_ratio_q50, found.tire_force_q50_N.max(axis=1) / found.static_load_N)
    np.testing.assert_allclose(found.impulse_ratio.q50, plain.impulse_ratio.q50, atol=2e-3)
    np.testing.assert_allclose(found.load_coefficient.q50, plain.load_coefficient.q50, rtol=0.03)
    # It comes to rest again, at a weight that is not the one on the scale.
    assert not [w for w in found.warnings if "at rest again" in w]


def test_bushings_that_give_way_in_some_of_the_draws_only():
    """Each of both against a prediction of its own."""
    data = made()
    parameters, roads = campaign_parameters(data, None), felt(data)
    known = Departures(roads, tuple(Departure(BUSHING, i) for i in range(3)))
    allowances = Allowances(uncertain_masses(data), known)
    amounts = np.zeros((2, allowances.count))
    amounts[1, -3:] = 0.3
    x = np.tile(parameters.start, (2, 1))
    together = predict_pass(data, parameters, roads, REQUEST, x, VehicleDraws(allowances, amounts))
    own = [
        predict_pass(data, parameters, roads, REQUEST, x[:1], VehicleDraws(allowances, a[None])).peak_ratio_q50
        for a in amounts
    ]
    np.testing.assert_allclose(together.peak_ratio_q50, np.median(own, axis=0), rtol=1e-9)
    assert np.abs(own[1] / own[0] - 1.0).max() > 1e-3


def test_vehicles_with_a_beam():
    group = AxleGroup("bogie", (1, 2), 300.0, 90.0)
    data = made(groups=(group,))
    case = replace(EMPTY, sprung_mass_kg=(EMPTY.sprung_mass_kg[0] - 300.0,))
    data = replace(data, load_cases={"empty": case})
    parameters = campaign_parameters(data, None)
    masses = uncertain_masses(data)
    assert "beam_mass[bogie]" in [f.name for f in masses.factors]
    factors = np.full((1, masses.sd.size), 0.02)
    x = parameters.start
    found = predict_pass(data, parameters, felt(data), REQUEST, x[None], VehicleDraws(only_masses(data), factors))
    vehicle, cases = masses.applied(factors[0])
    own = replace(data, vehicle=vehicle, load_cases=cases)
    alone = predict_pass(own, parameters, felt(data), REQUEST, x[None])
    np.testing.assert_allclose(found.tire_force_q50_N, alone.tire_force_q50_N, rtol=1e-9)


def test_vehicles_with_a_rocker_and_a_bending_frame():
    """Draws of both vehicles side by side give what each gives alone."""
    data = made(equalisers=(Equaliser("tandem", (1, 2)),))
    bent = replace(data.vehicle.bodies[0], bending=FrameBending(8.0, 0.03))
    data = replace(data, vehicle=replace(data.vehicle, bodies=(bent,)))
    parameters, masses = campaign_parameters(data, None), uncertain_masses(data)
    factors = np.array([[0.02], [-0.01]]) * np.ones((2, masses.sd.size))
    draws = np.stack([parameters.start, parameters.start + 0.03])
    found = predict_pass(data, parameters, felt(data), REQUEST, draws, VehicleDraws(only_masses(data), factors))
    peaks = []
    for x, log_factors in zip(draws, factors, strict=True):
        vehicle, cases = masses.applied(log_factors)
        own = replace(data, vehicle=vehicle, load_cases=cases)
        peaks.append(predict_pass(own, parameters, felt(data), REQUEST, x[None]).peak_ratio_q50)
    np.testing.assert_allclose(found.peak_ratio_q50, np.quantile(peaks, 0.5, axis=0), rtol=1e-9)
    rigid = replace(data, vehicle=replace(data.vehicle, bodies=(replace(bent, bending=None),)))
    stiff = campaign_parameters(rigid, None)
    other = predict_pass(rigid, stiff, felt(rigid), REQUEST, stiff.start[None])
    assert np.abs(other.peak_ratio_q50 / peaks[0] - 1.0).max() > 1e-3


HALF = replace(LADEN, name="half")


def asked_of_fit(*requests: PredictionRequest, drawn: bool = True, draws: int = 1):
    """Passes predicted by a fit of runs in two load cases, with draws of masses and departures."""
    runs = [empty_run("a.csv", 9.0), empty_run("b.csv", 9.0, load_case="laden")]
    vehicle = replace(VEHICLE, tolerances=MassTolerances())
    data = campaign(runs, load_cases=(EMPTY, LADEN, HALF), predictions=[REQUEST], vehicle=vehicle)
    parameters = campaign_parameters(data, None)
    model = bump_model(data, parameters, PROFILES)
    scale = tuple(np.ones((len(g.runs), len(model.layout.sensors))) for g in model.groups)
    x = parameters.start
    state = state_at(data, model, x, RunMotion.steady(np.full(2, 9.0), np.full(2, 0.5)), Weights(scale, scale))
    count = state.allowances.count
    # Vehicles that all draws share: exact numbers instead of statistics.
    response = MassResponse(x, np.zeros((count, x.size)), np.zeros((count, 1)), np.zeros(count))
    state = replace(state, point=replace(state.point, mass_response=response))
    return predict(state, np.tile(x, (draws, 1)) if drawn else None, requests or data.predictions, sweep_km_h=())


def test_other_passes_than_those_of_the_file_are_predicted_by_the_same_draws():
    """Draws belong to masses and departures of the load cases that were fitted, whatever passes are asked for."""
    of_file = asked_of_fit().passes[0]
    other = asked_of_fit(PredictionRequest("laden", 10.0), REQUEST).passes
    assert [p.load_case for p in other] == ["laden", "empty"]
    np.testing.assert_allclose(other[1].tire_force_q50_N, of_file.tire_force_q50_N, rtol=1e-12)


@pytest.mark.parametrize("drawn", [True, False])
def test_a_load_case_that_the_fit_does_not_know_is_refused_in_one_sentence(drawn):
    with pytest.raises(CampaignError, match=r"Load case 'half' is in no run and no prediction of campaign.toml"):
        asked_of_fit(PredictionRequest("half", 10.0), drawn=drawn)


def test_draws_of_another_vehicle_are_refused():
    masses = only_masses(made())
    with pytest.raises(ValueError, match="do not fit"):
        VehicleDraws(masses, np.zeros((2, masses.count + 1)))


def test_errors_of_the_contact_scale_what_is_dynamic_and_leave_wheels_in_the_air():
    tire = np.array([1000.0, 3000.0, 200.0, 0.0])[:, None, None] * np.ones((4, 2, 1))
    static, error = np.full((2, 1), 1000.0), np.array([[0.1], [-0.1]])
    found = with_contact_error(tire, static, error)
    np.testing.assert_allclose(found[:, 0, 0], [1000.0, 3200.0, 120.0, 0.0])
    np.testing.assert_allclose(found[:, 1, 0], [1000.0, 2800.0, 280.0, 0.0])
    assert with_contact_error(np.full((1, 1, 1), 10.0), np.full((1, 1), 1000.0), np.full((1, 1), 0.2)).item() == 0.0


def test_every_draw_has_its_own_errors_of_the_contact():
    data = made()
    parameters = campaign_parameters(data, None)
    masses = uncertain_masses(data)
    draws, exact = np.tile(parameters.start, (3, 1)), np.zeros((3, masses.sd.size))
    error = np.array([[-0.1, 0.0, 0.02], [0.0, 0.0, 0.0], [0.1, 0.0, -0.02]])
    vehicles = VehicleDraws(only_masses(data), exact, contact_error=error)
    found = predict_pass(data, parameters, felt(data), REQUEST, draws, vehicles)
    plain = predict_pass(data, parameters, felt(data), REQUEST, draws, VehicleDraws(only_masses(data), exact))
    dynamic = plain.peak_ratio_q50 - 1.0
    np.testing.assert_allclose(found.peak_ratio_q50, plain.peak_ratio_q50, rtol=1e-9)
    # Of three draws the 5 and 95 % quantiles are nine tenths of the way to the outer ones.
    np.testing.assert_allclose(found.peak_ratio_q95 - found.peak_ratio_q50, [0.09, 0.0, 0.018] * dynamic, atol=1e-9)
    np.testing.assert_allclose(found.suspension_force_N.q95, plain.suspension_force_N.q95)
    # Masses as declared: what the suspensions carry at rest is in these forces, drawn or not.
    declared = predict_pass(data, parameters, felt(data), REQUEST, draws[:1])
    np.testing.assert_allclose(plain.suspension_force_N.q50, declared.suspension_force_N.q50, rtol=1e-9)
    assert vehicles.first(2).contact_error.shape == (2, 3)


def test_predicted_loads_of_draws_that_are_all_alike_differ_by_the_errors_of_the_contact():
    found = asked_of_fit(draws=200).passes[0]
    plain = asked_of_fit(drawn=False).passes[0]
    dynamic = plain.peak_ratio_q50 - 1.0
    wide = (found.peak_ratio_q95 - found.peak_ratio_q05) / (2.0 * norm.ppf(0.95) * CONTACT_ERROR * dynamic)
    # The draws are those of one seed: of another the width would be some 8 % off.
    np.testing.assert_allclose(wide, 1.0, atol=0.03)
    # A median of n normal draws has a standard deviation of 1.25 / sqrt(n) of theirs; three of these.
    off = np.abs(found.peak_ratio_q50 - plain.peak_ratio_q50) / dynamic
    assert off.max() < 3.0 * 1.25 * CONTACT_ERROR / np.sqrt(200)
