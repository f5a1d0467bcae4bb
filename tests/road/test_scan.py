"""Scan analysis against clouds drawn from closed-form bumps on a tilted plane."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from synthetic_cloud import cloud, cosine_bump, misfit, parabola, scan_of, table_top

from sysid.errors import CampaignError
from sysid.road import ScanAnalysis, ScanOptions, analyse_scan


def lopsided(station: np.ndarray) -> np.ndarray:
    return np.where(station < 0, parabola(station, 0.09, 0.4), parabola(station, 0.09, 1.4))


def error_of(analysis: ScanAnalysis, truth) -> float:
    return misfit(analysis.profile.station_m, analysis.profile.height_m, truth)[0]


@pytest.mark.parametrize(
    ("bump", "settings", "limit"),
    [
        (cosine_bump, {}, 0.25e-3),
        (parabola, {}, 0.25e-3),
        (lopsided, {}, 0.25e-3),
        # A flat top larger than the road left around it must not be taken for the road.
        (table_top, {"length": 4.9}, 0.25e-3),
        (parabola, {"noise": 3e-4}, 0.08e-3),
        (parabola, {"noise": 4e-3}, 0.6e-3),
        (parabola, {"outliers": 0.2}, 0.3e-3),
        (parabola, {"points": 600}, 0.9e-3),
        (parabola, {"width": 0.5}, 0.25e-3),
        (parabola, {"centre": 1.8}, 0.25e-3),
        # A scanner that was not levelled: heights count perpendicular to the road.
        (parabola, {"grade": 0.15, "camber": -0.1}, 0.25e-3),
    ],
)
def test_recovers_bump_plane_and_noise(bump, settings: dict, limit: float) -> None:
    analysis = analyse_scan(scan_of(cloud(bump, **settings)))
    assert error_of(analysis, bump) < limit
    noise = settings.get("noise", 1.5e-3)
    assert analysis.noise_rms_m == pytest.approx(noise, rel=0.35 if settings.get("outliers") else 0.2)
    # Standard error of a slope: noise / (sqrt(n) length / sqrt(12)); 2e-4 is above four of them in every case.
    tolerance = max(2e-4, 6 * noise / np.sqrt(settings.get("points", 20_000)) / settings.get("width", 3.5) * 3.5)
    assert analysis.grade == pytest.approx(settings.get("grade", 0.02), abs=tolerance)
    assert analysis.camber == pytest.approx(settings.get("camber", -0.025), abs=tolerance)


def test_standard_error_is_honest_over_many_clouds() -> None:
    standard = []
    for seed in range(6):
        for bump in (parabola, lopsided):
            profile = analyse_scan(scan_of(cloud(bump, points=8000, seed=seed))).profile
            curve = misfit(profile.station_m, profile.height_m, bump)[1]
            on = curve > 0
            standard.append(((profile.height_m - curve) / profile.height_sd_m)[on])
    pooled = np.concatenate(standard)
    assert 0.90 < np.mean(np.abs(pooled) <= 2) <= 0.995
    assert 0.7 < np.sqrt(np.mean(pooled**2)) < 1.2


def test_reversed_heading_mirrors_the_profile() -> None:
    points = cloud(lopsided)
    forward = analyse_scan(scan_of(points, 30.0))
    backward = analyse_scan(scan_of(points, 210.0))
    there, back = forward.profile, backward.profile
    mirrored = (there.station_m[-1] - there.station_m[::-1], there.height_m[::-1])
    assert misfit(back.station_m, back.height_m, lambda s: np.interp(s + 1.0, *mirrored))[0] < 0.05e-3
    assert backward.grade == pytest.approx(-forward.grade, abs=1e-5)
    assert backward.camber == pytest.approx(-forward.camber, abs=1e-5)


def test_far_origin_changes_nothing() -> None:
    near = analyse_scan(scan_of(cloud(parabola, offset=(0.0, 0.0, 0.0))))
    far = analyse_scan(scan_of(cloud(parabola, offset=(4.3e5, 5.2e6, 320.0))))
    assert far.profile.height_m.shape == near.profile.height_m.shape
    np.testing.assert_allclose(far.profile.height_m, near.profile.height_m, atol=2e-6)


@pytest.mark.parametrize("error_deg", [-2.5, -0.4, 1.0])
def test_heading_error_within_tolerance_is_corrected(error_deg: float) -> None:
    within = float(np.radians(3.0))
    analysis = analyse_scan(replace(scan_of(cloud(parabola), 30.0 + error_deg), heading_within_rad=within))
    assert np.degrees(analysis.heading_rad) == pytest.approx(30.0, abs=0.1)
    assert error_of(analysis, parabola) < 0.25e-3
    assert any("heading was turned" in text for text in analysis.messages) == (abs(error_deg) > 0.5)


def test_skew_bump_is_the_mean_of_its_tracks_and_reported() -> None:
    skew = np.radians(6.0)
    analysis = analyse_scan(scan_of(cloud(parabola, skew_deg=6.0)))
    # Track y meets the crest at s = -y tan(skew); the travel cuts the bump at an angle and stretches it.
    tracks = np.linspace(-1.75, 1.75, 401) * np.tan(skew)

    def mean_of_tracks(station: np.ndarray) -> np.ndarray:
        return np.mean([parabola((station - shift) * np.cos(skew)) for shift in tracks], axis=0)

    assert error_of(analysis, mean_of_tracks) < 0.4e-3
    assert any("6.0 degrees off the perpendicular" in text and "36.0" in text for text in analysis.messages)
    assert np.degrees(analysis.heading_rad) == pytest.approx(30.0, abs=1e-9)


def test_two_bumps_are_both_in_the_profile() -> None:
    def two(station: np.ndarray) -> np.ndarray:
        return parabola(station + 0.9) + parabola(station - 0.9, 0.06)

    analysis = analyse_scan(scan_of(cloud(two)))
    assert error_of(analysis, two) < 0.3e-3
    assert any("2 bumps" in text for text in analysis.messages)
    between = np.abs(analysis.profile.station_m - analysis.profile.station_m.mean()) < 0.2
    assert np.abs(analysis.profile.height_m[between]).max() < 0.5e-3


@pytest.mark.parametrize(("extra", "word"), [(0.009, "rise of 9 mm"), (-0.009, "dip of 9 mm")])
def test_lesser_rise_or_dip_is_left_out_and_named(extra: float, word: str) -> None:
    def with_extra(station: np.ndarray) -> np.ndarray:
        return parabola(station) + np.sign(extra) * parabola(station - 1.5, abs(extra), 0.3)

    analysis = analyse_scan(scan_of(cloud(with_extra)))
    assert error_of(analysis, parabola) < 0.25e-3
    assert any(word in text for text in analysis.messages)
    # What was left out must not count as waviness of the road.
    assert np.median(analysis.profile.height_sd_m) < 0.25e-3


def test_waviness_of_the_road_is_in_the_standard_error() -> None:
    def wavy(station: np.ndarray) -> np.ndarray:
        return parabola(station) + 2e-3 * np.sin(2 * np.pi * station / 0.7)

    profile = analyse_scan(scan_of(cloud(wavy))).profile
    on = profile.height_m > 0.01
    # 2 mm amplitude: 1.4 mm root mean square.
    assert np.median(profile.height_sd_m[on]) == pytest.approx(1.4e-3, rel=0.3)


def test_bump_narrower_than_the_scan() -> None:
    def narrow(station: np.ndarray, across: np.ndarray) -> np.ndarray:
        return parabola(station) * (np.abs(across - 0.2) < 1.2)

    analysis = analyse_scan(scan_of(cloud(narrow)))
    assert error_of(analysis, parabola) < 0.3e-3
    assert analysis.strip_half_width_m == pytest.approx(1.2, abs=0.15)
    assert any("does not cover" in text for text in analysis.messages)


def test_wheel_track_strips_see_their_own_height() -> None:
    def worn(station: np.ndarray, across: np.ndarray) -> np.ndarray:
        return parabola(station) * np.where(np.abs(np.abs(across) - 1.0) < 0.35, 0.8, 1.0)

    points = cloud(worn)
    whole = analyse_scan(scan_of(points))
    tracks = analyse_scan(scan_of(points), options=ScanOptions(track_width_m=2.0, strip_half_width_m=0.25))
    middle = analyse_scan(scan_of(points), options=ScanOptions(strip_half_width_m=0.5))
    left = analyse_scan(scan_of(points), options=ScanOptions(strip_centre_m=1.0, strip_half_width_m=0.25))
    assert error_of(tracks, lambda s: 0.8 * parabola(s)) < 0.4e-3
    assert error_of(left, lambda s: 0.8 * parabola(s)) < 0.5e-3
    assert error_of(middle, parabola) < 0.4e-3
    # 1.4 m of 3.5 m are worn by a fifth.
    assert error_of(whole, lambda s: (1 - 0.2 * 1.4 / 3.5) * parabola(s)) < 0.8e-3
    assert any("differs across the scanned width" in text for text in whole.messages)
    assert tracks.messages == ()


def test_near_side_of_the_scanner_does_not_count_more() -> None:
    def one_side_low(station: np.ndarray, across: np.ndarray) -> np.ndarray:
        return parabola(station) * np.where(across > 0, 0.9, 1.1)

    points = cloud(one_side_low)
    across = (points - points.mean(axis=0))[:, :2] @ [-0.5, np.sqrt(0.75)]
    thinned = points[(across > 0) | (np.arange(points.shape[0]) % 2 == 0)]
    # Twice as many points on the low side would give 0.967 of the height.
    assert analyse_scan(scan_of(thinned)).profile.height_m.max() == pytest.approx(0.08, rel=0.012)


def test_left_is_left() -> None:
    def one_side_low(station: np.ndarray, across: np.ndarray) -> np.ndarray:
        return parabola(station) * np.where(across > 0, 0.9, 1.1)

    options = ScanOptions(strip_centre_m=0.8, strip_half_width_m=0.5)
    analysis = analyse_scan(scan_of(cloud(one_side_low)), options=options)
    assert analysis.profile.height_m.max() == pytest.approx(0.9 * 0.08, rel=0.01)
    assert analysis.strip_half_width_m == 0.5


def test_shadow_is_bridged_and_named() -> None:
    points = cloud(parabola, points=40_000)
    along = (points - [12.0, -7.0, 1.5])[:, :2] @ [np.cos(np.pi / 6), np.sin(np.pi / 6)]
    analysis = analyse_scan(scan_of(points[(along < 0.2) | (along > 0.32)]))
    assert error_of(analysis, parabola) < 0.4e-3
    assert any("No point lies on 12 cm" in text for text in analysis.messages)


def test_repeated_points_count_once() -> None:
    points = cloud(parabola, points=5000)
    once, twice = (analyse_scan(scan_of(p)) for p in (points, np.concatenate([points, points])))
    assert any("5000 points occur more than once" in text for text in twice.messages)
    assert np.median(twice.profile.height_sd_m) == pytest.approx(np.median(once.profile.height_sd_m), rel=0.15)


def test_widely_spaced_scan_lines() -> None:
    along, across = (grid.ravel() for grid in np.meshgrid(np.arange(-2.5, 2.5, 0.05), np.arange(-1.75, 1.75, 0.005)))
    height = parabola(along) + 1e-3 * np.random.default_rng(3).standard_normal(along.size)
    analysis = analyse_scan(scan_of(np.column_stack([along, across, height]), 0.0))
    assert np.degrees(analysis.heading_rad) == pytest.approx(0.0, abs=0.1)
    assert error_of(analysis, parabola) < 0.4e-3


def test_a_million_points_take_seconds() -> None:
    points = cloud(parabola, points=1_000_000)
    begin = time.process_time()
    analysis = analyse_scan(scan_of(points))
    assert time.process_time() - begin < 6.0
    assert error_of(analysis, parabola) < 0.06e-3
    assert analysis.strip_station_m.size < 9000
    assert analysis.cloud_along_m.size < 13_000


def test_same_cloud_gives_the_same_numbers() -> None:
    points = cloud(parabola, points=3000)
    first, second = (analyse_scan(scan_of(points)) for _ in range(2))
    np.testing.assert_array_equal(first.profile.height_m, second.profile.height_m)


@pytest.mark.parametrize(("skew_deg", "centre"), [(0.0, 0.0), (6.0, 0.0), (6.0, 0.8)])
def test_figure_points_are_those_of_the_road(skew_deg: float, centre: float) -> None:
    points = cloud(parabola, skew_deg=skew_deg, noise=2e-4, outliers=0)
    strip = {"strip_centre_m": centre, "strip_half_width_m": 0.8} if centre else {}
    analysis = analyse_scan(scan_of(points), options=ScanOptions(**strip))
    # Every point of the cloud lies where the bump was put: the middle of its own cut through it is the profile's.
    profile, skew = analysis.profile, np.radians(skew_deg)
    middle = np.average(profile.station_m, weights=profile.height_m)
    station = analysis.cloud_along_m - middle
    across = analysis.cloud_across_m - analysis.cloud_across_m.mean() - centre
    expected = parabola(station * np.cos(skew) + across * np.sin(skew))
    inner = np.abs(station) < 0.8
    np.testing.assert_allclose(analysis.cloud_height_m[inner], expected[inner], atol=8e-3)
    assert np.sqrt(np.mean((analysis.cloud_height_m - expected)[inner] ** 2)) < 2.5e-3
    if skew_deg == 0:
        line = np.interp(analysis.strip_station_m, profile.station_m, profile.height_m, left=0.0, right=0.0)
        assert np.median(np.abs(analysis.strip_height_m - line)) < 3e-4


@pytest.mark.parametrize(
    "setting", [{"station_step_m": 0.0}, {"flat_m": -1.0}, {"strip_half_width_m": float("nan")}, {"minimum_points": 3}]
)
def test_options_are_checked(setting: dict) -> None:
    with pytest.raises(CampaignError, match=next(iter(setting))):
        ScanOptions(**setting)
