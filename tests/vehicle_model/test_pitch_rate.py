"""Sensors of pitch rate: kinematics, both engines, and a frame that bends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import rigid_truck
from native_engine import needs_native

from sysid.campaign.records import Campaign, Sensor
from sysid.campaign.vehicle_records import FrameBending
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.residuals.bump_model import BumpModel, bump_model
from sysid.estimation.residuals.linearisation import linearise
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs
from sysid.vehicle_model.assembly import assemble

RATE = Sensor("gyro", "pitch_rate", "deg/s", body=0)
MOTION = RunMotion.steady(np.array([7.1]), np.array([0.35]))


def measured_campaign(sensors, antialias=rigid_truck.FILTER, vehicle=rigid_truck.VEHICLE) -> Campaign:
    run = rigid_truck.empty_run("a.csv", 7.0, samples=300, sensors=sensors)
    return rigid_truck.campaign([run], antialias=antialias, vehicle=vehicle)


def model_of(data: Campaign) -> BumpModel:
    return bump_model(data, campaign_parameters(data, None), {"bump": rigid_truck.bump()})


def signals(data: Campaign, shift: float = 0.0) -> np.ndarray:
    model = model_of(data)
    (found,) = simulate_runs(model, model.parameters.start + shift, MOTION)
    return found[:, 0]


def bent(frequency_hz: float):
    body = replace(rigid_truck.VEHICLE.bodies[0], bending=FrameBending(frequency_hz, 0.02))
    return replace(rigid_truck.VEHICLE, bodies=(body,))


@pytest.fixture(params=["native", "reference"])
def engine(request, monkeypatch):
    if request.param == "native":
        request.getfixturevalue("native_there")
    monkeypatch.setenv("SYSID_ENGINE", request.param)


@pytest.fixture
def native_there():
    if needs_native.args[0]:
        pytest.skip(needs_native.kwargs["reason"])


def test_the_rate_is_the_slope_of_the_accelerations_summed_up(engine):
    """Without a filter: the frame's accelerations at two points, by trapezium, nose up."""
    data = measured_campaign((*rigid_truck.SENSORS, RATE), antialias=None)
    found = signals(data)
    front, rear, rate = found[:, 6], found[:, 7], found[:, 8]
    pitch_acceleration = (front - rear) / 5.0
    summed = np.concatenate([[0.0], np.cumsum(0.5 * (pitch_acceleration[1:] + pitch_acceleration[:-1]))]) * 0.005
    assert np.abs(rate).max() > 0.01
    assert np.abs(rate - summed).max() < 0.02 * np.abs(rate).max()
    # The other sign is another motion.
    assert np.abs(rate + summed).max() > np.abs(rate).max()


def test_the_nose_rises_when_the_front_axle_meets_the_bump(engine):
    rate = signals(measured_campaign((*rigid_truck.SENSORS, RATE)))[:, -1]
    first = np.flatnonzero(np.abs(rate) > 0.2 * np.abs(rate).max())[0]
    assert rate[first] > 0.0


def test_other_channels_are_untouched(engine):
    with_rate = signals(measured_campaign((*rigid_truck.SENSORS, RATE)))
    without = signals(measured_campaign(rigid_truck.SENSORS))
    np.testing.assert_array_equal(with_rate[:, :-1], without)


def test_a_bent_frame_turns_by_the_slope_of_its_shape(engine):
    """Beside the difference of the accelerations of two near points, by trapezium."""
    near = [Sensor(f"near{k}", "body_acceleration", "g", body=0, x_m=x) for k, x in enumerate((0.999, 1.001))]
    data = measured_campaign((*near, replace(RATE, x_m=1.0), replace(RATE, column="rigid")), None, bent(4.0))
    found = signals(data)
    turning = (found[:, 0] - found[:, 1]) / 0.002
    summed = np.concatenate([[0.0], np.cumsum(0.5 * (turning[1:] + turning[:-1]))]) * 0.005
    local, rigid = found[:, 2], found[:, 3]
    assert np.abs(local - summed).max() < 0.03 * np.abs(local).max()
    assert np.abs(rigid - summed).max() > 0.1 * np.abs(local).max()


def test_rows_of_a_rigid_body_are_the_same_everywhere():
    matrices = assemble(rigid_truck.VEHICLE, rigid_truck.EMPTY)
    np.testing.assert_array_equal(matrices.body_turn(0, None), matrices.body_turn(0, 4.0))
    difference = (matrices.body_point(0, 1.0) - matrices.body_point(0, 3.0)) / 2.0
    np.testing.assert_allclose(matrices.body_turn(0, None), difference, atol=1e-12)


@needs_native
@pytest.mark.parametrize("antialias", [rigid_truck.FILTER, pytest.param(None, marks=pytest.mark.long)])
def test_both_engines_give_the_same_signals_and_derivatives(monkeypatch, antialias):
    data = measured_campaign((*rigid_truck.SENSORS, replace(RATE, x_m=2.0)), antialias, bent(9.0))
    found = []
    for name in ("native", "reference"):
        monkeypatch.setenv("SYSID_ENGINE", name)
        model = model_of(data)
        x = model.parameters.start
        (y,) = simulate_runs(model, x + 0.02, MOTION)
        arrays = model.arrays[0]._replace(value=y)
        weights = Weights((0.1 * y.std(axis=0),), (np.ones(y.shape[1:]),))
        (one,) = linearise(replace(model, arrays=(arrays,)), weights, x, MOTION)
        found.append([y, *(np.asarray(v) for v in one)])
    for ours, theirs in zip(*found, strict=True):
        size = np.abs(theirs).max(axis=0, keepdims=True)
        assert (np.abs(ours - theirs) <= 1e-10 * np.maximum(size, 1e-9 * size.max())).all()
    # The channel has derivatives: by stiffnesses, and by the motion of the run.
    by_rate = np.abs(found[0][2][:, 0, -1]).max(axis=0)
    assert (by_rate[:3] > 0.0).all()
    assert (by_rate[-3:-1] > 0.0).all()
