"""Clocks that jump: a sentence from the reader, and memory for the readings alone where a record comes as arrays."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from sysid import limits
from sysid.campaign import Sensor, read_log
from sysid.campaign.quality.sensor_trios import fit_factors, hop_size
from sysid.campaign.records import Channel
from sysid.errors import DataRejectedError
from sysid.sdof import read_decay
from sysid.sdof.time_grid import even_times

SENSOR = Sensor("q_mm", "suspension_deflection", "mm", axle=0)
TIME = 0.005 * np.arange(2000)
DECAY = 0.02 * np.where(TIME > 1.0, np.exp(-0.6 * (TIME - 1.0)) * np.cos(8.0 * (TIME - 1.0)), 1.0)


def written(path: Path, stamps: np.ndarray) -> Path:
    rows = "".join(f"{t:.6f},{1e3 * q:.5f}\n" for t, q in zip(stamps, DECAY, strict=True))
    path.write_text("time_s,q_mm\n" + rows, encoding="utf-8")
    return path


def jumped(seconds: float, at: int = 1500) -> np.ndarray:
    return TIME + np.where(np.arange(TIME.size) >= at, seconds, 0.0)


@pytest.mark.parametrize("seconds", [200.0, 1e5, 1e9, 1e12])
def test_a_clock_that_jumps_is_named_with_its_row(tmp_path: Path, seconds: float) -> None:
    with pytest.raises(DataRejectedError, match="in row 1502: correct the stamps or cut the log") as error:
        read_log(written(tmp_path / "drop.csv", jumped(seconds)), "drop.csv", [SENSOR], 0.005)
    assert "\n" not in str(error.value)


def test_a_pause_that_a_logger_makes_is_read(tmp_path: Path) -> None:
    log = read_log(written(tmp_path / "drop.csv", jumped(30.0)), "drop.csv", [SENSOR], 0.005)
    assert log.duration_s == pytest.approx(TIME[-1] + 30.0)


@pytest.mark.parametrize("seconds", [1e3, 1e6, 1e9, 1e15])
def test_a_decay_with_a_jump_takes_no_memory_for_the_pause(seconds: float) -> None:
    plain = read_decay(TIME[:1500], DECAY[:1500], frequency_range_hz=(0.6, 6.0))
    tracemalloc.start()
    found = read_decay(jumped(seconds), DECAY, frequency_range_hz=(0.6, 6.0))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 300e6
    # The wanted period of the body mode is that of the part before the jump, or nothing is read.
    if found.usable:
        assert found.damped_period == pytest.approx(plain.damped_period, rel=0.02)


def test_a_grid_without_gaps_is_the_plain_one() -> None:
    np.testing.assert_array_equal(even_times(TIME, 0.013, 0.2), np.arange(TIME[0], TIME[-1] + 0.0065, 0.013))


def test_a_grid_over_a_gap_lies_on_the_plain_one_and_leaves_the_gap_out() -> None:
    stamps, step, reach = jumped(300.0), 0.01, 0.2
    found = even_times(stamps, step, reach)
    plain = np.arange(stamps[0], stamps[-1] + 0.5 * step, step)
    at = np.rint((found - stamps[0]) / step).astype(int)
    np.testing.assert_allclose(found, plain[at], atol=1e-9)
    distance = np.abs(plain[:, None] - np.array([stamps[1499], stamps[1500]])).min(axis=1)
    outside = (plain > stamps[1499]) & (plain < stamps[1500])
    needed = plain[~outside | (distance < reach + 2.0 * step)]
    assert np.isin(np.rint(needed / step), np.rint(found / step)).all()
    assert found.size < needed.size + 10
    assert np.all(np.diff(found) > 0.0)


def test_a_grid_has_an_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "GRID_STEPS", 1000)
    found = even_times(TIME, 1e-4, 0.2)
    np.testing.assert_allclose(found, 1e-4 * np.arange(1000), atol=1e-12)
    # A tiny interval must not make the comparison of sensors lay a grid of billions.
    channel = Channel(SENSOR, TIME, DECAY, np.zeros(TIME.size, np.int8))
    assert fit_factors(channel, channel, None, 1e-9) is None
    assert hop_size(channel, 1e-9) == 0.0
