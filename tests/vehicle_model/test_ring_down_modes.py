"""Modes in one deflection after a drop or a release, against motions that are integrated."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sysid.campaign.vehicle_records import Axle, Body, LoadCase, Vehicle
from sysid.vehicle_model.ring_down_modes import modes_after_drop, modes_after_release
from sysid.vehicle_model.vibration_modes import small_motion

MASS, INERTIA, FRONT, REAR = 6000.0, 9000.0, 1.6, 2.4
UNSPRUNG, TIRE, TIRE_DAMPING = np.array([500.0, 900.0]), np.array([1.7e6, 2.9e6]), np.array([2e3, 3e3])
K, C = np.array([3.0e5, 4.5e5]), np.array([8e3, 1.1e4])
LOADS = (MASS * REAR / (FRONT + REAR) + 500.0, MASS * FRONT / (FRONT + REAR) + 900.0)


@pytest.fixture(scope="module")
def motion():
    axles = tuple(
        Axle(n, 0, x, m, kt, ct, 0.5, "leaf")
        for n, x, m, kt, ct in zip(("front", "rear"), (0.0, FRONT + REAR), UNSPRUNG, TIRE, TIRE_DAMPING, strict=True)
    )
    # The centre of gravity at the height of the wheels: the fore-aft motion and the tilt then take no part.
    case = LoadCase("empty", LOADS, (MASS,), (INERTIA,), (0.5,))
    return small_motion(Vehicle("half car", (Body("body"),), axles), case, K, C, TIRE, TIRE_DAMPING)


def integrated(body0, wheel0, times):
    """Deflections (n, 2) of the half car, by its own equations of motion."""
    arms = np.array([FRONT, -REAR])
    to_body = np.stack([np.ones(2), arms])
    inertia = np.array([MASS, INERTIA])

    def motion(t, s):
        body, wheel, body_rate, wheel_rate = s[:2], s[2:4], s[4:6], s[6:8]
        force = K * (to_body.T @ body - wheel) + C * (to_body.T @ body_rate - wheel_rate)
        up = (force - TIRE * wheel - TIRE_DAMPING * wheel_rate) / UNSPRUNG
        return np.concatenate([body_rate, wheel_rate, -(to_body @ force) / inertia, up])

    start = np.concatenate([body0, wheel0, np.zeros(4)])
    found = solve_ivp(motion, (0.0, times[-1]), start, "DOP853", t_eval=times, rtol=1e-10, atol=1e-14).y
    return (to_body.T @ found[:2] - found[2:4]).T


def rest(force_on_wheels, force_on_body):
    """Body (heave, pitch) and wheels at rest under vertical forces on the wheels and on the body above the axles."""
    to_body = np.stack([np.ones(2), np.array([FRONT, -REAR])])
    k = np.block([[to_body @ np.diag(K) @ to_body.T, -to_body * K], [-(to_body * K).T, np.diag(K + TIRE)]])
    found = np.linalg.solve(k, np.concatenate([to_body @ force_on_body, force_on_wheels]))
    return found[:2], found[2:]


def assert_same_motion(modes, times, value):
    """Exponentials with the poles found leave nothing of the motion, and have the amplitudes found."""
    columns = np.exp(modes.pole * times[:, None])
    design = np.concatenate([columns.real, columns.imag], axis=1)
    found = np.linalg.lstsq(design, value, rcond=None)[0]
    np.testing.assert_allclose(design @ found, value, atol=1e-7)
    np.testing.assert_allclose(np.hypot(*found.reshape(2, -1)), modes.amplitude, rtol=1e-5)


@pytest.mark.parametrize("axle", [0, 1])
def test_modes_after_a_drop_are_those_of_the_integrated_motion(motion, axle):
    modes = modes_after_drop(motion, axle, (0.1, 40.0))
    times = np.linspace(0.0, 1.5, 1200)
    value = integrated(*rest(TIRE * np.eye(2)[axle], np.zeros(2)), times)[:, axle]
    assert_same_motion(modes, times, value)


def test_modes_after_a_release_are_those_of_the_integrated_motion(motion):
    """Lifted above the front axle alone: only the force there holds the body."""
    modes = modes_after_release(motion, 1, (0,), (0.1, 40.0))
    body, wheel = rest(np.zeros(2), np.array([1.0, 0.0]))
    height = body[0] + FRONT * body[1]
    times = np.linspace(0.0, 1.5, 1200)
    value = integrated(body / height, wheel / height, times)[:, 1]
    assert_same_motion(modes, times, value)


def test_the_strongest_mode_comes_first_and_only_those_in_the_range(motion):
    every, body = (modes_after_drop(motion, 0, r) for r in ((0.1, 40.0), (0.6, 6.0)))
    assert (every.pole.size, body.pole.size) == (4, 2)
    assert body.strength[0] == 1.0
    assert np.all(np.diff(every.strength) <= 0.0)
    assert np.all(body.pole.imag < 2.0 * np.pi * 6.0)
