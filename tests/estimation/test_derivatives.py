"""Exact derivatives of every residual: central differences through lift-off, and reverse against forward mode."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from rigid_truck import bump, campaign, empty_run, true_log_parameters

from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.residuals.bump_model import BumpModel, bump_model
from sysid.estimation.residuals.linearisation import linearise_group
from sysid.estimation.residuals.run_motion import SHIFT_UNIT_M, SPEED_UNIT, RunMotion
from sysid.estimation.residuals.signals import simulate_group
from sysid.vehicle_model.engines.protocol import Linearisation
from sysid.vehicle_model.engines.reference import REFERENCE
from sysid.vehicle_model.motion import Motion
from sysid.vehicle_model.readings import standardised_residuals

#: Just beside the nominal motion, at which half steps fall on the stations of the road: there the fifth derivative of
#: the road jumps and differences lose an order, see the test of the nominal motion below.
SPEED_M_S, START_S, CHANGE = 8.01, 0.2503, -0.06
#: Half width of the central differences: log parameters, and the unknowns of the motion in their units.
STEPS = {"log": 1e-5, "speed": 1e-5, "start": 1e-5, "speed_change": 1e-5}
#: Unit of the change of speed: the standard deviation of its prior.
CHANGE_SD = 0.02


@partial(jax.jit, static_argnames=("shape",))
def signals(arrays, road, x, motion, *, shape):
    """Sensor signals (T, R, C, S) of parameter sets (p, S), each with its own motion (R, S)."""
    return simulate_group(arrays, shape, x, REFERENCE.prepare(road, arrays.axle_x, motion, shape.timing))


def motions(axle_x, speed, start, change) -> Motion:
    """Motions (1, S); the acceleration from v^2 - v_0^2 = 2 a L, written out here once more."""
    return Motion(*(jnp.asarray(v) for v in (speed, start, ((1 + change) ** 2 - 1) * speed**2 / (2 * axle_x.max()))))


@pytest.fixture(scope="session")
def model() -> BumpModel:
    """One run of the three-axle truck over a bump that all its axles leave, with its own signals as readings."""
    runs = campaign([empty_run("run.csv", SPEED_M_S, samples=250)])
    empty = bump_model(runs, campaign_parameters(runs, None), {"bump": bump()})
    truth = np.tile(true_log_parameters(empty.parameters.names)[:, None], 2 * len(empty.parameters.names) + 6)
    sets = np.ones((1, truth.shape[1]))
    motion = motions(empty.arrays[0].axle_x, SPEED_M_S * sets, START_S * sets, CHANGE * sets)
    y = signals(empty.arrays[0], empty.roads[0], truth, motion, shape=empty.shapes[0])
    return replace(empty, arrays=(empty.arrays[0]._replace(value=np.asarray(y)[..., 0]),))


@pytest.fixture(scope="session")
def point(model) -> np.ndarray:
    return true_log_parameters(model.parameters.names) + 0.05


@pytest.fixture(scope="session")
def noise(model) -> np.ndarray:
    """A hundredth of every channel's own size."""
    return 0.01 * model.arrays[0].value.std(axis=0)


def linearised(model, noise, point, speed_m_s: float, start_s: float) -> Linearisation:
    return linearise_group(
        model.arrays[0],
        model.roads[0],
        noise,
        np.ones_like(noise),
        jnp.asarray(point),
        RunMotion(np.array([speed_m_s]), np.array([start_s]), np.array([CHANGE])),
        shape=model.shapes[0],
    )


@pytest.fixture(scope="session")
def exact(model, point, noise) -> Linearisation:
    return linearised(model, noise, point, SPEED_M_S, START_S)


def central_differences(model, noise, point, speed_m_s: float, start_s: float, steps: np.ndarray):
    """Differences of residuals (T, C, p + 3) and gain residuals (C, p + 3), all in one batch."""
    count = point.size
    moved = np.concatenate([np.diag(steps), -np.diag(steps)], axis=1)
    x = point[:, None] + moved[:count]
    change = CHANGE + CHANGE_SD * moved[count + 2 :]
    # The unknowns are mean speed, start and change.
    mean = speed_m_s * (1 + CHANGE / 2) * (1 + SPEED_UNIT * moved[count : count + 1])
    start = start_s + SHIFT_UNIT_M / speed_m_s * moved[count + 1 : count + 2]
    motion = motions(model.arrays[0].axle_x, mean / (1 + change / 2), start, change)
    y = signals(model.arrays[0], model.roads[0], x, motion, shape=model.shapes[0])
    found = []
    for values in standardised_residuals(model.arrays[0].readings(noise, np.ones_like(noise)), y):
        plus, minus = np.split(np.asarray(values), 2, axis=-1)
        found.append((plus - minus) / (2 * steps))
    return found[0][:, 0], found[1][0]


