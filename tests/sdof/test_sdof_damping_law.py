"""Viscous, dry and quadratic damping told apart, against an integration that the toolkit has no part in."""

from __future__ import annotations

import numpy as np
import pytest
from decay_oracles import damped_cosine, nonlinear_decay

from studies.ring_downs.motion import NOISE_M, Oscillator, ring
from sysid.sdof.damping_choice import without_sticking
from sysid.sdof.damping_law import fit_damping_law
from sysid.sdof.decay import prepare_record, reading_of
from sysid.sdof.decay_window import decay_window
from sysid.sdof.mixture_fit import LEVEL
from sysid.sdof.ring_down import ring_down

TIME = np.arange(0.0, 5.0, 0.005)
OMEGA = 2.0 * np.pi / 0.6
MASS = 3400.0
STIFFNESS = MASS * OMEGA**2
RELEASED = 0.055


def law_of(time, value):
    return fit_damping_law(prepare_record(time, value), from_release=True)


def logged(oscillator, seed=3, released=RELEASED):
    clean = ring(oscillator, released, np.maximum(TIME - 0.5, 0.0))[0]
    return clean + 0.004 + NOISE_M * np.random.default_rng(seed).standard_normal(TIME.size)


def oscillator(viscous=0.0, friction=0.0, quadratic=0.0):
    """Parts of the amplitude that each term takes in the first half cycle."""
    return Oscillator(
        MASS,
        STIFFNESS,
        viscous * 2.0 * MASS * OMEGA / np.pi,
        friction * RELEASED * STIFFNESS / 2.0,
        quadratic * 0.75 * MASS / RELEASED,
    )


@pytest.mark.parametrize(
    "damping",
    [{"linear": 0.9}, {"friction": 0.0019}, {"quadratic": 5.0}, {"linear": 0.4, "friction": 0.001, "quadratic": 3.0}],
)
def test_motion_is_that_of_the_differential_equation(damping):
    """Started in mid motion, against DOP853 from turning point to turning point."""
    value = nonlinear_decay(TIME, OMEGA, 0.04, **damping)
    begin, near = 121, 1e-5
    around = nonlinear_decay(TIME[begin] + near * np.array([-1.0, 0.0, 1.0]), OMEGA, 0.04, **damping)
    rate = (around[2] - around[0]) / (2.0 * near)
    parameters = np.array(
        [
            OMEGA, 0.003, around[1] + 0.003, rate, 0.5 * damping.get("linear", 0.0), damping.get("friction", 0.0),
            damping.get("quadratic", 0.0), 0.0,
        ]
    )  # fmt: skip
    motion = ring_down(parameters[None], TIME[begin:], rate)
    np.testing.assert_allclose(motion.value[0] - 0.003, value[begin:], atol=3e-5)


def test_dry_friction_ends_the_motion_where_it_must():
    """Turning points of pure friction: every half cycle 2 F/k less, until the spring cannot move the mass."""
    motion = ring_down(np.array([[OMEGA, 0.0, 0.0, -0.04 * OMEGA, 0.0, 0.003, 0.0, 0.0]]), TIME, -1.0)
    turns = np.abs(motion.turn_m[0][np.isfinite(motion.turn_m[0])])
    np.testing.assert_allclose(-np.diff(turns), 0.006, rtol=1e-4)
    assert turns[-1] < 0.003 < turns[-2]
    assert motion.stick_s[0] == pytest.approx(motion.turn_s[0][np.isfinite(motion.turn_s[0])][-1])
    assert np.ptp(motion.value[0][motion.stick_s[0] < TIME]) < 1e-12


