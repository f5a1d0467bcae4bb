"""Footprint maps about the paths of wheels over edges, against the springs themselves."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.road.enveloping import (
    FootprintMap,
    footprint_map,
    footprint_map_about,
    load_on_spokes,
    spoke_table,
    static_deflection,
)
from sysid.road.road_profile import RoadProfile

RADIUS, LOAD, STIFFNESS, EXPONENT = 0.5, 40e3, 1.6e6, 0.7


def edged(name: str) -> RoadProfile:
    station = np.arange(0.0, 3.2, 0.002)
    height = np.zeros_like(station)
    if name == "plank":
        height[(station > 1.2) & (station < 1.35)] = 0.04
    elif name == "hole":
        height[(station > 1.2) & (station < 1.7)] = -0.05
    else:
        height[(station > 1.2) & (np.mod(station - 1.2, 0.12) < 0.1) & (station < 2.4)] = 0.018
    return RoadProfile(name, station, height, np.zeros_like(height), 0.0, float(station[-1]))


@pytest.mark.parametrize("name", ["plank", "hole", "cobbles"])
def test_loads_along_a_path_are_those_of_the_springs(name):
    """A path up and down about the height at rest, now and then off the road; the wheel within 3 mm of it."""
    profile = edged(name)
    table = spoke_table(profile, RADIUS, exponent=EXPONENT)
    rest = static_deflection(table, LOAD, STIFFNESS)
    stiffness = LOAD / np.interp(rest, table.deflection_m, table.flat_force)
    random = np.random.default_rng(2)
    path = RADIUS - rest + 0.035 * np.sin(2.0 * np.pi * table.station_m / 0.9 + random.uniform(0.0, 6.0))
    height = path + random.uniform(-3e-3, 3e-3, path.size)
    shown = slice(None, None, 3)
    exact = stiffness * load_on_spokes(
        table.station_m[shown], height[shown], RADIUS, profile.station_m, profile.height_m, EXPONENT
    )
    assert np.any(exact == 0.0)
    assert exact.max() > 2.0 * LOAD

    def off(found: FootprintMap) -> np.ndarray:
        below = found.rise_m + RADIUS - rest - height
        touching = np.maximum(below, found.lift_m - rest)
        equivalent = rest + below + (found.stretch * touching ** np.array([[1], [2], [3]])).sum(axis=0)
        force = stiffness * np.interp(equivalent, table.deflection_m, table.flat_force)
        return np.sqrt(np.mean((force[shown] - exact) ** 2)) / LOAD

    rise = path - (RADIUS - rest)
    near = off(footprint_map_about(table, LOAD, LOAD, STIFFNESS, rise, np.zeros_like(rise)))
    assert near < 0.005
    # For all loads together the same cubic is farther off, and so is that about another path.
    assert off(footprint_map(table, LOAD, LOAD, STIFFNESS)) > 3.0 * near
    assert off(footprint_map_about(table, LOAD, LOAD, STIFFNESS, rise[::-1], np.zeros_like(rise))) > 3.0 * near


def test_a_deep_wheel_feels_an_edge_beyond_the_footprint_at_rest():
    """Behind a plank, where a wheel at rest is clear of it, one that is pressed 30 mm deeper is not."""
    profile = edged("plank")
    table = spoke_table(profile, RADIUS, exponent=EXPONENT)
    rest = static_deflection(table, LOAD, STIFFNESS)
    height = np.full(table.station_m.size, RADIUS - rest - 0.03)
    found = footprint_map_about(table, LOAD, LOAD, STIFFNESS, np.full(height.size, -0.03), np.zeros_like(height))
    felt = (found.rise_m == 0.0) & (found.stretch != 0.0).any(axis=0)
    assert np.any(felt)
    stiffness = LOAD / np.interp(rest, table.deflection_m, table.flat_force)
    exact = stiffness * load_on_spokes(
        table.station_m[felt], height[felt], RADIUS, profile.station_m, profile.height_m, EXPONENT
    )
    equivalent = rest + 0.03 + (found.stretch[:, felt] * 0.03 ** np.array([[1], [2], [3]])).sum(axis=0)
    force = stiffness * np.interp(equivalent, table.deflection_m, table.flat_force)
    np.testing.assert_allclose(force, exact, rtol=0.01)
    flat = stiffness * np.interp(rest + 0.03, table.deflection_m, table.flat_force)
    assert exact.max() > 1.02 * flat


def test_on_level_road_nothing_changes():
    profile = edged("plank")
    table = spoke_table(profile, RADIUS, exponent=EXPONENT)
    rest = np.zeros(table.station_m.size)
    found = footprint_map_about(table, LOAD, LOAD, STIFFNESS, rest, rest)
    level = table.station_m < 0.5
    assert np.all(found.stretch[:, level] == 0.0)
    assert np.all(found.rise_m[level] == 0.0)