@pytest.fixture(scope="session")
def differences(model, point, noise) -> tuple[np.ndarray, np.ndarray]:
    steps = np.array([STEPS["log"]] * point.size + [STEPS["speed"], STEPS["start"], STEPS["speed_change"]])
    return central_differences(model, noise, point, SPEED_M_S, START_S, steps)


def test_jacobian_equals_central_differences_in_every_channel(model, exact, differences):
    jacobian = np.asarray(exact.residual_jacobian)[:, 0]
    names = [*model.parameters.names, "speed", "start", "speed_change"]
    size = np.sqrt((jacobian**2).sum(axis=0))
    error = np.sqrt(((jacobian - differences[0]) ** 2).sum(axis=0)) / size
    assert (size > 0).all()
    assert error.max() < 1e-6, {n: e for n, e in zip(names, error.max(axis=0), strict=True) if e > 1e-6}


def test_gain_residuals_too(exact, differences):
    jacobian = np.asarray(exact.gain_jacobian)[0]
    np.testing.assert_allclose(jacobian, differences[1], rtol=0, atol=1e-6 * np.abs(jacobian).max())


def test_wheels_leave_the_ground(model, point, exact):
    """Otherwise the differences above would say nothing about lift-off: an axle falls freely at more than -1 g."""
    accelerations = np.asarray(exact.simulated)[:, 0, 3:6]
    assert (accelerations.min(axis=0) < -15.0).all()


def test_speed_and_start_at_the_nominal_motion(model, point, noise, monkeypatch):
    """8 m/s from 0.25 s: every half step looks the road up exactly on a station."""
    monkeypatch.setitem(globals(), "CHANGE", 0.0)
    jacobian = np.asarray(linearised(model, noise, point, 8.0, 0.25).residual_jacobian)[:, 0, :, -3:-1]
    steps = np.array([STEPS["log"]] * point.size + [3e-6, 1e-5, 1e-5])
    found = central_differences(model, noise, point, 8.0, 0.25, steps)[0][..., -3:-1]
    error = np.sqrt(((jacobian - found) ** 2).sum(axis=0) / (jacobian**2).sum(axis=0))
    # First order in the step here: 4e-8 of a unit for the start, 3e-6 for the speed.
    assert error[:, 1].max() < 1e-6
    assert error[:, 0].max() < 1e-5


@pytest.mark.long
def test_forward_equals_reverse_mode(model, point):
    shape = model.shapes[0]._replace(samples=48, interval_s=0.0025, substeps=1)
    arrays = model.arrays[0]
    one = jnp.ones((1, 1))
    inputs = REFERENCE.prepare(model.roads[0], arrays.axle_x, Motion(SPEED_M_S * one, 0.03 * one), shape.timing)
    random = np.random.default_rng(0)
    direction = jnp.asarray(random.normal(size=(point.size, 1)))

    def run(x):
        return simulate_group(arrays, shape, x, inputs)

    @jax.jit
    def both(x, direction, weight):
        tangent = jax.jvp(run, (x,), (direction,))[1]
        y, pull_back = jax.vjp(run, x)
        return y, jnp.sum(weight * tangent), pull_back(weight)[0]

    weight = jnp.asarray(random.normal(size=(48, 1, 8, 1)) / np.repeat([1e-3, 10.0], [3, 5])[:, None])
    y, forward, gradient = both(jnp.asarray(point)[:, None], direction, weight)
    assert float(y[:, 0, 3].min()) < -15.0  # the first axle falls freely
    assert np.isfinite(gradient).all()
    assert float(jnp.sum(gradient * direction)) == pytest.approx(float(forward), rel=1e-10)


@pytest.mark.parametrize("speed_m_s", [SPEED_M_S, 1e-3])
def test_derivatives_are_finite_before_anything_moves(model, point, noise, speed_m_s):
    """Zero deflection, zero velocity, wheels far from the bump: nothing divides by what is zero there."""
    found = linearised(model, noise, point, speed_m_s, 2000.0)
    for values in found:
        assert np.isfinite(values).all()
    np.testing.assert_allclose(found.simulated, 0.0, atol=1e-6)
