"""Rough roads of ISO 8608: spectrum and coherence of generated tracks, class and roughness index of given profiles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import coherence, welch

from sysid.road.roughness import (
    CLASS_A_M3,
    STATION_STEP_M,
    class_of_profile,
    class_road,
    roughness_index,
    track_coherence,
)

DATA = Path(__file__).resolve().parents[1] / "data" / "iri"


@pytest.mark.parametrize("side", [0, 1])
def test_the_spectrum_of_each_track_is_that_of_its_class(side: int):
    """Welch's estimate in octaves, every one within 1 dB of 16e-6 * 4^2 (n / 0.1)^-2 m3."""
    heights = [class_road("C", 4000.0, seed)[1][side] for seed in range(4)]
    n, density = welch(np.array(heights), 1.0 / STATION_STEP_M, nperseg=32768, axis=-1)
    density = density.mean(axis=0)
    for low in 0.02 * 2.0 ** np.arange(7):
        band = (n >= low) & (n < 2.0 * low) & (n < 2.8)
        departure = 10.0 * np.log10(density[band] / (16e-6 * 16.0 * (n[band] / 0.1) ** -2.0))
        assert abs(departure.mean()) < 1.0
        # The class beside it is 6 dB away.
        assert abs((departure - 10.0 * np.log10(4.0)).mean()) > 4.0


def isotropic(wave_number: float, track_m: float, waviness: float) -> float:
    """Cross over auto spectrum of lines of a surface whose spectrum depends on |(n, m)| alone, by quadrature."""

    def surface(m: float) -> float:
        return (wave_number**2 + m**2) ** (-0.5 * (waviness + 1.0))

    both = quad(surface, 0.0, np.inf, weight="cos", wvar=2.0 * np.pi * track_m)[0]
    return both / quad(surface, 0.0, np.inf)[0]


@pytest.mark.parametrize("waviness", [1.6, 2.0, 2.5])
@pytest.mark.parametrize("wave_number", [0.02, 0.1, 0.4])
def test_coherence_is_that_of_an_isotropic_surface(wave_number: float, waviness: float):
    found = float(track_coherence(np.array([wave_number]), 1.9, waviness)[0])
    assert found == pytest.approx(isotropic(wave_number, 1.9, waviness), abs=2e-3)
    assert found != pytest.approx(isotropic(2.0 * wave_number, 1.9, waviness), abs=2e-3)


def test_generated_tracks_have_that_coherence():
    pairs = [class_road("B", 4000.0, seed, track_m=2.0)[1] for seed in range(6)]
    left, right = (np.concatenate([pair[side] for pair in pairs]) for side in (0, 1))
    n, squared = coherence(left, right, 1.0 / STATION_STEP_M, nperseg=8192)
    band = (n > 0.02) & (n < 1.0)
    np.testing.assert_allclose(squared[band], track_coherence(n[band], 2.0) ** 2, atol=0.12)
    assert squared[(n > 0.6) & (n < 1.0)].mean() < 0.05


@pytest.mark.parametrize(("name", "index"), [("A", 2.22), ("B", 4.44), ("C", 8.88), ("D", 17.75)])
def test_index_of_the_centres_of_the_classes(name, index):
    """Published numbers for white noise of the slope, from the covariance of the golden car, without an average."""
    found = []
    for seed in range(3):
        station, tracks = class_road(name, 3000.0, seed)
        found += [roughness_index(station, z, average_m=0.0) for z in tracks]
    assert np.mean(found) == pytest.approx(index, rel=0.02)


def test_index_of_a_measured_profile():
    """Published: 3.309 m/km over the first 540 m (see PROVENANCE.md there); the grade does not count."""
    s, z = np.loadtxt(DATA / "profile_1.txt").T
    used = s <= s[0] + 540.0 + 1e-6
    found = roughness_index(s[used] - s[0], z[used])
    assert found == pytest.approx(3.309, abs=0.005)
    assert roughness_index(s[used] - s[0], z[used] + 0.01 * s[used]) == pytest.approx(found, rel=1e-6)
    assert roughness_index(s[used] - s[0], 1.1 * z[used]) == pytest.approx(1.1 * found, rel=1e-9)


@pytest.mark.parametrize("name", ["A", "C", "F"])
def test_a_generated_road_is_of_its_class(name):
    station, tracks = class_road(name, 1000.0, 7)
    for height in tracks:
        found, density = class_of_profile(station, height + 0.02 * station)
        assert found == name
        assert density == pytest.approx(CLASS_A_M3 * 4.0 ** "ABCDEFGH".index(name), rel=0.2)


def test_seeds_choose_roads_and_classes_scale_them():
    one, other = class_road("A", 200.0, 1), class_road("A", 200.0, 2)
    assert one[0][-1] >= 200.0
    np.testing.assert_array_equal(one[1], class_road("A", 200.0, 1)[1])
    assert np.abs(one[1] - other[1]).max() > 1e-3


def test_a_few_metres_have_no_class():
    station = np.arange(0.0, 1.0, 0.05)
    assert class_of_profile(station, np.sin(station)) is None