@pytest.mark.parametrize(
    "shares",
    [
        {"viscous": 0.25},
        {"friction": 0.15},
        {"quadratic": 0.3},
        {"viscous": 0.12, "friction": 0.08},
        {"viscous": 0.15, "quadratic": 0.15},
        {"friction": 0.1, "quadratic": 0.15},
        {"viscous": 0.1, "friction": 0.06, "quadratic": 0.2},
    ],
)
def test_kind_and_numbers(shares):
    true = oscillator(**shares)
    law = law_of(TIME, logged(true))
    assert law.terms == tuple(shares)
    assert law.damped_period == pytest.approx(true.damped_period, rel=0.003)
    found = {"viscous": law.log_decrement, "friction": law.friction_m, "quadratic": law.quadratic_per_m}
    wanted = {
        "viscous": true.damping / (2.0 * MASS) * true.damped_period,
        "friction": true.friction / STIFFNESS,
        "quadratic": true.quadratic / MASS,
    }
    sd = dict(zip(found, np.sqrt(np.diagonal(law.covariance))[1:], strict=True))
    for term in shares:
        assert found[term] == pytest.approx(wanted[term], rel=0.2)
        assert abs(found[term] - wanted[term]) < 4.0 * sd[term]
        assert sd[term] < 0.15 * wanted[term]
    assert law.shares.sum() == pytest.approx(1.0)


def test_a_mass_that_sticks_is_read_up_to_there_only():
    true = oscillator(friction=0.15)
    record = prepare_record(TIME, logged(true))
    law = fit_damping_law(record, from_release=True)
    turns = ring(true, RELEASED, TIME)[1]
    assert abs(law.model[-1] - law.level) == pytest.approx(abs(turns[-1]), abs=1.5e-4)
    reading = reading_of(without_sticking(record, law))
    assert reading.extremum_time_s[reading.used].max() < law.stick_time_s
    assert reading.used.sum() >= 3


def test_correlated_noise_is_no_damping():
    """Noise of first order, as a filter leaves it: the viscous record stays one, the intervals hold."""
    noise, random = np.zeros(TIME.size), np.random.default_rng(5)
    for i in range(1, TIME.size):
        noise[i] = 0.8 * noise[i - 1] + 3e-4 * random.standard_normal()
    law = law_of(TIME, damped_cosine(TIME, 0.6, 0.5) + noise)
    assert law.terms == ("viscous",)
    assert abs(law.log_decrement - 0.5) < 3.0 * np.sqrt(law.covariance[1, 1])


@pytest.mark.parametrize("gap", [None, (1.05, 1.2), (1.3, 1.5), (1.36, 1.76)])
def test_swings_across_a_gap_do_not_count(gap):
    """Half ranges of neighbouring turning points 0.04 exp(-delta n / 2) of a damped cosine, and its level."""
    value = damped_cosine(TIME, 0.6, 0.5, offset=0.005) + NOISE_M * np.random.default_rng(0).standard_normal(TIME.size)
    if gap is not None:
        value[np.abs(TIME - np.mean(gap)) < 0.5 * np.ptp(gap)] = np.nan
    record = prepare_record(TIME, value)
    window = decay_window(record)
    true = 0.02 * np.exp(-0.25 * np.arange(30)) * (1.0 + np.exp(-0.25))
    for swing in window.swings[:6]:
        assert np.abs(true / swing - 1.0).min() < 0.03
    np.testing.assert_array_less(np.diff(window.swings[:6]), 0.0)
    assert window.start[LEVEL] == pytest.approx(0.005, abs=3e-3)
    assert window.amplitude > 0.015


@pytest.mark.parametrize(
    "value",
    [np.zeros(TIME.size), 0.04 * np.exp(-8.0 * np.maximum(TIME - 0.5, 0.0)), np.where(TIME < 1.0, 0.04, 0.0)],
    ids=["rest", "creep", "step"],
)
def test_no_oscillation_has_no_kind(value):
    law = law_of(TIME, value + 2e-4 * np.random.default_rng(0).standard_normal(TIME.size))
    assert not law.usable
    assert law.kind == "unknown"
    assert law.note
    assert np.isnan(law.friction_m)
