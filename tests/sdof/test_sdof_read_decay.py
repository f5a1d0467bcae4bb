"""Reading of decay records against closed forms: period, decrement, kind of damping, defects."""

from __future__ import annotations

import numpy as np
import pytest
from decay_oracles import damped_cosine, nonlinear_decay

from sysid.sdof import decrement_from_damping_ratio, read_decay

PERIOD, DECREMENT = 0.6, 0.5
TIME = np.arange(0.0, 6.0, 0.005)
OMEGA = 2 * np.pi / PERIOD


def noisy(value, sd=3e-4, seed=1):
    return value + sd * np.random.default_rng(seed).standard_normal(value.size)


def assert_reads(reading, period=PERIOD, decrement=DECREMENT, sigmas=4.0):
    """Period and decrement within a few of their own standard errors, which must be small themselves."""
    assert reading.usable, reading.note
    assert reading.damped_period_se < 0.005 * period
    assert reading.log_decrement_se < 0.04 * decrement
    assert abs(reading.damped_period - period) < sigmas * reading.damped_period_se + 1e-5 * period
    assert abs(reading.log_decrement - decrement) < sigmas * reading.log_decrement_se + 1e-4 * decrement


def test_peaks_of_an_exact_decay_at_5_ms_reach_five_digits():
    reading = read_decay(TIME, damped_cosine(TIME, PERIOD, DECREMENT, offset=0.002))
    assert reading.damped_period == pytest.approx(PERIOD, rel=2e-5)
    assert reading.log_decrement == pytest.approx(DECREMENT, rel=1e-4)
    assert reading.settled_level == pytest.approx(0.002, abs=1e-7)
    assert reading.damping_kind == "viscous"
    assert abs(reading.decrement_trend) < 1e-3


def test_peaks_of_an_exact_decay_at_1_ms_and_in_mid_record_reach_five_digits():
    time = np.arange(0.0, 6.0, 0.001)
    reading = read_decay(time, damped_cosine(time, PERIOD, DECREMENT), skip_first_turn=True, earliest_s=0.6)
    assert reading.damped_period == pytest.approx(PERIOD, rel=1e-5)
    assert reading.log_decrement == pytest.approx(DECREMENT, rel=2e-5)


def test_extrema_are_refined_below_the_sample_step():
    reading = read_decay(TIME, damped_cosine(TIME, PERIOD, DECREMENT))
    times = reading.extremum_time_s[reading.used]
    expected = 0.5 + 0.5 * PERIOD * np.arange(1, times.size + 1)
    # A symmetric smoothing shifts all extrema of a decay by the same small time.
    assert np.abs(times[:6] - expected[:6]).max() < 1e-3
    assert np.ptp(times[:6] - expected[:6]) < 1e-5


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("decrement", [0.3, 1.0])
def test_noise_is_covered_by_the_standard_errors(seed, decrement):
    reading = read_decay(TIME, noisy(damped_cosine(TIME, PERIOD, decrement), seed=seed), skip_first_turn=True)
    assert_reads(reading, decrement=decrement)
    assert reading.settled_level == pytest.approx(0.0, abs=6 * reading.settled_level_se)


@pytest.mark.parametrize(
    ("change", "defect"),
    [
        ("reversed sign", lambda t, y: (t, -y)),
        ("offset", lambda t, y: (t, y + 5.0)),
        ("late clock", lambda t, y: (t + 2718.0, y)),
        ("short gap", lambda t, y: (t, np.where((t > 1.2) & (t < 1.35), np.nan, y))),
        ("gap over more than a cycle", lambda t, y: (t, np.where((t > 1.2) & (t < 2.0), np.nan, y))),
        ("engine", lambda t, y: (t, y + 5e-4 * np.sin(2 * np.pi * 22.3 * t))),
        ("no rest", lambda t, y: (t[110:], y[110:])),
    ],
)
def test_defects_leave_the_reading_alone(change, defect):
    time, value = defect(TIME, noisy(damped_cosine(TIME, PERIOD, DECREMENT)))
    assert_reads(read_decay(time, value))


def test_a_drift_of_the_level_is_taken_out():
    clean = read_decay(TIME, damped_cosine(TIME, PERIOD, DECREMENT) + 0.001 * TIME)
    assert "drift" in clean.note
    assert clean.log_decrement == pytest.approx(DECREMENT, rel=1e-3)
    assert_reads(read_decay(TIME, noisy(damped_cosine(TIME, PERIOD, DECREMENT) + 0.001 * TIME)))


def test_spikes_are_left_out():
    value = damped_cosine(TIME, PERIOD, DECREMENT)
    hit = np.isin(np.arange(TIME.size), [50, 160, 161, 220, 310])
    reading = read_decay(TIME, value + 0.06 * hit)
    assert "5 spikes left out" in reading.note
    assert reading.log_decrement == pytest.approx(DECREMENT, rel=2e-3)
    assert_reads(read_decay(TIME, noisy(value + 0.06 * hit)))


