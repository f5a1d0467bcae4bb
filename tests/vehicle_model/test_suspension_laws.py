"""Suspension laws: closed forms of each element, and the integrator with each law against DOP853."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hand_written_truck import DURATION_S, FINE_S, HEIGHTS_M, OUTPUT_S, Truck, linear, relative_rms
from rigid_truck import DAMPING, STIFFNESS
from scipy.integrate import quad
from simulated_truck import per_axle, simulated_truck

from sysid.vehicle_model.suspension import (
    Ramps,
    SuspensionLaw,
    damper_force,
    kink_corrections,
    spring_force,
)
from sysid.vehicle_model.suspension_states import slip_after_step

FRICTION = np.array([1500.0, 900.0, 3000.0])
SLIP_M = 1e-3
#: Leaves that rub more when compressed, by twice as much at 0.2, 0.125 and 0.1 m, and less when they slide.
GROWTH = np.array([5.0, 8.0, 10.0])
SLIDING = np.array([0.6, 0.8, 0.5])
SLIDING_RATE = np.array([0.1, 0.3, 0.05])
SOFTENING = np.array([0.0, 2.5, 4.0])
STIFFENING = np.array([0.0, 30.0, 60.0])
KNEE = np.array([0.25, 0.2, 0.6])
TAIL = np.array([0.3, 0.15, 0.0])
BROAD_KNEE = np.array([0.8, 1.2, 1.0])
ROUNDING = np.array([0.0, 0.5, 1.5])
ASYMMETRY = np.array([2.5, 1.0, 4.0])
#: From soft to almost rigid: T is 5 ms, 1.5 ms and 0.3 ms, around the step of 1.25 ms.
BUSHING = np.array([2e6, 8e6, 3e7])
STOP_M, STOP = np.array([0.02, 0.03, 0.025]), np.array([2e6, 3e6, 2.5e6])


def gas(e, v, phi):
    return STIFFNESS * e / (1 + SOFTENING * e) + STIFFNESS * STIFFENING * e**3 + DAMPING * v


def saturating(e, v, phi):
    def shape(rate):
        return TAIL + (1 - TAIL) / np.sqrt(1 + 2 * ROUNDING * np.abs(rate) / KNEE + (rate / KNEE) ** 2)

    return STIFFNESS * e + DAMPING * v * shape(v) / shape(0.5)


def hyperbolic(e, v, phi):
    side = np.where(v > 0, ASYMMETRY, 1.0) * 2 / (1 + ASYMMETRY)
    return STIFFNESS * e + DAMPING * side * v * (1 + 0.5 / BROAD_KNEE) / (1 + np.abs(v) / BROAD_KNEE)


def asymmetric(e, v, phi):
    return STIFFNESS * e + DAMPING * v * np.where(v > 0, ASYMMETRY, 1.0) * 2 / (1 + ASYMMETRY)


def friction(e, v, phi):
    return STIFFNESS * e + DAMPING * v + FRICTION * phi


def envelope(e, v):
    return np.maximum(1.0 - GROWTH * e, 0.0) * (SLIDING + (1.0 - SLIDING) / (1.0 + (v / SLIDING_RATE) ** 2))


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
    "gas spring": (gas, LINEAR._replace(softening=per_axle(SOFTENING), stiffening=per_axle(STIFFENING))),
    "saturating damper": (
        saturating,
        LINEAR._replace(saturation=per_axle(KNEE), rounding=per_axle(ROUNDING), tail=per_axle(TAIL)),
    ),
    "hyperbolic damper": (
        hyperbolic,
        LINEAR._replace(
            saturation=per_axle(BROAD_KNEE),
            rounding=per_axle(np.ones(3)),
            tail=per_axle(np.zeros(3)),
            asymmetry=per_axle(ASYMMETRY),
        ),
    ),
    "asymmetric damper": (asymmetric, LINEAR._replace(asymmetry=per_axle(ASYMMETRY))),
    "friction": (friction, LINEAR._replace(friction=per_axle(FRICTION), slip=per_axle(np.full(3, SLIP_M)))),
    "friction of leaves": (
        friction,
        LINEAR._replace(
            friction=per_axle(FRICTION),
            slip=per_axle(np.full(3, SLIP_M)),
            friction_growth=per_axle(GROWTH),
            sliding=per_axle(SLIDING),
            sliding_rate=per_axle(SLIDING_RATE),
        ),
    ),
    "stops": (stops, LINEAR._replace(ramps=STOP_RAMPS)),
    "damper in bushings": (linear, LINEAR._replace(compliance=per_axle(1.0 / BUSHING))),
    "asymmetric damper in bushings": (
        asymmetric,
        LINEAR._replace(asymmetry=per_axle(ASYMMETRY), compliance=per_axle(1.0 / BUSHING)),
    ),
}
#: Rate of a damper from its force.
DAMPER_RATE = {
    "damper in bushings": lambda force: force / DAMPING,
    "asymmetric damper in bushings": lambda force: (
        force / DAMPING * (1 + ASYMMETRY) / 2 / np.where(force > 0, ASYMMETRY, 1.0)
    ),
}
#: A damper in bushings passes its corner with an error of first order in a step; friction of leaves takes the mean of
#: its envelope in a step, an error of second order.
TOLERANCE = {"asymmetric damper in bushings": 1e-3, "friction of leaves": 5e-4}
CHANNELS = ("deflection", "axle_acceleration", "body_acceleration", "tire_force", "suspension_force")


@pytest.fixture(scope="module", params=LAWS)
def case(request):
    """Hand-written histories of both bumps, and the package's law."""
    force, law = LAWS[request.param]
    times = np.arange(round(DURATION_S / FINE_S)) * FINE_S
    bushing = {} if law.compliance is None else {"bushing_N_per_m": BUSHING, "damper_rate": DAMPER_RATE[request.param]}
    rubs = {} if law.sliding is None else {"envelope": envelope}
    return request.param, [Truck(h, force, SLIP_M, **rubs, **bushing).histories(times) for h in HEIGHTS_M], law


