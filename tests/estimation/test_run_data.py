"""Runs as arrays: grids, gaps, clipping, groups of different interval and length, channels that are missing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigid_truck import SENSORS, campaign, empty_run, with_values

from sysid import limits
from sysid.campaign.records import BumpRun, Channel
from sysid.errors import DataRejectedError
from sysid.estimation.residuals.run_data import channel_layout, grid_phase, group_runs, on_grid


def channel(time: np.ndarray, value: np.ndarray, censored: np.ndarray | None = None) -> Channel:
    return Channel(SENSORS[0], time, value, np.zeros(time.size, np.int8) if censored is None else censored)


def test_regular_stamps_are_taken_as_they_are():
    time = np.arange(20) * 0.005
    value = np.arange(20.0)
    value[7] = np.nan
    side = np.zeros(20, np.int8)
    side[3], side[4] = 1, -1
    found, measured, censored = on_grid(channel(time, value, side), 25, 0.005)
    np.testing.assert_array_equal(measured, [*[True] * 3, False, False, True, True, False, *[True] * 12, *[False] * 5])
    np.testing.assert_array_equal(found[measured], value[measured[:20]])
    np.testing.assert_array_equal(np.flatnonzero(censored), [3, 4])
    np.testing.assert_array_equal(found[[3, 4]], [3.0, 4.0])
    assert found[7] == 0.0


def test_missing_rows_are_missing_and_nothing_moves():
    keep = np.r_[0:50, 60:120]
    time = np.arange(120) * 0.005
    found, measured, _ = on_grid(channel(time[keep], time[keep]), 120, 0.005)
    np.testing.assert_array_equal(np.flatnonzero(~measured), np.arange(50, 60))
    np.testing.assert_allclose(found[measured], time[keep], atol=1e-12)


def test_jittered_stamps_are_interpolated():
    random = np.random.default_rng(0)
    time = np.sort(np.arange(400) * 0.005 + random.uniform(-0.001, 0.001, 400))
    time[0] = 0.0
    value = np.sin(2 * np.pi * 3.0 * time)
    found, measured, _ = on_grid(channel(time, value), 400, 0.005)
    grid = np.arange(400) * 0.005
    assert measured[2:-2].all()
    np.testing.assert_allclose(found[measured], np.sin(2 * np.pi * 3.0 * grid[measured]), atol=1e-5)


def test_a_slow_clock_is_followed_over_a_long_record():
    """Stamps every 5.01 ms drift by a whole sample within 2.5 s; readings must stay where their stamps are."""
    time = np.arange(1000) * 0.00501
    found, measured, _ = on_grid(channel(time, time.copy()), 1002, 0.005)
    assert measured[:1000].all()
    np.testing.assert_allclose(found[:1000], np.arange(1000) * 0.005, atol=1e-9)


def test_jitter_does_not_bridge_a_gap_or_a_clipped_stretch():
    random = np.random.default_rng(1)
    time = np.arange(200) * 0.005 + random.uniform(-0.001, 0.001, 200)
    side = np.zeros(200, np.int8)
    side[100:105] = 1
    keep = np.r_[0:40, 50:200]
    found = on_grid(channel(time[keep], np.ones(keep.size), side[keep]), 200, 0.005)
    assert not found[1][42:48].any()
    assert not found[1][101:104].any()
    assert found[1][110:198].all()


def test_clipped_readings_of_an_uneven_clock_are_kept_at_the_nearest_time():
    random = np.random.default_rng(2)
    time = np.arange(200) * 0.005 + random.uniform(-0.001, 0.001, 200)
    value, side = np.sin(20.0 * time), np.zeros(200, np.int8)
    side[100:105], value[100:105] = 1, 3.0
    side[150], value[150] = -1, -3.0
    found, measured, censored = on_grid(channel(time, value, side), 200, 0.005)
    np.testing.assert_array_equal(np.flatnonzero(censored), [*range(100, 105), 150])
    np.testing.assert_array_equal(found[censored != 0], [3.0] * 5 + [-3.0])
    assert not (measured & (censored != 0)).any()


@pytest.mark.parametrize("share", [0.3, -0.3, 0.49])
def test_an_offset_of_the_whole_clock_changes_no_reading(share):
    value, side = np.random.default_rng(3).normal(size=60), np.zeros(60, np.int8)
    side[20] = 1
    time = (np.arange(60) + 5 + share) * 0.005
    found, measured, censored = on_grid(channel(time, value, side), 80, 0.005)
    np.testing.assert_array_equal(found[5:65], value)
    assert np.flatnonzero(censored).tolist() == [25]
    assert measured.sum() == 59


def groups(runs: list[BumpRun]):
    return group_runs(campaign(runs), channel_layout(tuple(runs)))


def run(file: str, samples: int, interval_s: float = 0.005) -> BumpRun:
    return empty_run(file, 5.0, samples=samples, interval_s=interval_s)


def test_runs_of_similar_length_share_a_group_and_are_padded():
    found = groups([run("a", 400), run("b", 380), run("c", 200)])
    assert [g.runs for g in found] == [(0, 1), (2,)]
    assert found[0].value.shape == (400, 2, 8)
    assert found[0].measured[:, 0].all()
    assert found[0].measured[:380, 1].all()
    assert not found[0].measured[380:, 1].any()


def test_runs_with_very_many_readings_are_apart(monkeypatch):
    runs = [run(f"{k}.csv", 400) for k in range(5)]
    monkeypatch.setattr(limits, "GROUP_READINGS", 2 * 400 * len(SENSORS))
    assert [len(group.runs) for group in groups(runs)] == [2, 2, 1]
    assert sorted(k for group in groups(runs) for k in group.runs) == list(range(5))
    # A single run is never divided.
    monkeypatch.setattr(limits, "GROUP_READINGS", 10)
    assert [group.runs for group in groups(runs)] == [(k,) for k in range(5)]


def test_runs_of_different_interval_never_share_a_group():
    found = groups([run("a", 400), run("b", 1000, 0.002), run("c", 400), run("d", 200, 0.01)])
    assert [(g.runs, g.interval_s, g.samples) for g in found] == [
        ((1,), 0.002, 1000),
        ((0, 2), 0.005, 400),
        ((3,), 0.01, 200),
    ]


def test_channels_that_some_runs_lack():
    full, poor = run("a", 300), run("b", 300)
    poor = replace(poor, log=replace(poor.log, channels=poor.log.channels[2:5]))
    layout = channel_layout((poor, full))
    assert {s.column for s in layout.sensors} == {s.column for s in SENSORS}
    assert [s.kind for s in layout.sensors] == [s.kind for s in SENSORS]
    found = group_runs(campaign([poor, full]), layout)[0]
    columns = [s.column for s in layout.sensors]
    for k, sensor in enumerate(SENSORS):
        place = columns.index(sensor.column)
        assert found.measured[:, 1, place].all()
        assert found.measured[:, 0, place].all() == (2 <= k < 5)


def test_a_layout_without_one_kind():
    accelerations = empty_run("a", 5.0, sensors=SENSORS[3:6])
    layout = channel_layout((accelerations,))
    assert layout.deflection_axles == ()
    assert layout.acceleration_axles == (0, 1, 2)
    assert layout.body_points == []


def test_an_all_nan_channel_is_not_measured_and_an_empty_run_is_left_out():
    dead = with_values(run("dead", 100), np.full((100, 8), np.nan))
    half = np.zeros((100, 8))
    half[:, 3] = np.nan
    found = groups([dead, with_values(run("half", 100), half)])
    assert [g.runs for g in found] == [(1,)]
    assert not found[0].measured[:, 0, 3].any()
    assert found[0].measured[:, 0, 2].all()


def test_no_usable_run_is_said_in_words():
    dead = with_values(run("dead", 100), np.full((100, 8), np.nan))
    with pytest.raises(DataRejectedError, match="nothing to fit"):
        groups([dead])


def test_a_clock_of_another_phase_is_not_moved_onto_the_grid():
    """Two clocks of one rate, 0.4 steps apart: a line read by the second stands on the steps of the first."""
    time = 0.005 * np.arange(400)
    first, second = channel(time, time.copy()), channel(time + 0.002, 3.0 * (time + 0.002))
    phase = grid_phase((first, second), 0.005)
    assert phase == pytest.approx(0.0, abs=1e-9)
    value, measured, _ = on_grid(second, 400, 0.005, phase)
    assert not measured[0]
    assert measured[1:].all()
    assert value[1:] == pytest.approx(3.0 * time[1:], abs=1e-12)
    # A phase that all channels share shifts the run, and nothing is interpolated.
    alone = grid_phase((second,), 0.005)
    value, measured, _ = on_grid(second, 400, 0.005, alone)
    assert measured.all()
    assert np.array_equal(value, second.value)


def test_a_clock_that_a_fit_has_found_is_not_rounded_to_the_grid():
    # 1.5 % of an interval late: readings of the first logger count as if on the grid, those of a second one do not.
    run = empty_run("two.csv", 8.0, samples=60)
    late = 0.015 * run.log.sample_interval_s
    ramp = [
        replace(c, time_s=c.time_s + late * (k == 1), value=c.time_s + late * (k == 1))
        for k, c in enumerate(run.log.channels)
    ]
    for logger, expected in (("", late), ("b", 0.0)):
        ramp[1] = replace(ramp[1], sensor=replace(ramp[1].sensor, logger=logger))
        data = campaign([replace(run, log=replace(run.log, channels=tuple(ramp)))])
        layout = channel_layout(data.bump_runs)
        (group,) = group_runs(data, layout)
        c = [s.column for s in layout.sensors].index(ramp[1].sensor.column)
        grid = run.log.sample_interval_s * np.arange(group.samples)
        inside = group.measured[:, 0, c]
        assert inside[1:59].all()
        np.testing.assert_allclose(group.value[inside, 0, c] - grid[inside], expected, atol=1e-12)
