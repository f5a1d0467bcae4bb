"""Readings, windows and arrivals beside gaps, against motions whose derivatives are known in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sysid.campaign import Channel, read_campaign
from sysid.campaign.clocks.sync import sync_lag
from sysid.campaign.gaps import gaps_of, is_whole, parted, readings_at, window_over
from sysid.campaign.inputs.log_sides import join_sides
from sysid.campaign.passage.arrivals import find_passage
from sysid.campaign.quality import defects
from sysid.campaign.quality.sensor_trios import arrival, first_lift, fit_factors
from sysid.campaign.records import Sensor

STEP_S = 0.005
TIME_S = STEP_S * np.arange(1200)


def decay(time: np.ndarray, start: float, hz: float, rate: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """t^4 exp(-r t) sin(w t) after `start`, its first and its second derivative, by the product rule."""
    t = np.clip(time - start, 0.0, None)
    w = 2.0 * np.pi * hz
    p, dp, ddp = t**4, 4.0 * t**3, 12.0 * t**2
    e = np.exp(-rate * t)
    f, df, ddf = p * e, (dp - rate * p) * e, (ddp - 2.0 * rate * dp + rate**2 * p) * e
    s, c = np.sin(w * t), np.cos(w * t)
    return f * s, df * s + f * w * c, ddf * s + 2.0 * df * w * c - f * w**2 * s


def channel(value: np.ndarray, kind: str = "axle_acceleration", time: np.ndarray = TIME_S) -> Channel:
    unit = "mm" if kind == "suspension_deflection" else "g"
    return Channel(Sensor("x", kind, unit, axle=0), time, value, np.zeros(value.size, np.int8))


def without_rows(c: Channel, begin: float, end: float) -> Channel:
    kept = (c.time_s < begin) | (c.time_s > end)
    return replace(c, time_s=c.time_s[kept], value=c.value[kept], censored=c.censored[kept])


def empty(c: Channel, begin: float, end: float) -> Channel:
    return replace(c, value=np.where((c.time_s < begin) | (c.time_s > end), c.value, np.nan))


LOSE = pytest.mark.parametrize("lose", [without_rows, empty])


@LOSE
def test_derivatives_hold_under_a_window_beside_a_gap(lose) -> None:
    q, rate, second = decay(TIME_S, 1.0, 3.0, 3.0)
    readings = readings_at(lose(channel(q), 1.9, 2.0), TIME_S, 10.0)
    window = window_over(TIME_S, [readings])
    assert window is not None
    assert not window.whole
    frequency = np.fft.rfftfreq(TIME_S.size, STEP_S)
    omega = 2.0 * np.pi * frequency[(frequency > 1.0) & (frequency < 10.0)]
    for order, right in ((1, rate), (2, second)):
        expected = window.transform(right, omega)
        found = window.transform(readings, omega, order)
        assert np.linalg.norm(found - expected) < 1e-4 * np.linalg.norm(expected)
    # A line through the gap is no such motion.
    seen = np.isfinite(readings)
    line = np.interp(TIME_S, TIME_S[seen], readings[seen])
    plain = window_over(TIME_S, [line])
    assert plain is not None
    expected = plain.transform(second, omega)
    assert np.linalg.norm(plain.transform(line, omega, 2) - expected) > 0.05 * np.linalg.norm(expected)


def test_readings_are_missing_in_gaps_and_clips_only() -> None:
    c = channel(np.sin(TIME_S))
    at = np.arange(0.0, 5.9, 0.0017)
    assert np.allclose(readings_at(c, at), np.sin(at), atol=1e-5)
    # One row is short for motion of 12 Hz, twenty rows are not, and nothing is short for motion of any frequency.
    short = without_rows(c, 2.0, 2.002)
    assert np.isfinite(readings_at(short, at, 12.0)).all()
    assert gaps_of(short, 12.0) == []
    assert np.array_equal(np.isnan(readings_at(short, at)), (at > 1.995) & (at < 2.005))
    for lose in (without_rows, empty):
        long = lose(c, 2.001, 2.099)
        ((begin, end),) = gaps_of(long, 12.0)
        assert (begin, end) == pytest.approx((2.0, 2.1))
        assert np.array_equal(np.isnan(readings_at(long, at, 12.0)), (at > begin) & (at < end))
        assert not is_whole(long, 2.05, 3.0, 12.0)
        assert is_whole(long, 2.2, 30.0, 12.0)
    clipped = replace(c, censored=((TIME_S > 1.0) & (TIME_S < 1.5)).astype(np.int8))
    assert np.isnan(readings_at(clipped, np.array([1.2]), clipped=False)).all()
    assert np.isfinite(readings_at(clipped, np.array([1.2]))).all()


def test_channels_of_half_the_rate_have_no_gaps() -> None:
    slow = channel(np.where(np.arange(TIME_S.size) % 2, np.nan, np.sin(TIME_S)))
    assert gaps_of(slow, 12.0) == []


def test_no_neighbour_stands_across_missing_rows() -> None:
    """A steep motion whose rows are missing on both sides of one reading looks like a spike to its neighbours."""
    value = 40.0 * np.clip(TIME_S - 2.0, 0.0, 0.5) * np.sin(2.0 * np.pi * 9.0 * TIME_S)
    value += 1e-3 * np.random.default_rng(1).normal(size=value.size)
    top = int(np.argmax(value))
    kept = np.ones(TIME_S.size, bool)
    kept[top - 11 : top] = kept[top + 1 : top + 12] = False
    c = channel(value[kept], time=TIME_S[kept])
    whole, place = parted(c)
    assert defects.spikes(c.value).size == 1
    assert defects.spikes(whole.value).size == 0
    assert np.array_equal(whole.value[place], c.value)
    assert int(np.isnan(whole.value).sum()) == 2


@LOSE
def test_sensors_of_an_axle_agree_beside_a_gap(lose) -> None:
    body, _, of_body = decay(TIME_S, 1.0, 1.6, 2.0)
    hop, _, of_hop = decay(TIME_S, 1.0, 7.0, 6.0)
    hop, of_hop = 40.0 * hop, 40.0 * of_hop
    q, b = channel(body - hop, "suspension_deflection"), channel(of_body)
    for begin in (1.3, 1.5, 1.8):
        a = lose(channel(of_hop), begin, begin + 0.1)
        fit = fit_factors(q, a, b, STEP_S)
        assert fit is not None
        assert (fit.alpha, fit.beta) == pytest.approx((1.0, 1.0), abs=0.01)
        tripled = fit_factors(q, replace(a, value=3.0 * a.value), b, STEP_S)
        assert tripled is not None
        assert tripled.alpha == pytest.approx(1.0 / 3.0, abs=0.01)
        assert not tripled.right


def test_an_arrival_in_a_gap_is_not_known() -> None:
    _, _, a = decay(TIME_S, 1.0, 7.0, 6.0)
    c = channel(a / np.max(np.abs(a)))
    met = arrival(c, 0.0)
    assert met is not None
    assert abs(first_lift(c, 0.0, met)) > 0.5
    lost = without_rows(c, met - 0.05, met + 0.05)
    assert arrival(lost, 0.0) is None
    assert first_lift(lost, 0.0, met) == 0.0


def test_only_the_axle_beside_a_gap_is_left_out_of_a_passage(linear_truck_folder) -> None:
    campaign = read_campaign(linear_truck_folder)
    run = campaign.bump_runs[2]
    passage = find_passage(run.log.channels, campaign.vehicle, run.nominal_speed_m_s)
    assert passage is not None
    assert passage.whole
    at = passage.arrivals[5].time_s

    def lose(c: Channel) -> Channel:
        return empty(c, at - 0.05, at + 0.1) if c.sensor.axle == 5 else c

    beside = find_passage(tuple(map(lose, run.log.channels)), campaign.vehicle, run.nominal_speed_m_s)
    assert beside is not None
    assert set(beside.arrivals) == {0, 1, 2, 3, 4}
    assert not beside.whole
    assert beside.speed_m_s == pytest.approx(passage.speed_m_s, rel=0.02)


def test_the_mean_of_two_sides_is_missing_where_one_side_is() -> None:
    left = replace(channel(np.sin(5.0 * TIME_S)), sensor=Sensor("l", "axle_acceleration", "g", axle=0, side="left"))
    later = TIME_S + 0.0021
    right = Channel(
        replace(left.sensor, column="r", side="right"), later, np.sin(5.0 * later), np.zeros(TIME_S.size, np.int8)
    )
    (mean,) = join_sides([left, without_rows(right, 2.0, 2.3)], "run", [])
    missing = mean.time_s[np.isnan(mean.value)]
    assert missing[missing > 0.1][0] == pytest.approx(2.0, abs=2 * STEP_S)
    assert missing[-1] == pytest.approx(2.3, abs=2 * STEP_S)


def test_a_common_signal_with_a_gap_shows_the_lag() -> None:
    rng = np.random.default_rng(5)
    edges = np.sort(rng.uniform(0.2, 19.8, 31))
    time = np.arange(0.0, 20.0, STEP_S)

    def pulses(at: np.ndarray) -> np.ndarray:
        return 5.0 * (np.searchsorted(edges, at) % 2)

    lost = (time < 8.0) | (time > 12.0)
    lag = sync_lag((time, pulses(time)), (time[lost], pulses(time[lost] + 0.35)), (-1.0, 1.0))
    assert lag is not None
    assert lag.lag_s == pytest.approx(0.35, abs=STEP_S)


@pytest.mark.parametrize("late_s", [0.0, 0.25])
def test_a_module_that_begins_late_is_read_at_rest_before_its_own_motion(late_s: float) -> None:
    """Rest at 0.1 g until 0.7 s, then motion of 5 g; the others move at 1.0 s."""
    time = late_s + 0.005 * np.arange(400)
    rng = np.random.default_rng(1)
    value = 0.1 + 0.01 * rng.normal(size=time.size) + np.where(time >= 0.7, 5.0 * np.sin(60.0 * (time - 0.7)), 0.0)
    channel = Channel(Sensor("a_g", "axle_acceleration", "g", axle=0), time, value, np.zeros(time.size, np.int8))
    (start,) = defects.motion_starts([channel])
    assert start == pytest.approx(0.705, abs=0.01)
    level, noise = defects.rest_of(defects.quiet_readings(channel, 1.0, start))
    assert level == pytest.approx(0.1, abs=0.005)
    assert noise == pytest.approx(0.01, rel=0.4)
