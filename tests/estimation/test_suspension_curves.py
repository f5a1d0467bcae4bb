"""Declared curves become ramps: tables against interpolation, stops and lash against their definition."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from rigid_truck import AXLES

from sysid.campaign.vehicle_records import ForceTable, LeafDimensions
from sysid.estimation.parameters.campaign_parameters import leaf_pack_stiffness
from sysid.estimation.parameters.suspension_curves import (
    helper_ramps,
    joined_stops,
    lash_ramps,
    stop_ramps,
    suspension_curves,
    table_ramps,
)
from sysid.estimation.parameters.suspension_elements import NO_STOP_M
from sysid.vehicle_model.suspension import SuspensionLaw, damper_force, spring_force

EXTENSION = (-0.08, -0.05, -0.02, 0.03, 0.07)
FORCE_N = (-90e3, -40e3, -9e3, 13.5e3, 20e3)
RATE = (-1.0, -0.3, 0.0, 0.2, 1.0)
DAMPING_N = (-6e3, -3e3, 0.0, 5e3, 12e3)
SPRING = replace(AXLES[0], spring_table=ForceTable(EXTENSION, FORCE_N), damper_table=ForceTable(RATE, DAMPING_N))
TABLES = frozenset({"spring_table", "damper_table"})
LOADS = np.array([[20e3], [28e3]])  # the second pass carries 8 kN more than the first load case


@pytest.fixture(scope="module")
def curves():
    return suspension_curves([SPRING], [TABLES], LOADS, np.array([[20e3], [20e3]]))


def column(value: float) -> jnp.ndarray:
    return jnp.full((2, 1, 1), value)


def test_a_spring_table_is_interpolated_and_scaled(curves):
    """k is the slope at rest of the first load case; twice that slope is twice the table."""
    slope = (FORCE_N[3] - FORCE_N[2]) / (EXTENSION[3] - EXTENSION[2])
    for factor in (1.0, 2.0):
        k = column(factor * slope)
        law = SuspensionLaw(k * curves.spring.share, column(0.0), ramps=table_ramps(curves.spring, k))
        for e in np.linspace(-0.05, 0.06, 23):
            force = np.asarray(spring_force(law, column(e)))[:, 0, 0]
            assert force[0] == pytest.approx(factor * np.interp(e, EXTENSION, FORCE_N), abs=1e-6)


def test_a_heavier_load_rests_further_down_the_table(curves):
    rest = np.interp(-8e3, FORCE_N, EXTENSION)
    slope = (FORCE_N[3] - FORCE_N[2]) / (EXTENSION[3] - EXTENSION[2])
    k = column(slope)
    law = SuspensionLaw(k * curves.spring.share, column(0.0), ramps=table_ramps(curves.spring, k))
    for e in (-0.05, -0.01, 0.0, 0.02, 0.06):
        expected = np.interp(rest + e, EXTENSION, FORCE_N) + 8e3
        assert np.asarray(spring_force(law, column(e)))[1, 0, 0] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("travel", [0.03, 0.01])
def test_helper_leaves_act_from_a_compression_on_and_a_heavier_load_rests_nearer_or_beyond(travel):
    """Against the curve of both leaves from rest in the first load case, turned over numerically for 8 kN more."""
    k, helper = 4e5, 9e5
    grid = np.linspace(-0.2, 0.2, 400001)
    curve = k * grid - helper * np.maximum(0.0, -travel - grid)
    slope, ramp = helper_ramps(column(helper), column(travel), column(k), np.array([0.0, 8e3])[:, None, None])
    law = SuspensionLaw(slope, column(0.0), ramps=ramp)
    for number, more in enumerate((0.0, 8e3)):
        rest = np.interp(-more, curve, grid)
        for e in np.linspace(-0.08, 0.08, 33):
            expected = np.interp(rest + e, grid, curve) + more
            assert np.asarray(spring_force(law, column(e)))[number, 0, 0] == pytest.approx(expected, abs=1.0)
    # 8 kN compress the main leaves by 20 mm.
    assert slope[1, 0, 0] == pytest.approx(k if travel == 0.03 else k + helper)


def test_a_damper_table_is_scaled_to_its_secant_at_half_a_metre_per_second(curves):
    secant = (np.interp(0.5, RATE, DAMPING_N) - np.interp(-0.5, RATE, DAMPING_N)) / 1.0
    c = column(1.5 * secant)
    law = SuspensionLaw(column(0.0), c * curves.damper.share, rate_ramps=table_ramps(curves.damper, c))
    for v in np.linspace(-0.9, 0.9, 19):
        force = float(damper_force(law, column(v))[0, 0, 0])
        assert force == pytest.approx(1.5 * np.interp(v, RATE, DAMPING_N), abs=1e-6)


def test_tables_go_on_with_their_last_slope():
    """A damper tested to 0.3 m/s: c is the secant at 0.5 m/s of what is simulated; a load beyond the spring table."""
    axle = replace(
        AXLES[0],
        spring_table=ForceTable((-0.01, 0.0, 0.01), (-6e3, 0.0, 3e3)),
        damper_table=ForceTable((-0.3, 0.0, 0.3), (-3e3, 0.0, 3e3)),
    )
    found = suspension_curves([axle], [TABLES], np.array([[32e3]]), np.array([[20e3]]))
    c = jnp.full((1, 1, 1), 1e4)
    law = SuspensionLaw(0.0 * c, c * found.damper.share, rate_ramps=table_ramps(found.damper, c))
    for v in (-0.5, 0.1, 0.5):
        assert float(damper_force(law, jnp.full((1, 1, 1), v))[0, 0, 0]) == pytest.approx(1e4 * v, abs=1e-6)
    # 12 kN more rest 20 mm lower on the steep branch; the corner at zero is then 20 mm of extension away.
    assert float(found.spring.share[0, 0, 0]) == pytest.approx(2.0, rel=1e-12)
    assert float(found.spring.at[0, 0, 0, 0]) == pytest.approx(0.02, rel=1e-12)


def test_stops_act_beyond_the_declared_travel_alone():
    axle = replace(AXLES[0], rebound_travel_m=0.06, jounce_travel_m=0.09)
    found = suspension_curves([axle], [frozenset({"bump_stops"})], LOADS, LOADS)
    law = SuspensionLaw(column(0.0), column(0.0), ramps=stop_ramps(found.stops, column(2e6)))
    for e in (-0.09, 0.0, 0.06):
        assert float(spring_force(law, column(e))[0, 0, 0]) == pytest.approx(0.0, abs=1e-6)
    # F = k d (1 + d / 15 mm): met where the straight pieces do, a chord of h is off by at most k h^2 / (4 l) between.
    for d in np.linspace(0.001, 0.016, 16):
        force = 2e6 * d * (1.0 + d / 0.015)
        for e, sign in ((0.06 + d, 1.0), (-0.09 - d, -1.0)):
            found_N = sign * float(spring_force(law, column(e))[0, 0, 0])
            exact = any(abs(d - knot) < 1e-9 for knot in (0.006, 0.014))
            assert found_N == pytest.approx(
                force, rel=1e-9 if exact else 0.0, abs=0.0 if exact else 2e6 * 0.008**2 / (4.0 * 0.015) + 1e-3
            )


def test_estimated_travels_act_as_declared_ones_and_beside_them():
    axles = [replace(AXLES[0], rebound_travel_m=0.06, jounce_travel_m=0.09), AXLES[1]]
    declared = suspension_curves(axles, [frozenset({"bump_stops"}), frozenset()], *(np.tile(LOADS, 2),) * 2).stops
    never = NO_STOP_M * np.ones((2, 1, 1))
    jounce, rebound = (np.concatenate([never, v * np.ones((2, 1, 1))], axis=1) for v in (0.05, 0.04))
    both = np.asarray(joined_stops(declared, jnp.asarray(jounce), jnp.asarray(rebound)))
    np.testing.assert_array_equal(both[:, 0, :, 0], [[0.06, 0.04], [-0.09, -0.05]])
    alone = np.asarray(joined_stops(None, jnp.asarray(jounce), jnp.asarray(rebound)))
    np.testing.assert_array_equal(alone[:, 1, :, 0], [[NO_STOP_M, 0.04], [-NO_STOP_M, -0.05]])


def test_a_slack_hanger_carries_nothing_until_it_has_moved():
    """The spring pulls with its static load from k e = P on, through the lash, and goes on behind it."""
    k, load, lash = 5e5, 2e4, 0.012
    ramps = lash_ramps(np.full((2, 1, 1), lash), column(k), np.full((2, 1, 1), load))
    law = SuspensionLaw(column(k), column(0.0), ramps=ramps)
    for e, force in ((-0.01, -5e3), (0.04, load), (0.045, load), (0.052, load), (0.062, load + 5e3)):
        assert float(spring_force(law, column(e))[0, 0, 0]) == pytest.approx(force, abs=1e-6)


def test_leaf_formula_of_a_single_leaf_is_a_simple_beam():
    """One leaf of uniform strength bends 3/2 as much as the uniform beam of 48 E I / L^3."""
    leaf = LeafDimensions(1, 0.09, 0.015, 1.4)
    beam = 48.0 * 2.06e11 * (0.09 * 0.015**3 / 12.0) / 1.4**3
    assert leaf_pack_stiffness(leaf) == pytest.approx(2.0 * beam * 2.0 / 3.0)