@pytest.mark.parametrize("rate", [50.0, 100.0, 500.0])
def test_other_rates(rate):
    time = np.arange(0.0, 6.0, 1.0 / rate)
    assert_reads(read_decay(time, noisy(damped_cosine(time, PERIOD, DECREMENT))))


def test_irregular_time_stamps():
    time = TIME + np.random.default_rng(2).uniform(-0.002, 0.002, TIME.size)
    assert_reads(read_decay(time, noisy(damped_cosine(time, PERIOD, DECREMENT))))


def test_a_long_rest_before_the_release():
    time = np.arange(0.0, 40.0, 0.005)
    assert_reads(read_decay(time, noisy(damped_cosine(time, PERIOD, DECREMENT, release_s=34.0))))


def test_wheel_hop_does_not_capture_the_peaks():
    u = np.maximum(TIME - 0.5, 0.0)
    hop = 0.012 * np.exp(-0.12 * 2 * np.pi * 10.5 * u) * np.sin(2 * np.pi * 10.5 * u)
    reading = read_decay(TIME, damped_cosine(TIME, PERIOD, DECREMENT) + hop, skip_first_turn=True)
    assert reading.damped_period == pytest.approx(PERIOD, rel=2e-3)
    assert reading.log_decrement == pytest.approx(DECREMENT, rel=1e-2)


def test_scale_and_shift_change_nothing():
    value = noisy(damped_cosine(TIME, PERIOD, DECREMENT))
    one, other = read_decay(TIME, value), read_decay(TIME + 8.0, -1000.0 * value + 30.0)
    assert other.damped_period == pytest.approx(one.damped_period, rel=1e-9)
    assert other.log_decrement == pytest.approx(one.log_decrement, rel=1e-8)


@pytest.mark.parametrize(("friction", "linear"), [(0.0019, 0.0), (0.0008, 0.5)])
@pytest.mark.parametrize("sd", [0.0, 2e-4])
def test_dry_friction_is_recognised(friction, linear, sd):
    value = nonlinear_decay(TIME, OMEGA, 0.04, friction=friction, linear=linear)
    reading = read_decay(TIME, noisy(value, sd))
    assert reading.damping_kind == "friction"
    assert reading.decrement_trend < 0


def test_swings_under_pure_friction_fall_linearly():
    # Closed form: each half cycle loses 2 F/k of amplitude, so each swing is 4 F/k shorter than the one before.
    reading = read_decay(TIME, nonlinear_decay(TIME, OMEGA, 0.04, friction=0.0019))
    swings = np.abs(np.diff(reading.extremum_value_m[reading.used]))
    np.testing.assert_allclose(-np.diff(swings)[:5], 4 * 0.0019, rtol=0.03)


@pytest.mark.parametrize("sd", [0.0, 2e-4])
def test_quadratic_damping_is_recognised(sd):
    value = nonlinear_decay(TIME, OMEGA, 0.04, quadratic=4.0, linear=0.2)
    reading = read_decay(TIME, noisy(value, sd))
    assert reading.damping_kind == "quadratic"
    assert reading.decrement_trend > 0


def test_heavy_damping_is_said():
    reading = read_decay(TIME, noisy(damped_cosine(TIME, PERIOD, decrement_from_damping_ratio(0.4))))
    assert reading.usable
    assert "heavily damped" in reading.note
    assert reading.log_decrement_se > 0.02


@pytest.mark.parametrize(
    ("time", "value", "words"),
    [
        (TIME, noisy(damped_cosine(TIME, PERIOD, decrement_from_damping_ratio(0.75))), "fewer than two peaks"),
        (TIME, noisy(np.where(TIME < 1.0, -0.04, 0.0)), "fewer than two peaks"),
        (TIME, np.ones(TIME.size), "no motion"),
        (TIME, noisy(np.zeros(TIME.size)), "no motion"),
        (TIME[:3], TIME[:3], "3 readings"),
        (TIME[:0], TIME[:0], "0 readings"),
        (TIME, np.full(TIME.size, np.nan), "0 readings"),
        (TIME[::80], damped_cosine(TIME, PERIOD, DECREMENT)[::80], "2.5 Hz"),
    ],
)
def test_records_without_two_peaks_yield_no_number(time, value, words):
    reading = read_decay(time, value)
    assert not reading.usable
    assert words in reading.note
    numbers = (reading.damped_period, reading.damped_period_se, reading.log_decrement, reading.log_decrement_se)
    assert np.isnan(numbers).all()
    assert not reading.used.any()


def test_shapes_are_checked():
    with pytest.raises(ValueError, match="equal length"):
        read_decay(TIME, TIME[1:])
