"""Passes whose draws have masses of their own, against passes of vehicles that were declared with these masses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigid_truck import EMPTY, VEHICLE, bump, campaign, empty_run

from sysid.campaign.records import AxleGroup, Campaign, MassTolerances, PredictionRequest
from sysid.estimation.parameters import campaign_parameters
from sysid.estimation.uncertain_masses import uncertain_masses
from sysid.prediction.passes import predict_pass

REQUEST = PredictionRequest("empty", 10.0)


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
    found = predict_pass(data, parameters, profiles, REQUEST, draws[0], draws, log_factors=factors)
    peaks = []
    for x, log_factors in zip(draws, factors, strict=True):
        vehicle, cases = masses.applied(log_factors)
        own = replace(data, vehicle=vehicle, load_cases=cases)
        peaks.append(predict_pass(own, parameters, profiles, REQUEST, x, None).peak_ratio_q50)
    for ours, quantile in ((found.peak_ratio_q05, 0.05), (found.peak_ratio_q50, 0.5), (found.peak_ratio_q95, 0.95)):
        np.testing.assert_allclose(ours, np.quantile(peaks, quantile, axis=0), rtol=1e-9)
    plain = predict_pass(data, parameters, profiles, REQUEST, draws[0], draws)
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
    found = predict_pass(data, parameters, profiles, REQUEST, x, x[None], log_factors=factors)
    vehicle, cases = masses.applied(factors[0])
    own = replace(data, vehicle=vehicle, load_cases=cases)
    alone = predict_pass(own, parameters, profiles, REQUEST, x, None)
    np.testing.assert_allclose(found.tire_force_q50_N, alone.tire_force_q50_N, rtol=1e-9)
