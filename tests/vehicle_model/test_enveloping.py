"""Radial springs over a bump: quadrature, limiting cases, and profiles from an independent engine."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from sysid.road import enveloping
from sysid.road.enveloping import (
    SPOKE_EXPONENT,
    FootprintMap,
    SpokeTable,
    effective_profile,
    footprint_map,
    spoke_table,
    static_deflection,
)
from sysid.road.road_profile import RoadProfile

DATA = Path(__file__).resolve().parents[1] / "data" / "enveloping"
RADIUS_M = 0.5
UNLOADED_KG = (3955, 2676, 3012, 3021, 3447, 3946)
LOADED_KG = (4907, 9700, 10036, 11250, 11470, 11694)
STIFFNESS = (1.65e6, *[2.9e6] * 5)


def profile(station_m: np.ndarray, height_m: np.ndarray) -> RoadProfile:
    above = np.flatnonzero(height_m > 1e-3)
    first, last = (station_m[above[0]], station_m[above[-1]]) if above.size else (station_m[0], station_m[-1])
    return RoadProfile("bump", station_m, height_m, 0.0 * height_m, float(first), float(last - first))


def raised_cosine(length_m: float, height_m: float) -> RoadProfile:
    s = np.arange(0.0, length_m + 0.4001, 0.002)
    inside = (s > 0.2) & (s < 0.2 + length_m)
    return profile(s, np.where(inside, 0.5 * height_m * (1 - np.cos(2 * np.pi * (s - 0.2) / length_m)), 0.0))


@lru_cache
def table(kind: str) -> SpokeTable:
    if kind == "reference":
        points = pd.read_csv(DATA / "bump_profile.csv")
        return spoke_table(profile(points.s_m.to_numpy(), points.z_m.to_numpy()), RADIUS_M)
    if kind == "flat":
        s = np.arange(0.0, 1.0, 0.01)
        return spoke_table(profile(s, 0.0 * s), RADIUS_M)
    if kind == "plank":
        return spoke_table(PLANK, RADIUS_M)
    return spoke_table(raised_cosine(*{"long": (12.0, 0.1), "short": (0.5, 0.06)}[kind]), RADIUS_M)


def flat_force(deflection_m: float) -> float:
    """Vertical force of unit spokes on a flat road by quadrature: spoke length (R - u) / cos(phi)."""
    height = RADIUS_M - deflection_m
    edge = np.arccos(height / RADIUS_M)
    return quad(
        lambda phi: np.cos(phi) * max(RADIUS_M - height / np.cos(phi), 0.0) ** SPOKE_EXPONENT, -edge, edge, limit=200
    )[0]


def flat_tangent(deflection_m: float) -> float:
    step = 1e-4 * deflection_m
    return (flat_force(deflection_m + step) - flat_force(deflection_m - step)) / (2 * step)


@pytest.mark.parametrize("load_case", ["unloaded", "loaded"])
@pytest.mark.parametrize("axle", range(6))
def test_agrees_with_an_independent_engine(load_case: str, axle: int):
    reference = pd.read_csv(DATA / "effective_profiles.csv")
    load = {"unloaded": UNLOADED_KG, "loaded": LOADED_KG}[load_case][axle] * 9.81
    station, rise = effective_profile(table("reference"), load, UNLOADED_KG[axle] * 9.81, STIFFNESS[axle])
    theirs = reference[f"{load_case}_axle{axle + 1}_m"].to_numpy()
    # Their stations count from the middle of the bump, so the shift is a free number.
    shifts = np.arange(-0.7, 0.7, 0.002)
    error = min(np.abs(np.interp(reference.s_m + shift, station, rise) - theirs).max() for shift in shifts)
    assert theirs.max() > 0.05
    assert error < 1e-3


def test_a_flat_road_has_no_effect():
    station, rise = effective_profile(table("flat"), 6e4, 4e4, 2.9e6)
    assert station.size > 100
    np.testing.assert_array_equal(rise, 0.0)


def test_a_long_gentle_profile_is_followed():
    """On a slope alpha the wheel centre rides R / cos(alpha) above the road, 0.15 mm more than on the flat."""
    road = raised_cosine(12.0, 0.1)
    station, rise = effective_profile(table("long"), 4e4, 4e4, 2.9e6)
    exact = np.interp(station, road.station_m - road.start_m, road.height_m, left=0.0, right=0.0)
    assert np.abs(rise - exact).max() < 3e-4
    assert rise.max() == pytest.approx(0.1, abs=1e-4)


def test_flat_road_force_equals_quadrature():
    t = table("flat")
    deep = t.deflection_m > 0.008
    exact = np.array([flat_force(u) for u in t.deflection_m[deep]])
    np.testing.assert_allclose(t.flat_force[deep], exact, rtol=5e-3)
    assert t.flat_force[0] == 0.0


@pytest.mark.parametrize(("load_N", "stiffness"), [(38e3, 1.65e6), (26e3, 2.9e6), (115e3, 2.9e6)])
def test_static_deflection_solves_the_flat_road_law(load_N: float, stiffness: float):
    exact = brentq(lambda u: flat_force(u) / flat_tangent(u) - load_N / stiffness, 1e-3, 0.11)
    found = static_deflection(table("flat"), load_N, stiffness)
    assert found == pytest.approx(exact, rel=0.02)
    # For small deflections g ~ u^(p + 1/2), so u = (p + 1/2) F / k.
    assert found == pytest.approx((SPOKE_EXPONENT + 0.5) * load_N / stiffness, rel=0.05)


def spoke_forces(road: RoadProfile, station_m: float, height_m: float) -> tuple[float, float]:
    """Vertical and forward force of unit spokes, closely spaced, each cut with the road by bisection."""
    phi = np.linspace(-np.pi / 3, np.pi / 3, 4001)

    def clear(rho: np.ndarray) -> np.ndarray:
        under = station_m + rho * np.sin(phi) + road.start_m
        return height_m - rho * np.cos(phi) > np.interp(under, road.station_m, road.height_m)

    low, high = np.zeros_like(phi), np.full_like(phi, RADIUS_M)
    for _ in range(45):
        middle = 0.5 * (low + high)
        above = clear(middle)
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    force = np.where(clear(np.full_like(phi, RADIUS_M)), 0.0, RADIUS_M - low) ** SPOKE_EXPONENT
    return float(np.trapezoid(force * np.cos(phi), phi)), float(-np.trapezoid(force * np.sin(phi), phi))


def forces_past_edges(road: RoadProfile, station_m: float, height_m: float) -> tuple[float, float]:
    """The same where a spoke may run through an edge: the first place along it that lies below the road."""
    phi, rho = np.linspace(-np.pi / 3, np.pi / 3, 4001)[:, None], np.linspace(0.7, 1.0, 801) * RADIUS_M
    under = station_m + rho * np.sin(phi) + road.start_m
    below = np.interp(under, road.station_m, road.height_m) - (height_m - rho * np.cos(phi))
    hit = below >= 0.0
    outer = np.maximum(hit.argmax(axis=1), 1)
    rows = np.arange(phi.size)
    share = -below[rows, outer - 1] / (below[rows, outer] - below[rows, outer - 1])
    met = rho[outer - 1] + share * (rho[1] - rho[0])
    force = np.where(hit.any(axis=1), RADIUS_M - met, 0.0) ** SPOKE_EXPONENT
    angle = phi[:, 0]
    return float(np.trapezoid(force * np.cos(angle), angle)), float(-np.trapezoid(force * np.sin(angle), angle))


@pytest.mark.parametrize("station_m", [-0.11, -0.03, 0.0, 0.05, 0.17, 0.26])
@pytest.mark.parametrize("deflection_m", [0.01, 0.03, 0.06])
def test_edges_fall_between_no_spokes(station_m: float, deflection_m: float):
    """A plank of 40 mm with edges over 1 mm: both forces within 0.5 % of that of a wheel on flat road, sunk 30 mm."""
    t = table("plank")
    k, j = (int(np.argmin(np.abs(v - at))) for v, at in ((t.station_m, station_m), (t.deflection_m, deflection_m)))
    exact = forces_past_edges(PLANK, t.station_m[k], t.contact_height_m[k] - t.deflection_m[j])
    found = t.force[k, j], t.forward_force[k, j]
    np.testing.assert_allclose(found, exact, atol=5e-3 * flat_force(0.03))


def test_the_rise_has_no_ripple():
    """Sums over a fan of spokes and stations 10 mm apart beat: waves of 2 cm that shake a creeping wheel."""
    station, rise = effective_profile(table("short"), LOAD_N, LOAD_N, STIFFNESS_N_PER_M)
    deflection = static_deflection(table("short"), LOAD_N, STIFFNESS_N_PER_M)
    near = np.flatnonzero((station > 0.05) & (station < 0.17))
    exact = []
    for k in near:
        at = brentq(lambda h, k=k: spoke_forces(SHORT, station[k], h)[0] - flat_force(deflection), 0.46, 0.56)
        exact.append(at - (RADIUS_M - deflection))
    np.testing.assert_allclose(np.diff(rise[near] - exact), 0.0, atol=5e-6)


SHORT = raised_cosine(0.5, 0.06)
ALONG_M = np.arange(0.0, 0.7501, 0.001)
PLANK = profile(ALONG_M, np.interp(ALONG_M, [0.3, 0.301, 0.45, 0.451], [0.0, 0.04, 0.04, 0.0]))
LOAD_N, STIFFNESS_N_PER_M = 5e4, 2.9e6


@pytest.mark.parametrize("station_m", [-0.15, 0.0, 0.1, 0.24])
def test_the_rise_keeps_the_vertical_force(station_m: float):
    station, rise = effective_profile(table("short"), LOAD_N, LOAD_N, STIFFNESS_N_PER_M)
    deflection = static_deflection(table("short"), LOAD_N, STIFFNESS_N_PER_M)
    height = RADIUS_M - deflection + float(np.interp(station_m, station, rise))
    assert spoke_forces(SHORT, station_m, height)[0] == pytest.approx(flat_force(deflection), rel=0.01)


@lru_cache
def short_map() -> FootprintMap:
    return footprint_map(table("short"), LOAD_N, LOAD_N, STIFFNESS_N_PER_M)


@pytest.mark.parametrize("station_m", [-0.1, 0.0, 0.1, 0.24, 0.4])
@pytest.mark.parametrize("share", [-0.6, -0.3, 0.3, 0.8, 1.5])
def test_the_map_gives_the_force_of_the_spokes(station_m: float, share: float):
    """Wheel higher or lower than its effective profile by a share of the static deflection: both forces."""
    m = short_map()
    k = int(np.argmin(np.abs(m.station_m - station_m)))
    rest = static_deflection(table("short"), LOAD_N, STIFFNESS_N_PER_M)
    v = share * rest
    vertical, forward = spoke_forces(SHORT, m.station_m[k], RADIUS_M - rest + m.rise_m[k] - v)
    exact = brentq(lambda u: flat_force(u) - vertical, 1e-5, 0.2)
    found = rest + v + np.polyval([*m.stretch[::-1, k], 0.0], v)
    assert m.misfit_m < 1.5e-3
    assert found == pytest.approx(exact, abs=m.misfit_m + 3e-4)
    assert np.polyval(m.drag[::-1, k], v) == pytest.approx(forward / vertical, abs=0.04)


def test_lift_is_the_place_of_first_contact():
    m = short_map()
    rest = static_deflection(table("short"), LOAD_N, STIFFNESS_N_PER_M)
    for k in range(0, m.station_m.size, 7):
        height = RADIUS_M - rest + m.rise_m[k] - (m.lift_m[k] - rest)
        assert spoke_forces(SHORT, m.station_m[k], height + 2e-4)[0] == 0.0
        assert spoke_forces(SHORT, m.station_m[k], height - 1e-3)[0] > 0.0


def test_on_a_flat_road_the_map_is_empty():
    m = footprint_map(table("flat"), 6e4, 4e4, 2.9e6)
    for values in (m.rise_m, m.stretch, m.drag, m.lift_m):
        assert not values.any()


def test_a_peak_that_is_not_touched_at_first_leaves_a_finite_map():
    """Warnings are errors here.  The load is far above the first step of the deflection, so the map stays the same."""
    touched = table("short")
    force, forward = touched.force.copy(), touched.forward_force.copy()
    force[20, 1], forward[20, 1] = 0.0, 0.0
    m = footprint_map(replace(touched, force=force, forward_force=forward), LOAD_N, LOAD_N, STIFFNESS_N_PER_M)
    for values, known in ((m.rise_m, short_map().rise_m), (m.stretch, short_map().stretch), (m.drag, short_map().drag)):
        np.testing.assert_allclose(values, known, rtol=2e-3, atol=2e-4)


def test_the_forward_force_brakes_on_the_way_up_and_pushes_on_the_way_down():
    m = short_map()
    middle = 0.45 - SHORT.start_m
    assert np.interp(middle - 0.2, m.station_m, m.drag[0]) < -0.1
    assert np.interp(middle + 0.2, m.station_m, m.drag[0]) > 0.1


def test_symmetry_and_load():
    """A symmetric bump stays symmetric; a heavier wheel swallows more of it; the effect reaches beyond the bump."""
    road = raised_cosine(0.5, 0.06)
    middle = 0.45 - road.start_m
    light = effective_profile(table("short"), 3e4, 4e4, 2.9e6)
    heavy = effective_profile(table("short"), 9e4, 4e4, 2.9e6)
    offsets = np.linspace(0.0, 0.6, 61)
    for station, rise in (light, heavy):
        ahead, behind = (np.interp(middle + sign * offsets, station, rise) for sign in (1, -1))
        np.testing.assert_allclose(ahead, behind, atol=2e-4)
        assert rise[0] == rise[-1] == 0.0
    assert heavy[1].max() < light[1].max() < 0.06
    assert np.interp(-0.08, *light) > 1e-3


def test_rows_are_interpolated_together_as_numpy_does_one_by_one():
    random = np.random.default_rng(5)
    # Rows begin with several equal values, as forces before contact do; some values lie beyond them.
    rows = np.concatenate([np.zeros((20, 3)), np.cumsum(random.exponential(size=(20, 9)), axis=1)], axis=1)
    levels, values = np.cumsum(random.exponential(size=12)), np.linspace(0.1, 15.0, 40)
    by_value = enveloping._interpolated_rows(values, rows, levels)
    np.testing.assert_allclose(by_value, [np.interp(values, row, levels) for row in rows], rtol=1e-12)
    where = random.uniform(-1.0, levels[-1] + 1.0, (20, 7))
    by_level = enveloping._at_levels(where, levels, rows)
    one_by_one = [np.interp(w, levels, row) for w, row in zip(where, rows, strict=True)]
    np.testing.assert_allclose(by_level, one_by_one, rtol=1e-12)
