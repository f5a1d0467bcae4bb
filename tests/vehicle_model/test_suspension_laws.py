"""Suspension laws: closed forms of each element, and the integrator with each law against DOP853."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from hand_written_truck import DURATION_S, FINE_S, HEIGHTS_M, OUTPUT_S, Truck, relative_rms
from rigid_truck import DAMPING, STIFFNESS
from simulated_truck import per_axle, simulated_truck

from sysid.vehicle_model.suspension import Ramps, SuspensionLaw

FRICTION = np.array([1500.0, 900.0, 3000.0])
SLIP_M = 1e-3
SOFTENING = np.array([0.0, 2.5, 4.0])
KNEE = np.array([0.25, 0.2, 0.6])
TAIL = np.array([0.3, 0.15, 0.0])
ASYMMETRY = np.array([2.5, 1.0, 4.0])
STOP_M, STOP = np.array([0.02, 0.03, 0.025]), np.array([2e6, 3e6, 2.5e6])


def gas(e, v, phi):
    return STIFFNESS * e / (1 + SOFTENING * e) + DAMPING * v


def saturating(e, v, phi):
    shape = TAIL * v + (1 - TAIL) * v / np.sqrt(1 + (v / KNEE) ** 2)
    stated = TAIL * 0.5 + (1 - TAIL) * 0.5 / np.sqrt(1 + (0.5 / KNEE) ** 2)
    return STIFFNESS * e + 0.5 * DAMPING * shape / stated


def asymmetric(e, v, phi):
    return STIFFNESS * e + DAMPING * v * np.where(v > 0, ASYMMETRY, 1.0) * 2 / (1 + ASYMMETRY)


def friction(e, v, phi):
    return STIFFNESS * e + DAMPING * v + FRICTION * phi


def stops(e, v, phi):
    beyond = np.maximum(e - STOP_M, 0.0) - np.maximum(-e - 0.8 * STOP_M, 0.0)
    return STIFFNESS * e + DAMPING * v + STOP * beyond


LINEAR = SuspensionLaw(per_axle(STIFFNESS), per_axle(DAMPING))
STOP_RAMPS = Ramps(
    at=jnp.stack([per_axle(STOP_M), per_axle(-0.8 * STOP_M)]),
    slope=jnp.stack([per_axle(STOP), per_axle(STOP)]),
    side=jnp.stack([per_axle(np.ones(3)), per_axle(-np.ones(3))]),
)
LAWS = {
    "gas spring": (gas, LINEAR._replace(softening=per_axle(SOFTENING))),
    "saturating damper": (saturating, LINEAR._replace(saturation=per_axle(KNEE), tail=per_axle(TAIL))),
    "asymmetric damper": (asymmetric, LINEAR._replace(asymmetry=per_axle(ASYMMETRY))),
    "friction": (friction, LINEAR._replace(friction=per_axle(FRICTION), slip=per_axle(np.full(3, SLIP_M)))),
    "stops": (stops, LINEAR._replace(ramps=STOP_RAMPS)),
}
CHANNELS = ("deflection", "axle_acceleration", "body_acceleration", "tire_force", "suspension_force")


@pytest.fixture(scope="module", params=LAWS)
def case(request):
    """Hand-written histories of both bumps, and the package's law."""
    force, law = LAWS[request.param]
    times = np.arange(round(DURATION_S / FINE_S)) * FINE_S
    return request.param, [Truck(h, force, SLIP_M).histories(times) for h in HEIGHTS_M], law


def test_every_channel_against_dop853_at_the_default_step(case):
    name, oracle, law = case
    ours = simulated_truck(0.00125, law=law)
    every = round(OUTPUT_S / FINE_S)
    for lane in range(2):
        errors = {
            q: relative_rms(np.asarray(getattr(ours, q))[:, lane, :, 0], oracle[lane][q][::every]).max()
            for q in CHANNELS
        }
        assert max(errors.values()) < 1e-4, (name, lane, errors)
