"""The quarter car fitted to a decay: its motion against SciPy's integrators, its answers on made plank drops."""

from __future__ import annotations

import numpy as np
import pytest
from decay_oracles import damped_cosine
from scipy.integrate import solve_ivp

from studies.plank_drops.motion import Fall, QuarterCar, deflection
from sysid.sdof.decay import prepare_record
from sysid.sdof.decay_fit import _widths, fit_decay
from sysid.sdof.drop_results import DecayFit
from sysid.sdof.equations import eigenvalue_of_quarter_car, invert_quarter_car
from sysid.sdof.estimates import AxleOnTire, of_fit
from sysid.sdof.quarter_car import QuarterCars
from sysid.sdof.settings import DropSettings

CAR = {
    "mass": 3500.0,
    "unsprung": 600.0,
    "tire": 1.8e6,
    "tire_damping": 2500.0,
    "stiffness": 6e5,
    "damping": 9e3,
    "bend": 0.0,
    "cubic": 0.0,
    "asymmetry": 0.0,
    "quadratic": 0.0,
    "friction": 0.0,
    "slip": 2e-3,
}
TIME = np.arange(0.0, 2.0, 0.005)
START, STUCK = (-0.045, 0.1, -0.01, 0.2), -1.0


def integrated(car, start=START, method="DOP853"):
    """Extension (n,) by one of SciPy's integrators."""

    def rates(_, s):
        y, v, w, u, z = s
        force = car["stiffness"] * y * (1.0 + car["bend"] * y + car["cubic"] * y * y) + car["friction"] * z
        force += car["damping"] * v * (1.0 + car["asymmetry"] * np.sign(v)) + car["quadratic"] * abs(v) * v
        pull = min(car["tire"] * w + car["tire_damping"] * u, (car["mass"] + car["unsprung"]) * 9.81)
        wheel = (force - pull) / car["unsprung"]
        return [v, -force / car["mass"] - wheel, u, wheel, (v - abs(v) * z) / car["slip"]]

    first = [*start, STUCK]
    return solve_ivp(rates, (0.0, 2.0), first, method, t_eval=TIME, rtol=1e-8, atol=1e-10, max_step=2e-3).y[0]


def by_toolkit(car, start=START):
    arrays = {name: np.array([value]) for name, value in car.items()}
    return QuarterCars(**arrays, start=np.array(start)[:, None], stuck=np.array([STUCK])).extension(TIME)[0]


@pytest.mark.parametrize(
    "law",
    [
        {},
        {"friction": 3400.0, "slip": 1e-3},
        {"bend": -5.0, "cubic": 400.0},
        {"asymmetry": 0.5},
        {"quadratic": 2e4},
    ],
)
def test_motion_is_that_of_another_integrator(law):
    expected = integrated(CAR | law)
    np.testing.assert_allclose(by_toolkit(CAR | law), expected, atol=1e-7 if not law else 6e-5)
    if law:
        assert np.abs(by_toolkit(CAR) - expected).max() > 1e-3


@pytest.mark.parametrize("slip_m", [1e-3, 1e-4, 1e-5, 1e-6])
def test_friction_at_any_slip_length(slip_m):
    """Slip lengths far below what a step resolves: the motion is right, and smooth in the unknowns."""
    car = CAR | {"mass": 3580.0, "unsprung": 520.0, "damping": 3e3, "stiffness": 3.2e5, "friction": 9e2}
    expected = integrated(car | {"slip": slip_m}, method="LSODA")
    np.testing.assert_allclose(by_toolkit(car | {"slip": slip_m}), expected, atol=1.2e-4)

    def slope(share):
        return (
            by_toolkit(car | {"slip": slip_m, "damping": 3e3 * (1.0 + share)}) - by_toolkit(car | {"slip": slip_m})
        ) / share

    by_large, by_small = slope(1e-3), slope(1e-6)
    np.testing.assert_allclose(by_small, by_large, atol=0.05 * np.abs(by_large).max())


def test_a_tire_never_pulls():
    hops = (-0.045, 0.1, 0.03, 0.5)
    expected = integrated(CAR, hops)
    np.testing.assert_allclose(by_toolkit(CAR, hops), expected, atol=2e-4)
    assert np.abs(by_toolkit(CAR | {"mass": 1e9}, hops) - expected).max() > 1e-2


def test_eigenvalue_and_inversion_are_inverse():
    on_tire = (3500.0, 600.0, 1.8e6, 2500.0)
    pole = eigenvalue_of_quarter_car(6e5, 9e3, *on_tire)
    assert invert_quarter_car(pole, *on_tire) == pytest.approx((6e5, 9e3), rel=1e-9)