def test_every_channel_against_dop853_at_the_default_step(case):
    name, oracle, law = case
    ours = simulated_truck(0.00125, law=law)
    every = round(OUTPUT_S / FINE_S)
    for number in range(2):
        errors = {
            q: relative_rms(np.asarray(getattr(ours, q))[:, number, :, 0], oracle[number][q][::every]).max()
            for q in CHANNELS
        }
        assert max(errors.values()) < TOLERANCE.get(name, 1e-4), (name, number, errors)


def test_wheels_that_links_lead_against_dop853():
    """To a hundredth of what the links do; half of the links fail."""
    trailing = np.array([0.1, -0.08, 0.12])
    times = np.arange(round(DURATION_S / FINE_S)) * FINE_S
    every = round(OUTPUT_S / FINE_S)
    straight, half, ours = (
        simulated_truck(0.00125, law=LINEAR if b == 0.0 else LINEAR._replace(trailing=per_axle(b * trailing)))
        for b in (0.0, 0.5, 1.0)
    )
    for number, height in enumerate(HEIGHTS_M):
        oracle = Truck(height, linear, trailing=trailing).histories(times)

        def error(histories, quantity, number=number, oracle=oracle):
            one = np.asarray(getattr(histories, quantity))[:, number, :, 0]
            return relative_rms(one, oracle[quantity][::every])

        for quantity in CHANNELS:
            effect = error(straight, quantity)
            assert (error(ours, quantity) < 0.01 * effect).all(), (number, quantity)
            assert (error(half, quantity) > 0.3 * effect).all(), (number, quantity)


