"""The golden car over a measured road: International Roughness Index against the published one.

Road in, suspension motion out, at 80 km/h: a quarter car with k_t / m_s = 653 1/s2, k / m_s = 63.3 1/s2, c / m_s =
6 1/s and m_u / m_s = 0.15 (M. W. Sayers, Transportation Research Record 1501, 1995).  The index is the mean of the
absolute suspension rate over the distance.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sysid.campaign.vehicle_records import Axle, Body, LoadCase, Vehicle
from sysid.errors import SysidError
from sysid.vehicle_model.assembly import assemble
from sysid.vehicle_model.contact import road_input, tire_law
from sysid.vehicle_model.motion import Motion
from sysid.vehicle_model.point_contact import measured_road
from sysid.vehicle_model.simulation import simulate_histories, stage_times
from sysid.vehicle_model.stacked_matrices import stack_matrices
from sysid.vehicle_model.suspension import SuspensionLaw

DATA = Path(__file__).resolve().parents[1] / "data" / "iri"
SPEED_M_S = 80 / 3.6
LEAD_M = 120.0
STEP_S = 0.001
SPRUNG_KG = 1000.0
SEGMENT_M, SEGMENTS = 20.0, 27


def segment_indices(file: str, footprint_m: float) -> np.ndarray:
    """Index of every segment [m/km]."""
    s, z = np.loadtxt(DATA / file).T
    axle = Axle("axle", 0, 0.0, 0.15 * SPRUNG_KG, 653 * SPRUNG_KG, 0.0, 0.3, "other")
    load = LoadCase("golden car", (1.15 * SPRUNG_KG,), (SPRUNG_KG,), (1e3,), (0.3,))
    matrices = assemble(Vehicle("golden car", (Body("body"),), (axle,)), load)
    # The golden car's tire is a spring in both directions: preloaded a hundredfold it never leaves the road.
    stacked = stack_matrices([replace(matrices, static_load=100.0 * matrices.static_load)], [])
    road = measured_road(s, z, 1, footprint_m=footprint_m, lead_m=LEAD_M)
    samples = int((s[-1] - s[0] + LEAD_M) / SPEED_M_S / STEP_S)

    def one(value: float) -> jax.Array:
        return jnp.full((1, 1, 1), value)

    @jax.jit
    def run():
        tire = tire_law(one(653 * SPRUNG_KG), one(0.0), 1.0, stacked.static_load, stacked.static_load)._replace(
            growth=0.0
        )
        motion = Motion(jnp.full((1, 1), SPEED_M_S), jnp.zeros((1, 1)))
        position = s[0] - LEAD_M + SPEED_M_S * stage_times(samples, STEP_S, 1)
        inputs = road_input(road, position[:, None, None, None])
        suspension = SuspensionLaw(one(63.3 * SPRUNG_KG), one(6.0 * SPRUNG_KG))
        return simulate_histories(stacked, suspension, tire, motion, inputs, interval_s=STEP_S, substeps=1)

    histories = run()
    assert float(histories.tire_force.min()) > 0.0
    stroke = np.abs(np.diff(np.asarray(histories.deflection)[:, 0, 0, 0]))
    place = s[0] - LEAD_M + SPEED_M_S * STEP_S * np.arange(samples)
    travelled = np.interp(s[0] + SEGMENT_M * np.arange(SEGMENTS + 1), place, np.concatenate([[0.0], stroke.cumsum()]))
    return 1e3 * np.diff(travelled) / SEGMENT_M


def test_index_of_the_measured_profile():
    """Sampled every 250 mm, the profile is its own 250 mm average: nothing is averaged once more."""
    found = segment_indices("profile_1.txt", 0.0)
    assert found.mean() == pytest.approx(3.309, abs=0.005)
    # How the car comes onto the first segment is a matter of convention.
    np.testing.assert_allclose(found[:5], [3.6708, 3.9429, 4.3714, 2.6238, 1.8837], rtol=0.015)


def test_index_of_the_same_road_at_irregular_stations():
    assert segment_indices("profile_2.txt", 0.25).mean() == pytest.approx(3.1062, rel=0.005)


def spline_value(road, station: np.ndarray) -> np.ndarray:
    place = np.tile(station[:, None, None, None], (1, 1, road.rise.shape[1], 1))
    return np.asarray(road_input(road, jnp.asarray(place)).rise)[:, 0, -1, 0]


def test_average_over_the_footprint():
    """A ramp stays a ramp, a kink becomes the parabola (x + b/2)^2 / 2 b of the averaged slope."""
    s = np.array([0.0, 3.0, 6.0])
    road = measured_road(s, np.array([1.0, 1.0, 1.3]), 2, footprint_m=0.4)
    assert road.rise.shape[:2] == (1, 2)
    x = np.linspace(2.85, 3.15, 7)
    np.testing.assert_allclose(spline_value(road, x), 0.1 * (x - 3.0 + 0.2) ** 2 / 0.8, atol=1e-9)
    np.testing.assert_allclose(spline_value(road, np.array([4.0, 5.0])), [0.1, 0.2], atol=1e-9)
    np.testing.assert_allclose(spline_value(road, np.array([1.0, 2.5])), 0.0, atol=1e-9)


def test_lead_goes_on_with_the_slope_of_the_first_metres():
    s = np.arange(0.0, 30.0, 0.5)
    road = measured_road(s, 2.0 + 0.02 * s, 1, lead_m=10.0)
    np.testing.assert_allclose(spline_value(road, np.array([-8.0, 0.0, 20.0])), 0.02 * np.array([2.0, 10.0, 30.0]))


@pytest.mark.parametrize(
    ("station", "height", "words"),
    [
        ([0.0], [1.0], "two points or more"),
        ([0.0, 1.0], [1.0], "two points or more"),
        ([0.0, 2.0, 1.0], [0.0, 0.0, 0.5], r"Point 3 of the measured road \(1 m, 0.5 m\)"),
        ([0.0, 1.0, 2.0], [0.0, np.nan, 0.0], "Point 2"),
    ],
)
def test_roads_that_are_none_are_refused(station, height, words):
    with pytest.raises(SysidError, match=words):
        measured_road(np.array(station), np.array(height), 1)
