"""The calibrated vehicle for other programs against closed forms and differences of the simulated force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigid_truck import AXLES, DAMPING, EMPTY, EXPONENT, LADEN, STIFFNESS, VEHICLE, campaign, empty_run
from small_results import small_fit

from sysid.estimates.calibrated import calibrated_vehicle
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.parameters.estimate import ParameterEstimate
from sysid.posterior.sampled_posterior import Posterior, PosteriorSummary
from sysid.vehicle_model.contact import RoadInput, contact_force, tire_law

G = 9.81
FRICTION, PROGRESSIVITY, ASYMMETRY = 2200.0, 0.9, 1.8
KNOWN = {"friction": FRICTION, "progressivity": PROGRESSIVITY, "damper_asymmetry": ASYMMETRY, "tire_exponent": EXPONENT}


def known_fit(data):
    """A fit whose parameters are the known ones."""
    estimates = []
    for p in campaign_parameters(data, None).parameters:
        value = {"stiffness": STIFFNESS, "damping": DAMPING}.get(p.quantity)
        if value is not None:
            number = value[p.axle] * (1.6 if p.load_case == "laden" else 1.0)
        elif p.quantity == "tire_stiffness":
            number = AXLES[p.axle].tire_stiffness_N_per_m
        elif p.quantity == "tire_damping":
            number = AXLES[p.axle].tire_damping_N_s_per_m
        else:
            number = KNOWN.get(p.quantity, p.start)
        estimates.append(
            ParameterEstimate(
                p.name, p.quantity, p.unit, p.axle, p.load_case, None, p.law, "log", float(number), 1.0, p.start,
                p.prior_median, p.prior_sd, True,
            )
        )  # fmt: skip
    return small_fit(parameters=tuple(estimates))


def truck(*laws):
    axles = tuple(replace(a, suspension_law=law) for a, law in zip(AXLES, laws, strict=True))
    runs = [empty_run("a.csv", 6.0), empty_run("b.csv", 6.0, load_case="laden")]
    return campaign(runs, load_cases=(EMPTY, LADEN), vehicle=replace(VEHICLE, axles=axles))


@pytest.fixture(scope="module")
def linear():
    data = truck(None, None, None)
    return data, known_fit(data)


@pytest.mark.parametrize(("case", "factor"), [("empty", 1.0), ("laden", 1.6)])
def test_linear_values_by_load_case(linear, case, factor):
    data, fit = linear
    vehicle = calibrated_vehicle(data, None, fit, None, case)
    assert vehicle.source == "least squares"
    own = [factor if a.load_dependent else 1.0 for a in AXLES]
    np.testing.assert_allclose([s.stiffness_N_per_m for s in vehicle.suspensions], STIFFNESS * own, rtol=1e-6)
    np.testing.assert_allclose([s.damping_N_s_per_m for s in vehicle.suspensions], DAMPING, rtol=1e-12)
    assert all(s.linear for s in vehicle.suspensions)
    loads = np.array(data.load_cases[case].axle_loads_kg) - [a.unsprung_mass_kg for a in AXLES]
    np.testing.assert_allclose([s.static_load_N for s in vehicle.suspensions], G * loads, rtol=1e-9)


def test_posterior_medians_take_the_place_of_least_squares(linear):
    data, fit = linear
    summaries = tuple(PosteriorSummary(p.name, 0.0, 0.0, 0.0, 1.1 * p.value, 0.0, 1e3, 1.0) for p in fit.parameters)
    none = np.empty(0)
    posterior = Posterior(fit.names, none, none, 0, 1, none, none, summaries, True, False, "", "", 0)
    vehicle = calibrated_vehicle(data, None, fit, posterior, "empty")
    assert vehicle.source == "posterior median"
    np.testing.assert_allclose([s.stiffness_N_per_m for s in vehicle.suspensions], 1.1 * STIFFNESS, rtol=1e-6)


def test_values_are_taken_by_name(linear):
    """In whatever order the fit names them; what it does not name has its value before the fit."""
    data, fit = linear
    expected = calibrated_vehicle(data, None, fit, None, "laden")
    others = tuple(p for p in reversed(fit.parameters) if p.name != "kt_3")
    found = calibrated_vehicle(data, None, replace(fit, parameters=others), None, "laden")
    np.testing.assert_array_equal(
        [(s.stiffness_N_per_m, s.damping_N_s_per_m) for s in found.suspensions],
        [(s.stiffness_N_per_m, s.damping_N_s_per_m) for s in expected.suspensions],
    )
    np.testing.assert_allclose(found.tire_stiffness_N_per_m, expected.tire_stiffness_N_per_m, rtol=1e-12)


@pytest.mark.parametrize("case", [EMPTY, LADEN])
@pytest.mark.parametrize("growth", [(), (0.0, 0.3, 1.0)])
def test_tire_values_are_the_tangents_of_the_contact_force(linear, case, growth):
    data, fit = linear
    fit = replace(fit, tire_growth=growth)
    vehicle = calibrated_vehicle(data, None, fit, None, case.name)

    def arrays(values):
        return np.array(values, dtype=float).reshape(1, 3, 1)

    law = tire_law(
        arrays([a.tire_stiffness_N_per_m for a in AXLES]),
        arrays([a.tire_damping_N_s_per_m for a in AXLES]),
        np.array([EXPONENT]),
        G * arrays(case.axle_loads_kg),
        G * arrays(EMPTY.axle_loads_kg),
    )
    law = law._replace(growth=arrays(growth)) if growth else law
    zero = np.zeros((1, 3, 1))
    flat = RoadInput(zero, zero, zero, zero, zero)

    def force(rise, rate):
        return np.asarray(contact_force(law, flat, zero, zero + 5.0, zero + rise, zero + rate)[0])[0, :, 0]

    np.testing.assert_allclose(force(0.0, 0.0), G * np.array(case.axle_loads_kg), rtol=1e-12)
    step = 1e-6
    np.testing.assert_allclose(
        vehicle.tire_stiffness_N_per_m, (force(-step, 0.0) - force(step, 0.0)) / (2 * step), rtol=1e-6
    )
    np.testing.assert_allclose(vehicle.tire_damping_N_s_per_m, (force(0.0, -0.1) - force(0.0, 0.1)) / 0.2, rtol=1e-9)


def test_curves_of_richer_laws():
    data = truck("friction", "gas_spring", "asymmetric_damper")
    fit = known_fit(data)
    vehicle = calibrated_vehicle(data, None, fit, None, "empty")
    leaf, air, other = vehicle.suspensions
    assert not any(s.linear for s in vehicle.suspensions)
    assert leaf.friction_N == pytest.approx(FRICTION)
    rate, force = leaf.damper_with_friction()
    one = DAMPING[0] + FRICTION
    np.testing.assert_allclose(np.interp([-1.0, 0.0, 1.0], rate, force), [-one, 0.0, one], atol=1e-6)
    length = air.static_load_N / (STIFFNESS[1] * PROGRESSIVITY)
    (stiffening,) = (p.value for p in fit.parameters if p.quantity == "stroke_stiffening")
    inside = 1.0 + air.extension_m / length > 0.05
    e = air.extension_m
    expected = STIFFNESS[1] * e * (1.0 / (1.0 + e / length) + stiffening * (e / 0.1) ** 2)
    np.testing.assert_allclose(air.spring_force_N[inside], expected[inside], rtol=1e-9)
    assert air.stiffness_N_per_m == pytest.approx(STIFFNESS[1], rel=1e-6)
    # c is the mean secant of both directions at 0.5 m/s, whatever the asymmetry.
    assert other.damping_N_s_per_m == pytest.approx(DAMPING[2], rel=1e-9)
    fast = np.interp([0.5, -0.5], other.rate_m_s, other.damper_force_N)
    assert fast[0] / -fast[1] == pytest.approx(ASYMMETRY, rel=1e-9)


def test_corners_of_a_law_are_points_of_its_curve():
    axles = tuple(replace(a, suspension_law="bump_stops", jounce_travel_m=0.0507, rebound_travel_m=0.05) for a in AXLES)
    runs = [empty_run("a.csv", 6.0), empty_run("b.csv", 6.0, load_case="laden")]
    data = campaign(runs, load_cases=(EMPTY, LADEN), vehicle=replace(VEHICLE, axles=axles))
    fit = known_fit(data)
    stop = next(p.value for p in fit.parameters if p.quantity == "stop_stiffness")
    steer = calibrated_vehicle(data, None, fit, None, "empty").suspensions[0]
    assert not steer.linear
    # The jounce stop is a new point, the rebound stop stands on the grid and is there once.
    assert np.diff(steer.extension_m).min() > 1e-6

    def stopped(travel: np.ndarray) -> np.ndarray:
        # The straight pieces of F = k d (1 + d / 15 mm) between 0, 6 and 14 mm, and its tangent's slope beyond.
        curve = [0.0, 0.006 * 1.4, 0.014 * (1.0 + 14.0 / 15.0)]
        beyond = np.maximum(travel - 0.014, 0.0) * (1.0 + 28.0 / 15.0)
        return stop * (np.interp(travel, [0.0, 0.006, 0.014], curve) + beyond)

    expected = STIFFNESS[0] * steer.extension_m + stopped(steer.extension_m - 0.05)
    expected -= stopped(-steer.extension_m - 0.0507)
    np.testing.assert_allclose(steer.spring_force_N, expected, rtol=1e-9, atol=1e-6)
    for corner in (0.05, 0.056, 0.064, -0.0507, -0.0567, -0.0647):
        assert np.abs(steer.extension_m - corner).min() < 1e-9


def test_table_of_a_calibrated_vehicle(linear):
    data, fit = linear
    table = calibrated_vehicle(data, None, fit, None, "laden").summary()
    assert list(table["axle"]) == [1, 2, 3]
    np.testing.assert_allclose(table["damping_N_s_per_m"], DAMPING, rtol=1e-12)
