"""The way of a run along the road against closed forms and differences."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from native_engine import needs_compiler
from rigid_truck import VEHICLE, bump, campaign, empty_run, true_log_parameters

from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs
from sysid.vehicle_model.motion import Motion, MotionChange, acceleration_of

LENGTH_M = max(a.x_m for a in VEHICLE.axles)


@pytest.mark.parametrize("change", [-0.2, -0.05, 0.0, 0.05, 0.3])
def test_the_last_axle_passes_at_the_changed_speed(change):
    """At constant acceleration the mean speed of the passage is that at its middle: L = v (1 + c / 2) t."""
    speed, start = 6.0, 0.7
    motion = Motion(speed, start, float(acceleration_of(change, np.array(speed), LENGTH_M)))
    arrival = start + LENGTH_M / (speed * (1.0 + 0.5 * change))
    assert float(motion.travelled(start)) == 0.0
    assert float(motion.travelled(arrival)) == pytest.approx(LENGTH_M, rel=1e-12)
    assert float(motion.speed_at(arrival)) == pytest.approx(speed * (1.0 + change), rel=1e-12)
    # Half way the square of the speed has changed by half.
    half = start + (np.sqrt((1.0 + (1.0 + change) ** 2) / 2.0) - 1.0) * speed / motion.acceleration if change else 0.0
    if change:
        assert float(motion.travelled(half)) == pytest.approx(0.5 * LENGTH_M, rel=1e-10)


def test_a_truck_that_brakes_to_a_stand_stays_there():
    """v^2 / 2a behind the start; and one that starts from a stand stood there before."""
    braking, starting = Motion(4.0, 1.0, -0.5), Motion(4.0, 9.0, 0.5)
    for motion, side in ((braking, 1.0), (starting, -1.0)):
        at = motion.start_s + side * 8.0
        for later in (0.0, 1.0, 50.0):
            assert float(motion.travelled(at + side * later)) == pytest.approx(side * 16.0, rel=1e-12)
            assert float(motion.speed_at(at + side * later)) == 0.0


def test_small_changes_move_it_as_differences_say():
    """By forward mode of the motion itself, at instants before, in and after the passage."""
    at, times = (6.0, 0.7, -0.4), jnp.linspace(0.0, 3.0, 7)
    for k in range(3):
        unit = tuple(np.eye(3)[k])
        change = MotionChange(*unit)
        _, way = jax.jvp(lambda *v: Motion(*v).travelled(times), at, unit)
        _, speed = jax.jvp(lambda *v: Motion(*v).speed_at(times), at, unit)
        np.testing.assert_allclose(Motion(*at).ahead(change, times), way, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(Motion(*at).faster(change, times), speed, rtol=1e-12, atol=1e-12)


def test_over_no_length_nothing_changes():
    assert acceleration_of(np.array([0.1]), np.array([6.0]), 0.0) == 0.0


@pytest.mark.parametrize("engine", [pytest.param("native", marks=needs_compiler), "reference"])
def test_the_last_axle_meets_the_bump_when_the_closed_form_says(engine, monkeypatch):
    """First motion of a truck under whose last axle alone the road is uneven, 6 % slower there; both engines."""
    monkeypatch.setenv("SYSID_ENGINE", engine)
    speed, start, change, interval = 6.0, 0.45, -0.06, 0.00125
    data = campaign([empty_run("run.csv", speed, samples=1600, interval_s=interval)], antialias=None)
    model = bump_model(data, campaign_parameters(data, None), {"bump": bump()})
    (road,) = model.roads
    last = np.array([0.0, 0.0, 1.0])[:, None]
    road = replace(road, rise=road.rise * last, stretch=road.stretch * last, drag=road.drag * last)
    model = replace(model, roads=(road,))
    found = []
    for share in (0.0, change):
        motion = RunMotion(np.array([speed]), np.array([start]), np.array([share]))
        (signals,) = simulate_runs(model, true_log_parameters(model.parameters.names), motion)
        found.append((np.abs(signals[:, 0, 5]) > 1e-2).argmax() * interval)
    # Where it first feels the bump, from the run at constant speed.
    felt = speed * (found[0] - start)
    a = ((1.0 + change) ** 2 - 1.0) * speed**2 / (2.0 * LENGTH_M)
    assert found[1] == pytest.approx(start + (np.sqrt(speed**2 + 2.0 * a * felt) - speed) / a, abs=1.01 * interval)
    assert found[1] - found[0] > 0.02