def fitted(car, beats=(2.15, 0.0)):
    """The fit to a noisy drop of a car whose masses and tire are declared as they are."""
    time = np.arange(0.0, 4.0, 0.005)
    made = QuarterCar(3500.0, 600.0, 1.8e6, 2500.0, 6e5, beat_hz=beats[0], beat_share=beats[1], **car)
    value = deflection(made, Fall(0.5, 0.06, rolls=False), time)
    value = value + 2.5e-4 * np.random.default_rng(3).standard_normal(time.size)
    record = prepare_record(time, value, frequency_range_hz=(0.6, 6.0), skip_first_turn=True)
    return fit_decay(record, AXLE, DropSettings())


AXLE = AxleOnTire(0, "empty", 3500.0, 600.0, 1.8e6, 2500.0, leaf=True)


@pytest.mark.parametrize(
    ("car", "element"),
    [
        ({"damping": 9e3}, ""),
        ({"damping": 9e3, "friction": 1717.0, "slip_m": 1e-3}, "friction"),
        ({"damping": 2e3, "friction": 3433.0, "slip_m": 2e-3}, "friction"),
        ({"damping": 9e3, "friction": 1717.0, "slip_m": 6e-3}, "friction"),
        ({"damping": 9e3, "knee_m": 0.05}, "progressive"),
        ({"damping": 6e3, "in_compression": 0.25}, "asymmetric"),
    ],
)
def test_drops_as_they_are(car, element):
    fit = fitted(car)
    k_sd, c_sd = np.sqrt(np.diagonal(fit.covariance))
    assert abs(fit.stiffness - 6e5) < 2.0 * k_sd < 0.08 * 6e5
    assert abs(fit.damping - car["damping"]) < 2.0 * c_sd < 0.25 * car["damping"]
    assert {e for e, p in fit.probability.items() if p > 0.9 and e != "mode"} == ({element} if element else set())
    if element == "friction":
        force, sd = fit.friction_force
        assert abs(force - car["friction"]) < 3.0 * sd < 0.3 * force
        assert fit.slip_m[0] == pytest.approx(car["slip_m"], rel=0.15)
        row = of_fit(fit, AXLE, None)
        assert row.damping_kind == "viscous + friction"
        assert "dry friction of" in row.note


def test_two_modes_of_one_strength_tell_no_stiffness():
    time = np.arange(0.0, 4.0, 0.005)
    value = damped_cosine(time, 1 / 1.8, 0.38, 0.02) + damped_cosine(time, 1 / 2.15, 0.38, 0.018)
    value = value + 2.5e-4 * np.random.default_rng(1).standard_normal(time.size)
    fit = fit_decay(
        prepare_record(time, value, frequency_range_hz=(0.6, 6.0), skip_first_turn=True), AXLE, DropSettings()
    )
    row = of_fit(fit, AXLE, None)
    assert not row.usable
    assert "stiffness cannot be told" in row.note
    assert "a further mode at" in row.note
    weak = fitted({"damping": 9e3}, beats=(2.6, 0.1))
    row = of_fit(weak, AXLE, None)
    assert row.usable
    assert abs(row.stiffness - 6e5) < 2.0 * row.stiffness_sd


def test_what_no_quarter_car_does_is_refused():
    time = np.arange(0.0, 6.0, 0.005)
    value = np.where(time < 2.6, damped_cosine(time, 0.6, 0.3), damped_cosine(time, 0.6, 0.3, release_s=2.7))
    value = value + 2.5e-4 * np.random.default_rng(1).standard_normal(time.size)
    found = fit_decay(prepare_record(time, value, skip_first_turn=True), AXLE, DropSettings())
    assert isinstance(found, str)
    assert "of the motion unexplained" in found
    assert isinstance(fitted({"damping": 9e3}), DecayFit)


def test_widths_hold_nine_tenths_of_a_mixture():
    sd = np.array([[1.0, 2.0], [1.0, 2.0]])
    near = np.zeros((2, 2))
    np.testing.assert_allclose(_widths(near, sd, np.array([0.7, 0.3])), [1.0, 2.0], rtol=1e-3)
    far = np.array([[0.0, 0.0], [50.0, 50.0]])
    wide = _widths(far, sd, np.array([0.7, 0.3]))
    draws = np.random.default_rng(0).standard_normal(200_000) + 50.0 * (np.random.default_rng(1).random(200_000) < 0.3)
    assert np.mean(np.abs(draws) < 1.6449 * wide[0]) == pytest.approx(0.9, abs=0.003)
    np.testing.assert_allclose(_widths(far, sd, np.array([0.999, 0.001])), [1.0, 2.0], rtol=5e-3)
