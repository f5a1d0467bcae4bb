"""The tire's contact law against its own definition: tangent stiffness, static deflection, unilateral and smooth."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sysid.vehicle_model.contact import RoadInput, contact_force, tire_law

ZERO = jnp.zeros((1, 1, 1))
MAP, DRAG = (tuple(jnp.zeros((rows, 1, 1, 1)) for _ in range(4)) for rows in (4, 3))
FLAT = RoadInput(ZERO, ZERO, ZERO, ZERO, ZERO, MAP, DRAG)


def law(stiffness: float, damping: float, exponent: float, load: float, reference: float):
    shape = np.ones((1, 1, 1))
    return tire_law(stiffness * shape, damping * shape, exponent * shape, load * shape, reference * shape)


def value(array: jax.Array) -> float:
    return float(array[0, 0, 0])


@pytest.mark.parametrize("exponent", [1.0, 1.1, 1.25, 1.5])
@pytest.mark.parametrize("load", [12e3, 38e3, 115e3])
def test_the_declared_stiffness_is_the_tangent_at_the_reference_load(exponent: float, load: float):
    k, reference = 2.9e6, 38e3
    rest = law(k, 0.0, exponent, reference, reference)

    def force(rise):
        return value_of(contact_force(rest, FLAT, ZERO, ZERO, ZERO + rise, ZERO)[0])

    def value_of(array):
        return array[0, 0, 0]

    assert float(force(0.0)) == pytest.approx(reference, rel=1e-13)
    assert float(jax.grad(force)(0.0)) == pytest.approx(-k, rel=1e-10)
    # The same tires under another load: reached by the same law from the reference position.
    other = law(k, 0.0, exponent, load, reference)
    sinking = value(other.static_deflection) - value(rest.static_deflection)
    assert float(force(-sinking)) == pytest.approx(load, rel=1e-12)


def test_at_rest_the_force_is_the_static_load():
    tire = law(1.65e6, 2e3, 1.2, 41e3, 38e3)
    force, drag = contact_force(tire, FLAT, ZERO, ZERO + 10.0, ZERO, ZERO)
    assert value(force) == pytest.approx(41e3, rel=1e-13)
    assert value(drag) == 0.0


def test_the_unclipped_force_crosses_zero_at_lift_off_with_finite_derivatives():
    tire = law(1.65e6, 2e3, 1.2, 38e3, 38e3)
    lift = value(tire.static_deflection)

    def force(rise, exponent=1.2, rate=0.1):
        t = law(1.65e6, 2e3, exponent, 38e3, 38e3)
        return contact_force(t, FLAT, ZERO, ZERO, ZERO + rise, ZERO + rate)[0][0, 0, 0]

    assert float(force(lift, rate=0.0)) == pytest.approx(0.0, abs=1e-6)
    assert float(force(lift + 0.01, rate=0.0)) == pytest.approx(-float(force(lift - 0.01, rate=0.0)), rel=1e-9)
    for rise in (lift, lift - 1e-12, lift + 1e-12, lift + 0.02):
        for argument in range(3):
            assert np.isfinite(float(jax.grad(force, argument)(rise, 1.2, 0.1)))


def test_damping_grows_with_the_contact_length():
    """Twice the deflection, sqrt(2) times the length; exact but for the softening at small deflections."""
    light, heavy = law(1.65e6, 2e3, 1.0, 38e3, 38e3), law(1.65e6, 2e3, 1.0, 76e3, 38e3)

    def damping(tire) -> float:
        still = contact_force(tire, FLAT, ZERO, ZERO, ZERO, ZERO)[0]
        return value(contact_force(tire, FLAT, ZERO, ZERO, ZERO, ZERO - 1.0)[0] - still)

    assert damping(light) == pytest.approx(2e3, rel=1e-9)
    assert damping(heavy) / damping(light) == pytest.approx(np.sqrt(2.0), rel=0.03)


def test_the_map_stretches_the_deflection_and_gives_the_forward_force():
    tire = law(1.65e6, 0.0, 1.2, 38e3, 38e3)
    a, b, c, p, q, r = 0.2, 3.0, -20.0, -0.15, 2.0, 5.0
    stretch = (jnp.array([a, b, c, 0.0])[:, None, None, None], *MAP[1:])
    drag = (jnp.array([p, q, r])[:, None, None, None], *DRAG[1:])
    road = RoadInput(ZERO + 0.02, ZERO, ZERO, ZERO, ZERO, stretch, drag)
    v = 0.02 - 0.006
    force, ratio = contact_force(tire, road, ZERO, ZERO, ZERO + 0.006, ZERO)
    u = value(tire.static_deflection)
    e = u + v + a * v + b * v**2 + c * v**3
    assert value(force) == pytest.approx(38e3 * (e / u) ** 1.2, rel=1e-12)
    assert value(ratio) == pytest.approx(p + q * v + r * v**2, rel=1e-12)


def test_above_its_first_contact_a_wheel_is_never_pressed_again():
    """The cubic of the map bends back far from the contact; the wheel must fly as if over a flat road up there."""
    tire = law(1.65e6, 2e3, 1.2, 38e3, 38e3)
    a, b, c, lift = 0.2, 20.0, 300.0, -0.004
    stretch = (jnp.array([a, b, c, lift])[:, None, None, None], *MAP[1:])
    drag = (jnp.array([-0.2, 3.0, 50.0])[:, None, None, None], *DRAG[1:])
    road = RoadInput(ZERO, ZERO, ZERO, ZERO, ZERO, stretch, drag)
    u = value(tire.static_deflection)
    low = lift - u
    clear = [0.0, 0.001, 0.01, 0.05, 0.1, 0.3]
    # At rest above first contact: the equivalent deflection of first contact, less the way up.
    for gap in clear:
        e = lift - gap + low * (a + low * (b + low * c))
        force, ratio = contact_force(tire, road, ZERO, ZERO, ZERO - low + gap, ZERO)
        assert value(force) == pytest.approx(38e3 * np.sign(e) * (abs(e) / u) ** 1.2, rel=1e-9)
        assert value(ratio) == pytest.approx(-0.2 + 3.0 * low + 50.0 * low**2, rel=1e-9)
    falling = [contact_force(tire, road, ZERO, ZERO + 8.0, ZERO - low + gap, ZERO - 2.0)[0] for gap in clear[2:]]
    assert max(value(f) for f in falling) < 0.0


def test_a_wheel_ahead_of_its_look_up_feels_the_road_there():
    """A cubic road is its own Taylor series, so height, slope and damping are exact for any advance."""
    tire = law(1.65e6, 2.5e3, 1.0, 38e3, 38e3)._replace(growth=0.0)
    c0, c1, c2, c3 = 0.01, 0.08, -0.3, 2.0
    road = RoadInput(*(ZERO + v for v in (c0, c1, 2 * c2, 6 * c3, 0.0)))
    d, speed, rise, rate = 0.03, 6.0, 0.004, -0.2
    force, drag = contact_force(tire, road, ZERO + d, ZERO + speed, ZERO + rise, ZERO + rate)
    height, incline = c0 + c1 * d + c2 * d**2 + c3 * d**3, c1 + 2 * c2 * d + 3 * c3 * d**2
    u = value(tire.static_deflection) + height - rise
    assert value(force) == pytest.approx(1.65e6 * u + 2.5e3 * (incline * speed - rate), rel=1e-12)
    assert value(drag) == 0.0
