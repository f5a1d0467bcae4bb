"""Footprint maps about known loads over edges, against the springs themselves."""

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
def test_loads_at_known_heights_are_those_of_the_springs(name):
    """Loads between a half and twice that at rest, within 15 % of the known ones."""
    profile = edged(name)
    table = spoke_table(profile, RADIUS, exponent=EXPONENT)
    rest = static_deflection(table, LOAD, STIFFNESS)
    stiffness = LOAD / np.interp(rest, table.deflection_m, table.flat_force)
    random = np.random.default_rng(2)
    about = LOAD * (1.0 + 0.6 * np.sin(2.0 * np.pi * table.station_m / 0.9 + random.uniform(0.0, 6.0)))
    wanted = about * random.uniform(0.85, 1.15, about.size)
    level = np.array(
        [np.interp(f, stiffness * row, table.deflection_m) for f, row in zip(wanted, table.force, strict=True)]
    )
    height = table.contact_height_m - level
    shown = slice(None, None, 3)
    exact = stiffness * load_on_spokes(
        table.station_m[shown], height[shown], RADIUS, profile.station_m, profile.height_m, EXPONENT
    )

    def worst(found: FootprintMap) -> float:
        below = found.rise_m + RADIUS - rest - height
        equivalent = rest + below + (found.stretch * below ** np.array([[1], [2], [3]])).sum(axis=0)
        force = stiffness * np.interp(equivalent, table.deflection_m, table.flat_force)
        return float(np.sqrt(np.mean((force[shown] - exact) ** 2)) / LOAD)

    near = worst(footprint_map_about(table, LOAD, LOAD, STIFFNESS, about))
    assert near < 0.01
    # For all loads together the same cubic is farther off.
    assert worst(footprint_map(table, LOAD, LOAD, STIFFNESS)) > 1.5 * near


def test_on_level_road_nothing_changes():
    profile = edged("plank")
    table = spoke_table(profile, RADIUS, exponent=EXPONENT)
    found = footprint_map_about(table, LOAD, LOAD, STIFFNESS, np.full(table.station_m.size, LOAD))
    level = table.station_m < 0.5
    assert np.all(found.stretch[:, level] == 0.0)
    assert np.all(found.rise_m[level] == 0.0)
