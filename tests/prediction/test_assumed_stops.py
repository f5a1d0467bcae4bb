"""Bump stops that nobody declared: their priors, and passes with them against vehicles that declare the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigid_truck import AXLES, VEHICLE, bump, campaign, empty_run, true_log_parameters
from scipy.stats import lognorm

from sysid.campaign.records import Campaign, PredictionRequest
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.parameters.suspension_elements import (
    JOUNCE_TRAVEL_M,
    REBOUND_TRAVEL_M,
    STOP_STIFFNESS,
    TRAVEL_SD,
)
from sysid.estimation.uncertainty.allowances import Allowances
from sysid.estimation.uncertainty.departures import Departures
from sysid.estimation.uncertainty.uncertain_masses import uncertain_masses
from sysid.prediction.assumed_stops import AssumedStops, assumed_stops, axles_without_stops
from sysid.prediction.predict_passes import predict_pass
from sysid.prediction.trust import DrivenRange
from sysid.prediction.vehicle_draws import VehicleDraws
from sysid.vehicle_model.passes import EffectiveRoads

REQUEST = PredictionRequest("empty", 10.0)
#: Travels short enough to be reached [m].
TRAVEL = {"jounce_travel": np.array([[0.02, 0.025, 0.03]]), "rebound_travel": np.array([[0.022, 0.02, 0.025]])}
SHORT = AssumedStops((0, 1, 2), {**TRAVEL, "stop_stiffness": np.full((1, 3), 1.7e6)})


def made(**of_axles) -> Campaign:
    vehicle = replace(VEHICLE, axles=tuple(replace(a, **of_axles) for a in AXLES))
    return campaign([empty_run("a.csv", 9.0)], predictions=[REQUEST], vehicle=vehicle)


def driven(jounce_m: float, rebound_m: float) -> DrivenRange:
    zero = np.zeros(3)
    return DrivenRange({}, zero, np.full(3, jounce_m), np.full(3, rebound_m), zero, zero)


def predicted(data: Campaign, x: np.ndarray, **more):
    roads = EffectiveRoads(data.vehicle, data.load_cases, {"bump": bump()})
    return predict_pass(data, campaign_parameters(data, None), roads, REQUEST, x, **more)


def declared() -> tuple[Campaign, np.ndarray]:
    """The campaign that declares the short travels, and its parameters with the same stop stiffness."""
    axles = tuple(
        replace(a, jounce_travel_m=TRAVEL["jounce_travel"][0, i], rebound_travel_m=TRAVEL["rebound_travel"][0, i])
        for i, a in enumerate(AXLES)
    )
    data = campaign([empty_run("a.csv", 9.0)], vehicle=replace(VEHICLE, axles=axles))
    parameters = campaign_parameters(data, None)
    plain = dict(zip(campaign_parameters(made(), None).names, truth(), strict=True))
    return data, np.array([plain.get(n, np.log(1.7e6)) for n in parameters.names])


def truth() -> np.ndarray:
    return true_log_parameters(campaign_parameters(made(), None).names)


def test_a_pass_with_assumed_stops_is_that_of_a_truck_that_declares_them():
    data, x = declared()
    other, ours, free = (
        predicted(data, x[None]),
        predicted(made(), truth()[None], stops=SHORT),
        predicted(made(), truth()[None]),
    )
    np.testing.assert_allclose(ours.tire_force_q50_N, other.tire_force_q50_N, rtol=1e-9, atol=1e-3)
    assert np.abs(ours.jounce_m.q50 / free.jounce_m.q50 - 1.0).max() > 0.1


def test_so_is_every_drawn_vehicle():
    data = made()
    exact = Allowances(
        uncertain_masses(data), Departures(EffectiveRoads(VEHICLE, data.load_cases, {"bump": bump()}), ())
    )
    longer = {name: 1.2 * v if name.endswith("travel") else v for name, v in SHORT.values.items()}
    both = AssumedStops(SHORT.axles, {name: np.concatenate([v, longer[name]]) for name, v in SHORT.values.items()})
    sets = np.tile(truth(), (2, 1))
    drawn = predicted(data, sets, vehicles=VehicleDraws(exact, np.zeros((2, exact.count)), both))
    each = [predicted(data, truth()[None], stops=AssumedStops(SHORT.axles, v)) for v in (SHORT.values, longer)]
    middle = np.mean([one.peak_ratio_q50 for one in each], axis=0)
    np.testing.assert_allclose(drawn.peak_ratio_q50, middle, rtol=1e-9)
    assert both.first(1).values["jounce_travel"].shape == (1, 3)


def test_stops_that_act_are_said_to_be_assumed():
    found = predicted(made(), truth()[None], stops=SHORT, driven=driven(0.01, 0.01))
    (sentence,) = [w for w in found.warnings if "assumed, not declared" in w]
    assert "axle 1 in jounce at about 20 mm" in sentence
    travel = {e.axle: e for e in found.trust if e.what == "travel"}
    assert travel[0].assumed == 0.02
    assert travel[0].reached > 0.02
    free = predicted(made(), truth()[None], driven=driven(0.01, 0.01))
    assert not [w for w in free.warnings if "assumed" in w]
    assert {e.assumed for e in free.trust} == {None}


@pytest.mark.parametrize("reached_m", [0.0, 0.07, 0.11])
def test_travels_are_drawn_from_their_prior_beyond_what_was_driven(reached_m):
    """Quantiles of the draws against those of the lognormal, cut off below."""
    data = made()
    parameters, count = campaign_parameters(data, None), 20_000
    drawn = assumed_stops(VEHICLE, parameters, driven(reached_m, reached_m), np.random.default_rng(5), count)
    single = assumed_stops(VEHICLE, parameters, driven(reached_m, reached_m), None)
    for name, medians in (("jounce_travel", JOUNCE_TRAVEL_M), ("rebound_travel", REBOUND_TRAVEL_M)):
        for k, axle in enumerate(AXLES):
            prior = lognorm(TRAVEL_SD, scale=medians[axle.suspension])
            below = prior.cdf(reached_m)
            for q in (0.1, 0.5, 0.9):
                exact = prior.ppf(below + q * (1.0 - below))
                assert np.quantile(drawn.values[name][:, k], q) == pytest.approx(exact, rel=0.005)
            assert drawn.values[name][:, k].min() > reached_m
            assert single.values[name][0, k] == pytest.approx(prior.ppf(below + 0.5 * (1.0 - below)), rel=1e-9)
    assert single.values["stop_stiffness"] == pytest.approx(STOP_STIFFNESS)


def test_nothing_is_assumed_where_stops_are_known_or_a_law_is_declared():
    assert axles_without_stops(VEHICLE, campaign_parameters(made(), None).parameters) == (0, 1, 2)
    for of_axles in ({"jounce_travel_m": 0.08}, {"suspension_law": "friction"}):
        data = made(**of_axles)
        assert axles_without_stops(data.vehicle, campaign_parameters(data, None).parameters) == ()
        assert assumed_stops(data.vehicle, campaign_parameters(data, None), driven(0.0, 0.0), None) is None
    found = campaign_parameters(made(), None, [frozenset({"estimated_bump_stops"}), frozenset(), frozenset()])
    assert axles_without_stops(VEHICLE, found.parameters) == (1, 2)
