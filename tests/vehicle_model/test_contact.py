"""The tire's contact law against its own definition: tangent stiffness, static deflection, unilateral and smooth."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from sysid.vehicle_model.contact import RoadInput, contact_force, tire_law

FLAT = RoadInput(*[jnp.zeros((1, 1, 1))] * 5)
ZERO = jnp.zeros((1, 1, 1))


def law(stiffness: float, damping: float, stiffening: float, load: float, reference: float):
    shape = np.ones((1, 1, 1))
    return tire_law(stiffness * shape, damping * shape, stiffening * shape, load * shape, reference * shape)


@pytest.mark.parametrize("stiffening", [1e-6, 0.5, 4.0, 20.0])
@pytest.mark.parametrize("load", [12e3, 38e3, 115e3])
def test_coefficients_give_the_declared_tangent_stiffness(stiffening: float, load: float):
    k, reference = 2.9e6, 38e3
    tire = law(k, 3e3, stiffening, load, reference)
    a, b = float(tire.linear[0, 0, 0]), float(tire.quadratic[0, 0, 0])
    assert b == pytest.approx(stiffening * a, rel=1e-13)

    def deflection(force: float) -> float:
        return brentq(lambda u: a * u + b * u * u - force, 0.0, 1.0, xtol=1e-16, rtol=1e-15)

    assert a + 2 * b * deflection(reference) == pytest.approx(k, rel=1e-12)
    assert float(tire.static_deflection[0, 0, 0]) == pytest.approx(deflection(load), rel=1e-12)
    contact_length = np.sqrt(deflection(load) / deflection(reference))
    assert float(tire.damping[0, 0, 0]) == pytest.approx(3e3 * contact_length, rel=1e-12)


def test_at_rest_the_force_is_the_static_load():
    tire = law(1.65e6, 2e3, 4.0, 41e3, 38e3)
    force, slope = contact_force(tire, FLAT, ZERO, ZERO + 10.0, ZERO, ZERO)
    assert float(force[0, 0, 0]) == pytest.approx(41e3, rel=1e-13)
    assert float(slope[0, 0, 0]) == 0.0


def test_the_unclipped_force_is_smooth_through_lift_off():
    tire = law(1.65e6, 0.0, 4.0, 38e3, 38e3)
    lift = float(tire.static_deflection[0, 0, 0])

    def force(rise):
        return contact_force(tire, FLAT, ZERO, ZERO, ZERO + rise, ZERO)[0][0, 0, 0]

    assert float(force(lift)) == pytest.approx(0.0, abs=1e-9)
    assert float(jax.grad(force)(lift - 1e-9)) == pytest.approx(-float(tire.linear[0, 0, 0]), rel=1e-6)
    assert float(jax.grad(force)(lift + 1e-9)) == pytest.approx(-float(tire.linear[0, 0, 0]), rel=1e-6)
    assert float(force(lift + 0.01)) == pytest.approx(-0.01 * float(tire.linear[0, 0, 0]), rel=1e-9)


def test_a_wheel_ahead_of_its_look_up_feels_the_road_there():
    """A cubic road is its own Taylor series, so height, slope and damping are exact for any advance."""
    tire = law(1.65e6, 2.5e3, 4.0, 38e3, 38e3)
    c0, c1, c2, c3 = 0.01, 0.08, -0.3, 2.0
    road = RoadInput(*(ZERO + v for v in (c0, c1, 2 * c2, 6 * c3, 0.0)))
    d, speed, rise, rate = 0.03, 6.0, 0.004, -0.2
    force, slope = contact_force(tire, road, ZERO + d, ZERO + speed, ZERO + rise, ZERO + rate)
    height, incline = c0 + c1 * d + c2 * d**2 + c3 * d**3, c1 + 2 * c2 * d + 3 * c3 * d**2
    u = float(tire.static_deflection[0, 0, 0]) + height - rise
    expected = float(tire.linear[0, 0, 0]) * u * (1 + 4.0 * u) + 2.5e3 * (incline * speed - rate)
    assert float(slope[0, 0, 0]) == pytest.approx(incline, rel=1e-12)
    assert float(force[0, 0, 0]) == pytest.approx(expected, rel=1e-12)
