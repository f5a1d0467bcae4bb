"""Measures of axle loads along a road: closed forms, the example of ASTM E1049, and histories made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.prediction.road_measures import (
    RANGE_LEVELS,
    Drive,
    aggregate_loads,
    aggregate_stations,
    counted_ranges,
    load_spectra,
    range_pairs,
    repeatability,
)

#: The example of ASTM E1049-85, figure 6, and its counts by range.
EXAMPLE = np.array([-2.0, 1.0, -3.0, 5.0, -1.0, 3.0, -4.0, 4.0, -2.0])
COUNTS = {3.0: 0.5, 4.0: 1.5, 6.0: 0.5, 8.0: 1.0, 9.0: 0.5}


def drive(forces: np.ndarray, suspension: np.ndarray | None = None) -> Drive:
    chosen = forces[..., :1] if suspension is None else suspension
    return Drive(forces, chosen, np.full(forces.shape[1:], 10.0), {})


def test_range_pairs_are_those_of_the_standard():
    # Points between the turning points change nothing.
    history = np.interp(np.linspace(0.0, 8.0, 161), np.arange(9.0), EXAMPLE)
    found = range_pairs(history, 4.0, 500.0)
    exact = [2.0 * sum(n for size, n in COUNTS.items() if size > 4.0 * level) for level in RANGE_LEVELS]
    np.testing.assert_allclose(found, exact)
    assert found.max() == pytest.approx(8.0)


def test_a_steady_wave_has_one_range_per_period():
    time = 0.004 * np.arange(5001)
    force = 10.0 + 2.0 * np.sin(2.0 * np.pi * 2.0 * time)
    forces = np.repeat(force[:, None, None], 2, axis=1)
    tire, suspension = counted_ranges(drive(forces, 2.0 * forces), np.ones((5001, 2), bool), 400.0)
    # Forty periods on 400 m: a range of 0.4 times the load at rest, of twice that in the suspension.
    np.testing.assert_allclose(tire[0, RANGE_LEVELS < 0.4, 0], 100.0, rtol=0.03)
    np.testing.assert_allclose(tire[0, RANGE_LEVELS > 0.4, 0], 0.0)
    np.testing.assert_allclose(suspension[1, RANGE_LEVELS < 0.8, 0], 100.0, rtol=0.03)


def test_the_spectrum_of_a_wave_and_of_noise():
    random, interval = np.random.default_rng(1), 0.004
    time = interval * np.arange(100_000)
    wave = 3.0 * np.sin(2.0 * np.pi * 5.0 * time)
    noise = random.normal(0.0, 2.0, time.size)
    forces = 10.0 + np.stack([wave, noise], axis=1)[..., None]
    frequency, density = load_spectra([drive(forces)], np.ones((time.size, 2), bool), interval)
    step = frequency[1]
    assert density[0, :, 0].sum() * step == pytest.approx(4.5, rel=0.01)
    assert frequency[np.argmax(density[0, :, 0])] == pytest.approx(5.0, abs=step)
    # White noise: variance over half the sampling rate.
    assert density[1, 5:, 0].mean() == pytest.approx(4.0 * 2.0 * interval, rel=0.03)


def test_axles_pass_a_station_one_after_the_other():
    """Two axles, the second 25 samples later: a load of each that depends on the station alone adds up there."""
    step, shift = 0.1, np.array([0.0, 25.0])
    place = step * (np.arange(1200)[:, None] - shift)
    forces = np.stack([1.0 + 0.1 * np.sin(place[:, 0]), 2.0 + 0.3 * np.cos(place[:, 1])], axis=1)[..., None]
    found = aggregate_loads(forces, shift, 100.0, step)
    station = aggregate_stations(100.0)
    np.testing.assert_allclose(found[:, 0], 3.0 + 0.1 * np.sin(station) + 0.3 * np.cos(station), atol=0.02)


def test_repeatability_is_a_correlation():
    random = np.random.default_rng(3)
    one, other = random.normal(size=(2, 20_000, 3))
    assert repeatability(one, 5.0 + 2.0 * one).q50[0] == pytest.approx(1.0)
    assert repeatability(one, -one).q50[0] == pytest.approx(-1.0)
    assert abs(repeatability(one, other).q50[0]) < 0.03
    assert repeatability(one, one + other).q50[0] == pytest.approx(np.sqrt(0.5), abs=0.02)
    assert repeatability(one[:, :1], other[:, :1]).q05 is None
