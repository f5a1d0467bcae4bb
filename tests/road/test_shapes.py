"""Analytic bumps against areas, radii and slopes known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.errors import CampaignError
from sysid.road import (
    half_sine,
    make_profile,
    parabolic,
    profile_from_points,
    raised_cosine,
    trapezoid,
    watts,
)


@pytest.mark.parametrize(
    ("shape", "area"),
    [
        (raised_cosine, 0.5),
        (half_sine, 2 / np.pi),
        (parabolic, 2 / 3),
        (trapezoid, 2 / 3),
    ],
)
def test_height_area_and_flat_road(shape, area: float) -> None:
    profile = shape(0.08, 0.9)
    assert profile.height_m.max() == pytest.approx(0.08, rel=1e-5)
    assert np.trapezoid(profile.height_m, profile.station_m) == pytest.approx(area * 0.08 * 0.9, rel=2e-3)
    assert profile.station_m[0] == 0.0
    assert np.all(profile.height_m[profile.station_m < 0.3 - 1e-9] == 0.0)
    assert np.all(profile.height_m[profile.station_m > 1.2 + 1e-9] == 0.0)
    assert profile.station_m[-1] >= 1.5 - 1e-9
    assert np.all(profile.height_sd_m == 0.0)


@pytest.mark.parametrize(
    ("shape", "quarter"),
    [(raised_cosine, 0.5), (half_sine, np.sqrt(0.5)), (parabolic, 0.75), (trapezoid, 0.75)],
)
def test_quarter_height_and_symmetry(shape, quarter: float) -> None:
    profile = shape(0.08, 0.8)
    at = np.interp([0.5, 0.9], profile.station_m, profile.height_m)
    np.testing.assert_allclose(at, 0.08 * quarter, rtol=1e-9)


def test_start_and_length_are_where_the_profile_exceeds_a_millimetre() -> None:
    profile = half_sine(0.08, 0.9)
    first = 0.9 / np.pi * np.arcsin(1 / 80)
    assert profile.start_m == pytest.approx(0.3 + first, abs=0.002)
    assert profile.length_m == pytest.approx(0.9 - 2 * first, abs=0.004)


def test_watts_hump_is_an_arc() -> None:
    profile = watts()
    on = profile.height_m > 0
    # The circle through three of its points passes through all others (perpendicular bisectors, closed form).
    s, z = profile.station_m[on], profile.height_m[on]
    system = np.array([[2 * (s[k] - s[0]), 2 * (z[k] - z[0])] for k in (s.size // 2, -1)])
    right = np.array([s[k] ** 2 - s[0] ** 2 + z[k] ** 2 - z[0] ** 2 for k in (s.size // 2, -1)])
    centre = np.linalg.solve(system, right)
    radius = np.hypot(s - centre[0], z - centre[1])
    assert np.ptp(radius) < 1e-9
    # R = (c^2 / 4 + h^2) / (2 h) of a 3.66 m x 76 mm arc.
    assert radius[0] == pytest.approx(22.0705, abs=1e-3)
    assert profile.height_m.max() == pytest.approx(0.076, abs=1e-6)


def test_trapezoid_ramps_and_top() -> None:
    profile = trapezoid(0.075, 4.0, top_m=2.2)
    slope = np.diff(profile.height_m) / 0.002
    assert slope.max() == pytest.approx(0.075 / 0.9, rel=1e-6)
    assert np.sum(profile.height_m > 0.075 - 1e-12) * 0.002 == pytest.approx(2.2, abs=0.005)


@pytest.mark.parametrize("kind", ["linear", "pchip"])
def test_points_are_passed_through(kind) -> None:
    station, height = np.array([10.0, 10.2, 10.5, 10.9, 11.0]), np.array([0.0, 0.04, 0.08, 0.02, 0.0])
    profile = profile_from_points(station, height, kind=kind)
    np.testing.assert_allclose(np.interp(station - 10.0 + 0.3, profile.station_m, profile.height_m), height, atol=1e-12)
    assert profile.height_m.max() <= 0.08 + 1e-12
    between = np.interp(0.3 + 0.1, profile.station_m, profile.height_m)
    assert (between == pytest.approx(0.02)) == (kind == "linear")


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: raised_cosine(-0.08, 0.9), "height"),
        (lambda: raised_cosine(0.08, 0.0), "length"),
        (lambda: raised_cosine(0.08, float("nan")), "length"),
        (lambda: half_sine(0.08, 0.005), "too short"),
        (lambda: half_sine(0.08, 3000.0), "more than a million"),
        (lambda: half_sine(80.0e-5, 0.9), "nowhere rises above 1 mm"),
        (lambda: trapezoid(0.08, 0.9, top_m=1.0), "flat top"),
        (lambda: watts(2.0, 3.0), "arc"),
        (lambda: profile_from_points(np.array([0.0, 2.0, 1.0]), np.zeros(3)), "point 3"),
        (lambda: profile_from_points(np.arange(3.0), np.array([0.0, 0.1, 0.1])), "on the road"),
        (lambda: profile_from_points(np.arange(3.0), np.array([0.0, np.nan, 0.0])), "not numbers"),
        (lambda: profile_from_points(np.arange(2.0), np.zeros(2)), "at least three"),
        (lambda: make_profile(np.array([0.0, 1.0, 3.0]), np.ones(3)), "not uniform"),
        (lambda: make_profile(np.arange(3.0), np.ones(4)), "equally many"),
    ],
)
def test_wrong_sizes_end_in_a_sentence(call, words: str) -> None:
    with pytest.raises(CampaignError, match=words):
        call()


def test_a_profile_is_known_by_its_heights_alone() -> None:
    wedge = profile_from_points(np.array([0.0, 0.3, 1.2]), np.array([0.0, 0.0805, 0.0]), name="wedge")
    known = wedge.identity
    assert (known.name, known.height_m) == ("wedge", pytest.approx(0.0805))
    assert known.length_m == wedge.length_m
    # Another name, more flat road before it, and the rounding of another machine; round heights lie on no edge.
    further = np.arange(wedge.station_m.size + 200) * (wedge.station_m[1] - wedge.station_m[0])
    rounding = 1e-13 * np.random.default_rng(0).standard_normal(further.size)
    later = make_profile(further, np.pad(wedge.height_m, (200, 0)) + rounding, name="later")
    assert later.identity.sha256 == known.sha256
    # Driven over the other way, and 0.2 mm higher.
    mirrored = make_profile(wedge.station_m, wedge.height_m[::-1])
    higher = make_profile(wedge.station_m, wedge.height_m * (0.0807 / 0.0805))
    assert len({known.sha256, mirrored.identity.sha256, higher.identity.sha256}) == 3
