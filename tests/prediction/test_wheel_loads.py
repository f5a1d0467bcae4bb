"""Loads of left and right wheels in predicted passes: they make up the axle's, and follow the draws of the sides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigid_truck import EMPTY, SENSORS
from turned_bump import AT_M, RIGHT, SKEW_RAD, made, turned

from sysid.campaign.records import PredictionRequest
from sysid.campaign.wheel_places import across_axle
from sysid.estimation.residuals.side_unknowns import CG_SIDE
from sysid.estimation.uncertainty.allowances import campaign_allowances
from sysid.prediction.predict_passes import predict_pass
from sysid.prediction.predicted_passes import PassPrediction
from sysid.prediction.vehicle_draws import VehicleDraws
from sysid.vehicle_model.passes import EffectiveRoads

REQUEST = PredictionRequest("empty", 5.0)


def predicted(sensors=RIGHT, to_the_left_m: float = 0.0, profile=None, share: float | None = None) -> PassPrediction:
    data, model, x = made(sensors)
    roads = EffectiveRoads(data.vehicle, data.load_cases, {"bump": profile or turned()})
    allowances = campaign_allowances(data, model.parameters, model.felt)
    amounts = np.zeros((1, allowances.count))
    for j, factor in enumerate(allowances.masses.factors):
        amounts[0, j] = to_the_left_m * (factor.quantity == CG_SIDE)
    error = None if share is None else np.full((1, len(data.vehicle.axles)), share)
    vehicles = VehicleDraws(allowances, amounts, share_error=error)
    return predict_pass(data, model.parameters, roads, REQUEST, x[None], vehicles)


def test_both_sides_make_up_the_axle_and_the_left_meets_the_bump_first() -> None:
    profile = turned()
    sides = profile.sides
    assert sides is not None
    p = predicted(profile=replace(profile, height_m=0.5 * (sides.left_m + sides.right_m)))
    assert p.wheels is not None
    left, right = p.wheels.force_N.q50
    np.testing.assert_allclose(left + right, p.tire_force_q50_N, atol=1e-6)
    assert np.all((left >= 0.0) & (right >= 0.0))
    np.testing.assert_allclose(p.wheels.static_N.q50, 0.5 * np.tile(p.static_load_N, (2, 1)), rtol=1e-9)
    np.testing.assert_allclose(p.wheels.peak_N.q50, p.wheels.force_N.q50.max(axis=2), rtol=1e-9)
    # By twice the half track times the skew, nearly: the axle meets the mean of both tracks.
    half = 0.5 * across_axle(made(RIGHT)[0].vehicle.axles[0]).track_m
    apart = 2.0 * half * np.tan(SKEW_RAD) / REQUEST.speed_m_s
    rises = [p.time_s[np.flatnonzero(f[0] > 1.03 * f[0][0])[0]] for f in (left, right)]
    assert rises[1] - rises[0] == pytest.approx(apart, abs=0.004)
    assert half == pytest.approx(AT_M, abs=0.1)
    side, axle = p.wheels.heaviest(p.static_load_N)
    share = p.wheels.peak_N.q50 / p.static_load_N
    assert share[side, axle] == share.max() > 0.5 * p.peak_ratio_q50.min()


def test_a_load_to_the_left_presses_on_the_left() -> None:
    p, level = predicted(to_the_left_m=0.05), predicted()
    assert p.wheels is not None
    assert level.wheels is not None
    data = made(RIGHT)[0]
    static = p.wheels.static_N.q50
    half = np.array([0.5 * across_axle(a).track_m for a in data.vehicle.axles])
    lever = np.array([np.mean(np.square(across_axle(a).tires_m)) for a in data.vehicle.axles]) / half
    moment = 0.05 * EMPTY.sprung_mass_kg[0] * data.vehicle.gravity_m_s2
    assert float(lever @ (static[0] - static[1])) == pytest.approx(moment, rel=1e-6)
    assert np.all(p.wheels.peak_N.q50[0] > level.wheels.peak_N.q50[0])


def test_an_error_of_the_shares_moves_load_from_side_to_side() -> None:
    level, moved = (predicted(share=share).wheels for share in (None, 0.03))
    assert level is not None
    assert moved is not None
    axle = level.force_N.q50.sum(axis=0)
    change = moved.force_N.q50[0] - level.force_N.q50[0]
    # Where no wheel is off the road or carries all.
    inside = np.all((moved.force_N.q50 > 0.0) & (level.force_N.q50 > 0.0), axis=0)
    np.testing.assert_allclose(change[inside], 0.03 * axle[inside], atol=1e-6)
    np.testing.assert_allclose(
        moved.static_N.q50 - level.static_N.q50, 0.03 * np.stack([axle[:, 0], -axle[:, 0]]), 1e-3
    )


def test_nothing_is_said_without_roll() -> None:
    assert predicted(SENSORS).wheels is None
    assert predicted(profile=replace(turned(), sides=None)).wheels is None
