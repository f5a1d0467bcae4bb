"""Passes whose draws have masses of their own, against passes of vehicles that were declared with these masses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigid_truck import EMPTY, LADEN, VEHICLE, bump, campaign, empty_run

from sysid.campaign.records import AxleGroup, Campaign, MassTolerances, PredictionRequest
from sysid.errors import CampaignError
from sysid.estimation.bump_model import bump_model
from sysid.estimation.parameters import campaign_parameters
from sysid.estimation.uncertain_masses import MassResponse, uncertain_masses
from sysid.prediction.mass_lanes import VehicleDraws
from sysid.prediction.passes import predict, predict_pass
from sysid.vehicle_model.lanes import declared_tires

REQUEST = PredictionRequest("empty", 10.0)
TIRES = declared_tires(VEHICLE)


def made(**changes) -> Campaign:
    vehicle = replace(VEHICLE, tolerances=MassTolerances(), **changes)
    return campaign([empty_run("a.csv", 9.0)], predictions=[REQUEST], vehicle=vehicle)


@pytest.mark.parametrize("law", [None, "friction + bump_stops + gas_spring"])
def test_every_draw_is_a_vehicle_of_its_own(law):
    axles = tuple(replace(a, suspension_law=law, jounce_travel_m=0.03, rebound_travel_m=0.04) for a in VEHICLE.axles)
    data = made(axles=axles)
    parameters = campaign_parameters(data, None)
    random = np.random.default_rng(2)
    draws = parameters.start + 0.05 * random.normal(size=(3, parameters.start.size))
    masses = uncertain_masses(data)
    factors = masses.sd * random.normal(size=(3, masses.sd.size))
    profiles = {"bump": bump()}
    found = predict_pass(
        data, parameters, profiles, REQUEST, draws[0], draws, tires=TIRES, vehicles=VehicleDraws(masses, None, factors)
    )
    peaks = []
    for x, log_factors in zip(draws, factors, strict=True):
        vehicle, cases = masses.applied(log_factors)
        own = replace(data, vehicle=vehicle, load_cases=cases)
        peaks.append(predict_pass(own, parameters, profiles, REQUEST, x, None, tires=TIRES).peak_ratio_q50)
    for ours, quantile in ((found.peak_ratio_q05, 0.05), (found.peak_ratio_q50, 0.5), (found.peak_ratio_q95, 0.95)):
        np.testing.assert_allclose(ours, np.quantile(peaks, quantile, axis=0), rtol=1e-9)
    plain = predict_pass(data, parameters, profiles, REQUEST, draws[0], draws, tires=TIRES)
    assert np.abs(plain.peak_ratio_q50 / found.peak_ratio_q50 - 1.0).max() > 1e-3


def test_vehicles_with_a_beam():
    group = AxleGroup("bogie", (1, 2), 300.0, 90.0)
    data = made(groups=(group,))
    case = replace(EMPTY, sprung_mass_kg=(EMPTY.sprung_mass_kg[0] - 300.0,))
    data = replace(data, load_cases={"empty": case})
    parameters = campaign_parameters(data, None)
    masses = uncertain_masses(data)
    assert "beam_mass[bogie]" in [f.name for f in masses.factors]
    factors = np.full((1, masses.sd.size), 0.02)
    profiles, x = {"bump": bump()}, parameters.start
    found = predict_pass(
        data, parameters, profiles, REQUEST, x, x[None], tires=TIRES, vehicles=VehicleDraws(masses, None, factors)
    )
    vehicle, cases = masses.applied(factors[0])
    own = replace(data, vehicle=vehicle, load_cases=cases)
    alone = predict_pass(own, parameters, profiles, REQUEST, x, None, tires=TIRES)
    np.testing.assert_allclose(found.tire_force_q50_N, alone.tire_force_q50_N, rtol=1e-9)


HALF = replace(LADEN, name="half")


def asked_of_fit(*requests: PredictionRequest, drawn: bool = True):
    """Passes predicted by a fit of runs in two load cases, with draws of masses and departures."""
    runs = [empty_run("a.csv", 9.0), empty_run("b.csv", 9.0, load_case="laden")]
    vehicle = replace(VEHICLE, tolerances=MassTolerances())
    data = campaign(runs, load_cases=(EMPTY, LADEN, HALF), predictions=[REQUEST], vehicle=vehicle)
    parameters, profiles = campaign_parameters(data, None), {"bump": bump()}
    model = bump_model(data, parameters, profiles)
    count = len(model.masses.factors) + len(model.departures.directions)
    x = parameters.start
    # Vehicles that all draws share: exact numbers instead of statistics.
    masses = MassResponse(x, np.zeros((count, x.size)), np.zeros((count, 1)))
    return predict(
        data, parameters, profiles, x, x[None] if drawn else None,
        tires=None, masses=masses, requests=requests or None, sweep_km_h=(),
    )  # fmt: skip


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
    masses = uncertain_masses(made())
    with pytest.raises(ValueError, match="do not fit"):
        VehicleDraws(masses, None, np.zeros((2, masses.sd.size + 1)))


def test_a_pass_needs_to_know_the_tires_of_its_maps():
    data = made()
    parameters = campaign_parameters(data, None)
    with pytest.raises(TypeError, match="needs the tires"):
        predict_pass(data, parameters, {"bump": bump()}, REQUEST, parameters.start, None)
