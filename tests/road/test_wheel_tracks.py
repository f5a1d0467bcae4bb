"""The profile under the tires against clouds of bumps that are turned, worn or higher on one side.

The oracle is the closed form that the points were drawn from, at the places of the tires.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from synthetic_cloud import cloud, misfit, parabola, scan_of

from sysid.road import ScanAnalysis, analyse_scan

TIRES_M = (0.75, 1.08)


def worn(station: np.ndarray, across: np.ndarray) -> np.ndarray:
    """A bump of which a third is gone beyond 1.3 m to the right of its middle."""
    return parabola(station) * (1.0 - 0.33 * np.clip((-across - 1.3) / 0.2, 0.0, 1.0))


def tilted(station: np.ndarray, across: np.ndarray) -> np.ndarray:
    """A bump that is higher on its right."""
    return parabola(station) * (1.0 - 0.05 * across)


def analysed(bump: Callable[..., np.ndarray], *, lateral_m: float = 0.0, **settings: float) -> ScanAnalysis:
    scan = replace(scan_of(cloud(bump, points=40_000, **settings)), tires_m=TIRES_M, lateral_m=lateral_m)
    return analyse_scan(scan)


def error_m(analysis: ScanAnalysis, truth: Callable[[np.ndarray], np.ndarray]) -> float:
    return misfit(analysis.profile.station_m, analysis.profile.height_m, truth)[0]


def test_an_edge_worn_where_no_wheel_rolls_changes_nothing() -> None:
    scan = scan_of(cloud(worn, points=40_000))
    over_width, tracks = analyse_scan(scan), analyse_scan(replace(scan, tires_m=TIRES_M))
    assert error_m(tracks, parabola) < 0.35e-3
    # The mean over the width is lower by what is worn.
    assert error_m(over_width, parabola) > 1.2e-3
    assert any("that under the tires" in text for text in tracks.messages)
    # A truck that drives half a metre to the right has its right wheels on the worn part.
    aside = analysed(worn, lateral_m=-0.5).profile
    assert aside.sides is not None
    assert aside.sides.right_m.max() < 0.9 * aside.sides.left_m.max()


@pytest.mark.parametrize("skew_deg", [2.3, -2.3])
def test_a_bump_off_square_is_met_by_one_side_first(skew_deg: float) -> None:
    analysis = analysed(parabola, skew_deg=skew_deg)
    slope, sides = np.tan(np.radians(skew_deg)), analysis.profile.sides
    assert sides is not None
    assert np.degrees(sides.skew_rad) == pytest.approx(skew_deg, abs=0.1)

    def of_tires(station: np.ndarray) -> np.ndarray:
        places = [side * y for side in (1.0, -1.0) for y in TIRES_M]
        return np.mean([parabola((station + y * slope) * np.cos(np.radians(skew_deg))) for y in places], axis=0)

    assert error_m(analysis, of_tires) < 0.25e-3
    assert error_m(analysis, parabola) > 0.35e-3
    station = analysis.profile.station_m
    centre = [float(np.sum(station * h) / np.sum(h)) for h in (sides.left_m, sides.right_m)]
    assert centre[1] - centre[0] == pytest.approx(2.0 * np.mean(TIRES_M) * slope, abs=2e-3)
    assert any(f"the {'left' if skew_deg > 0 else 'right'} wheels meet it first" in text for text in analysis.messages)


def test_each_side_has_its_own_height() -> None:
    sides = analysed(tilted).profile.sides
    assert sides is not None
    assert sides.left_m.max() == pytest.approx(0.08 * (1.0 - 0.05 * sides.at_m), abs=0.6e-3)
    assert sides.right_m.max() == pytest.approx(0.08 * (1.0 + 0.05 * sides.at_m), abs=0.6e-3)


def test_a_bump_alike_across_keeps_the_profile_of_its_whole_width() -> None:
    points = cloud(parabola)
    over_width, tracks = (analyse_scan(replace(scan_of(points), tires_m=t)).profile for t in ((), TIRES_M))
    assert tracks.sides is not None
    stations = np.linspace(0.0, 0.9, 91)
    one, two = (np.interp(stations, p.station_m - p.start_m, p.height_m) for p in (over_width, tracks))
    # The tracks alone have a sixth of the points, and twice the error.
    assert np.sqrt(np.mean((one - two) ** 2)) < 0.05e-3


def test_a_scan_narrower_than_the_truck_gives_its_mean() -> None:
    narrow = analysed(tilted, width=1.6)
    assert narrow.profile.sides is None
    assert error_m(narrow, parabola) < 0.3e-3
