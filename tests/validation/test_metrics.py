"""Closed forms of the single metrics, and the limits of an acceptable channel."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from small_results import small_fit

from sysid.validation import (
    ValidationLimits,
    agreement,
    dominant_frequency,
    fit_percent,
    peak_error,
    sprague_geers,
    validate,
)
from sysid.validation.objective_rating import objective_ratings

TIME = np.arange(4000) * 1e-3
WAVE = np.sin(2.0 * np.pi * 2.5 * TIME)


def shifted(angle: float, size: float = 1.0) -> np.ndarray:
    return size * np.sin(2.0 * np.pi * 2.5 * TIME + angle)


@pytest.mark.parametrize(("size", "angle"), [(1.0, 0.4), (1.3, 0.0), (0.8, 1.1)])
def test_magnitude_and_phase_of_a_scaled_and_shifted_sine(size, angle):
    """Over whole periods M = size - 1 and P = angle / pi."""
    assert sprague_geers(WAVE, shifted(angle, size)) == pytest.approx((size - 1.0, angle / math.pi), abs=1e-7)


def test_magnitude_and_phase_without_a_signal_are_unknown():
    assert all(math.isnan(v) for v in sprague_geers(WAVE, np.zeros_like(WAVE)))
    assert sprague_geers(WAVE, WAVE) == pytest.approx((0.0, 0.0), abs=1e-7)


def test_fit_of_a_sine_with_another_beside_it():
    """|m - s| / |m - mean| = 0.25 for an orthogonal sine of a quarter of the size; an offset of m does not help."""
    other = WAVE + 0.25 * np.sin(2.0 * np.pi * 5.0 * TIME)
    assert fit_percent(WAVE + 7.0, other + 7.0) == pytest.approx(75.0, abs=1e-9)
    assert fit_percent(WAVE, np.zeros_like(WAVE)) == pytest.approx(0.0, abs=1e-9)
    assert math.isnan(fit_percent(np.ones(5), np.ones(5)))


def test_peak_and_its_instant():
    measured, simulated = np.zeros(100), np.zeros(100)
    measured[40], simulated[47] = -2.0, 2.2
    time = np.arange(100) * 0.005
    assert peak_error(time, measured, simulated) == pytest.approx((0.1, 0.035))
    measured[40] = np.nan
    assert all(math.isnan(v) for v in peak_error(time, measured, simulated))


@pytest.mark.parametrize("frequency", [0.8, 2.5, 11.3])
def test_dominant_frequency_of_a_sine_beside_a_smaller_one(frequency):
    values = 5.0 + np.sin(2.0 * np.pi * frequency * TIME) + 0.4 * np.sin(2.0 * np.pi * 33.0 * TIME)
    values[100:103] = np.nan
    assert dominant_frequency(values, 1e-3) == pytest.approx(frequency, abs=0.03)
    assert math.isnan(dominant_frequency(np.ones(50), 1e-3))


def test_every_channel_gets_every_number_and_a_clipped_one_no_peak():
    deflection, broken, clipped = validate(small_fit()).channels[:3]
    assert (deflection.measured_frequency_hz, deflection.simulated_frequency_hz) == pytest.approx(
        (9.0 / (2.0 * math.pi),) * 2, abs=0.1
    )
    assert deflection.iso18571 > 0.9
    assert deflection.fit_percent > 90.0
    assert deflection.sprague_geers_phase > 0.0
    # 10 of 400 samples of the second are missing, 3 of the third clipped: few enough to rate, but a clipped peak hides.
    assert broken.samples == 390
    assert math.isfinite(broken.iso18571)
    assert math.isnan(clipped.peak_error)
    assert math.isnan(clipped.peak_time_error_s)
    assert math.isfinite(clipped.iso18571)


def test_a_channel_with_many_holes_is_not_rated():
    fit = small_fit()
    history = fit.histories[0]
    holes = history.measured.copy()
    holes[0, ::10] = np.nan
    row = validate(replace(fit, histories=(replace(history, measured=holes),))).channels[0]
    assert math.isnan(row.iso18571)
    assert row.samples == 360


@pytest.mark.parametrize(
    ("name", "value", "kept"),
    [
        ("nrmse", 0.11, False),
        ("nrmse", 0.09, True),
        ("peak_error", -0.2, False),
        ("peak_error", 0.1, True),
        ("sprague_geers_magnitude", -0.5, False),
        ("sprague_geers_phase", 0.41, False),
        ("iso18571", 0.79, False),
        ("iso18571", 0.81, True),
        ("iso18571", math.nan, True),
    ],
)
def test_limits(name, value, kept):
    row = validate(small_fit()).channels[0]
    limits = ValidationLimits()
    assert limits.exceeded(row) == ()
    assert limits.exceeded(replace(row, **{name: value})) == (() if kept else (name,))


def test_limits_are_those_of_the_caller():
    strict = validate(small_fit(), ValidationLimits(nrmse=1e-6))
    assert len(strict.outside) == len(strict.channels)
    assert validate(small_fit()).outside == ()


def test_histories_of_many_samples_are_rated_by_means_of_neighbours(monkeypatch):
    # Motion that dies away, at 1 kHz and at 333 Hz, beside one that is late or larger.
    def motion(late: float) -> np.ndarray:
        time = np.clip(TIME - 0.5 - late, 0.0, None)
        return np.exp(-time) * np.sin(2.0 * np.pi * 2.5 * time) + np.exp(-3.0 * time) * np.sin(2.0 * np.pi * 6.3 * time)

    measured, simulated = np.stack([motion(0.0), motion(0.0)]), np.stack([motion(0.006), 1.1 * motion(0.0)])
    fine = objective_ratings(measured, simulated)
    monkeypatch.setattr(agreement, "_MOST_RATED", 1500)
    joined = [agreement._joined(values) for values in (measured, simulated)]
    assert joined[0].shape == (2, 1333)
    np.testing.assert_allclose(joined[0][0, 300:303], measured[0, 900:909].reshape(3, 3).mean(axis=1), rtol=1e-12)
    for one, other in zip(objective_ratings(*joined), fine, strict=True):
        assert one is not None
        assert other is not None
        assert one.overall == pytest.approx(other.overall, abs=0.01)
    monkeypatch.setattr(agreement, "_MOST_RATED", 4000)
    assert agreement._joined(measured) is measured