def test_friction_slides_in_closed_form_and_turns():
    """From rest over 1 mm and back 0.4 mm: 1 - e^-1, then -1 + (2 - e^-1) e^-0.4 for the slip length of 1 mm."""
    law = LINEAR._replace(friction=per_axle(FRICTION), slip=per_axle(np.full(3, SLIP_M)))
    x = per_axle(np.zeros(3))
    away = slip_after_step(law, x, (x, x + 1.0), (x + 1e-3, x + 1.0), 1e-3)
    assert np.asarray(away) == pytest.approx(1.0 - np.exp(-1.0), rel=1e-12)
    back = slip_after_step(law, away, (x + 1e-3, x - 1.0), (x + 6e-4, x - 1.0), 4e-4)
    assert np.asarray(back) == pytest.approx(-1.0 + (2.0 - np.exp(-1.0)) * np.exp(-0.4), rel=1e-12)
    # One step that turns half way: e = x + v t - v t^2 / h, up to v h / 4 and back to where it was.
    h, v = 1e-3, 2.0
    turned = slip_after_step(law, x, (x, x + v), (x, x - v), h)
    rise = v * h / 4.0 / SLIP_M
    expected = -1.0 + (2.0 - np.exp(-rise)) * np.exp(-rise)
    assert np.asarray(turned) == pytest.approx(expected, rel=1e-12)


def test_spring_and_damper_forces_are_those_of_the_hand_written_laws():
    e, v = per_axle(np.array([0.01, -0.03, 0.02])), per_axle(np.array([0.3, -0.7, 0.05]))
    for force, law in LAWS.values():
        if law.friction is not None:
            continue
        ours = np.asarray(spring_force(law, e) + damper_force(law, v))[0, :, 0]
        assert ours == pytest.approx(force(np.asarray(e)[0, :, 0], np.asarray(v)[0, :, 0], 0.0), rel=1e-12)


def test_laws_have_finite_slopes_at_rest():
    for _, law in LAWS.values():
        zero = per_axle(np.zeros(3))

        def total(e, law=law):
            return (spring_force(law, e) + damper_force(law, e)).sum()

        assert np.isfinite(np.asarray(jax.grad(total)(zero))).all()


@pytest.mark.parametrize("asymmetry", [None, 3.0, 0.4])
def test_a_rounded_damper_is_corrected_to_third_order_whether_its_directions_differ_or_not(asymmetry):
    """Straight through rest, in ever shorter steps: what the correction leaves falls with the cube of the rate."""
    shape = (1, 1, 1)
    law = SuspensionLaw(
        np.zeros(shape),
        np.full(shape, 1e4),
        saturation=np.full(shape, 0.2),
        rounding=np.ones(shape),
        tail=np.full(shape, 0.3),
        asymmetry=None if asymmetry is None else np.full(shape, asymmetry),
    )

    def force(rate: float) -> float:
        return float(np.asarray(damper_force(law, np.full(shape, rate)))[0, 0, 0])

    missed = []
    for scale in (0.02, 0.01, 0.005):
        first, last = -scale, 1.7 * scale
        stages = first, 0.5 * (first + last), 0.5 * (first + last), last
        forces = [force(v) for v in stages]
        rates = tuple(jnp.full(shape, v) for v in stages)
        mean, moment = (float(x[0, 0, 0]) for x in kink_corrections(law, (jnp.zeros(shape),) * 4, rates))
        turn = first / (first - last)
        exact = [
            quad(lambda s, w=w, a=first, b=last: w(s) * force(a + s * (b - a)), 0.0, 1.0, points=[turn])[0]
            for w in (lambda s: 1.0, lambda s: 1.0 - s)
        ]
        got = (forces[0] + 4.0 * forces[1] + forces[3]) / 6.0 + mean, (forces[0] + 2.0 * forces[1]) / 6.0 + moment
        missed.append(np.abs(np.subtract(got, exact)))
    ratios = np.array(missed)[:-1] / np.array(missed)[1:]
    # The factor is 4 where the curvature of one direction is taken for both.
    assert (ratios > 7.0).all(), (missed, ratios)
