"""Modes of the calibrated truck: which values of the fit and the posterior they are made of."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from small_results import small_fit, small_results

from sysid.campaign.records import PredictionRequest
from sysid.campaign.vehicle_records import ForceTable
from sysid.estimates.calibrated_truck_modes import calibrated_modes
from sysid.vehicle_model.contact import RoadInput, contact_force, tire_law
from sysid.vehicle_model.vibration_modes import natural_modes


@pytest.mark.parametrize("growth", [(), (0.0, 0.3)])
def test_every_load_case_has_its_own_stiffness_and_tire_tangent(growth):
    """The tire's tangent and damping at rest by differences of the contact force itself."""
    results = small_results()
    vehicle, cases = results.campaign.vehicle, results.campaign.load_cases
    exponent = replace(small_fit().parameters[0], name="tire_exponent", quantity="tire_exponent", axle=None, value=1.3)
    fit = small_fit(parameters=(*small_fit().parameters, exponent), tire_growth=growth)
    empty, laden = calibrated_modes(results.campaign, fit, None)

    def column(v):
        return jnp.asarray(np.array(v, float)[None, :, None])

    load, reference = (column(cases[n].axle_loads_kg) * 9.81 for n in ("laden", "empty"))
    law = tire_law(column([1.6e6, 2.9e6]), column([3e3, 3e3]), 1.3, load, reference)
    law = law._replace(growth=column(growth)) if growth else law
    flat = RoadInput(*(jnp.zeros((1, 2, 1)),) * 5)

    def force(rise, rate):
        zero = jnp.zeros((1, 2, 1))
        return np.asarray(contact_force(law, flat, zero, zero, zero + rise, zero + rate)[0])[0, :, 0]

    step = 1e-6
    tangent = (force(-step, 0.0) - force(step, 0.0)) / (2 * step)
    damping = (force(0.0, -step) - force(0.0, step)) / (2 * step)
    expected = natural_modes(vehicle, cases["laden"], [4.2e5, 7.0e5], [1.1e4, 9.0e3], tangent, damping)
    np.testing.assert_allclose(laden.frequency_hz, expected.frequency_hz, rtol=1e-7)
    np.testing.assert_allclose(laden.damping_ratio, expected.damping_ratio, rtol=1e-7)
    declared = natural_modes(vehicle, cases["empty"], [4.2e5, 4.0e5], [1.1e4, 9.0e3], [1.6e6, 2.9e6], [3e3, 3e3])
    np.testing.assert_allclose(empty.frequency_hz, declared.frequency_hz, rtol=1e-12)


def test_posterior_medians_come_before_least_squares():
    results = small_results()
    summaries = tuple(replace(s, q50=2.0 * s.q50 if s.name == "k_1" else s.q50) for s in results.posterior.summaries)
    doubled = replace(results.posterior, summaries=summaries)
    one, two = (calibrated_modes(results.campaign, results.fit, p)[0] for p in (results.posterior, doubled))
    values = {s.name: s.q50 for s in summaries}
    expected = natural_modes(
        results.campaign.vehicle,
        results.campaign.load_cases["empty"],
        [values["k_1"], values["k_2[empty]"]],
        [values["c_1"], values["c_2"]],
        [values["kt_1"], 2.9e6],
        [3e3, 3e3],
    )
    np.testing.assert_allclose(two.frequency_hz, expected.frequency_hz, rtol=1e-12)
    assert two.frequency_hz.max() != pytest.approx(one.frequency_hz.max(), rel=1e-3)


def test_a_load_case_without_a_stiffness_is_left_out():
    results = small_results()
    fit = small_fit(parameters=tuple(p for p in small_fit().parameters if p.load_case != "laden"))
    assert [m.load_case.name for m in calibrated_modes(results.campaign, fit, None)] == ["empty"]


def test_a_progressive_leaf_counts_with_its_slope_under_the_load():
    """1 MN/m up to 20 mm of compression and 2.5 MN/m beyond, where the laden truck rests."""
    results = small_results()
    axles = results.campaign.vehicle.axles
    table = ForceTable((-0.1, -0.001, 0.0, 0.1), (-248.5e3, -1e3, 0.0, 1e5))
    leaf = replace(axles[0], suspension_law="spring_table", spring_table=table)
    vehicle = replace(results.campaign.vehicle, axles=(leaf, *axles[1:]))
    # The laden truck is in use.
    campaign = replace(results.campaign, vehicle=vehicle, predictions=(PredictionRequest("laden", 9.0),))
    parameters = small_fit().parameters
    fit = small_fit(
        parameters=tuple(
            replace(p, law="spring_table") if p.axle == 0 and p.quantity in ("stiffness", "damping") else p
            for p in parameters
        )
    )
    empty, laden = calibrated_modes(campaign, fit, None)
    linear_empty, linear_laden = calibrated_modes(results.campaign, small_fit(), None)
    np.testing.assert_allclose(empty.frequency_hz, linear_empty.frequency_hz, rtol=1e-6)
    stiffer = small_fit(
        parameters=tuple(replace(p, value=2.5 * p.value) if p.name == "k_1" else p for p in small_fit().parameters)
    )
    np.testing.assert_allclose(
        laden.frequency_hz, calibrated_modes(results.campaign, stiffer, None)[1].frequency_hz, rtol=1e-6
    )
    assert (laden.frequency_hz > linear_laden.frequency_hz).any()
