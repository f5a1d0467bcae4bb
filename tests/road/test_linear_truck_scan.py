"""The scan of the linear truck against the profile it was drawn from."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from synthetic_cloud import misfit

from sysid.campaign.records import Scan
from sysid.road import ScanAnalysis, analyse_scan, read_point_cloud

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def analysis() -> ScanAnalysis:
    entry = tomllib.loads((ROOT / "examples" / "linear_truck" / "campaign.toml").read_text(encoding="utf-8"))["scan"]
    points = read_point_cloud(ROOT / "examples" / "linear_truck" / entry["file"], entry["unit"])
    return analyse_scan(Scan("bump", entry["file"], float(np.radians(entry["heading_deg"])), points))


@pytest.fixture(scope="module")
def truth(analysis: ScanAnalysis) -> tuple[float, np.ndarray]:
    station, height = np.loadtxt(
        ROOT / "tests" / "data" / "road" / "bump_profile.csv", delimiter=",", skiprows=1, unpack=True
    )
    profile = analysis.profile
    return misfit(profile.station_m, profile.height_m, lambda s: np.interp(s, station, height, left=0.0, right=0.0))


def test_profile_and_height_are_within_a_quarter_millimetre(
    analysis: ScanAnalysis, truth: tuple[float, np.ndarray]
) -> None:
    rms, curve = truth
    assert rms < 0.25e-3
    assert abs(analysis.profile.height_m.max() - curve.max()) < 0.25e-3


def test_two_standard_errors_cover_the_truth(analysis: ScanAnalysis, truth: tuple[float, np.ndarray]) -> None:
    _, curve = truth
    on = curve > 0
    standard = (analysis.profile.height_m - curve)[on] / analysis.profile.height_sd_m[on]
    assert np.mean(np.abs(standard) <= 2) > 0.88
    # An error bar ten times too wide would cover everything.
    assert 0.6 < np.sqrt(np.mean(standard**2)) < 1.4


def test_bump_lies_between_flat_road(analysis: ScanAnalysis, truth: tuple[float, np.ndarray]) -> None:
    profile, (_, curve) = analysis.profile, truth
    above = profile.station_m[curve > 1e-3]
    assert profile.start_m == pytest.approx(above[0], abs=0.01)
    # The truth ends in a ripple of 0.83 mm: 0.2 mm of error decide whether it counts as bump.
    assert profile.length_m == pytest.approx(above[-1] - above[0], abs=0.045)
    assert profile.station_m[0] == 0.0
    assert np.ptp(np.diff(profile.station_m)) < 1e-12
    for flat in (profile.station_m < 0.3 - 1e-9, profile.station_m > profile.station_m[-1] - 0.3 + 1e-9):
        assert np.all(profile.height_m[flat] == 0.0)


def test_outliers_are_those_that_were_put_in(analysis: ScanAnalysis) -> None:
    # 164 of 36000 points were displaced when the scan was drawn; a few of them land inside the noise.
    assert 155 <= analysis.outliers <= 170
    assert analysis.points == 36000
    assert analysis.messages == ()
