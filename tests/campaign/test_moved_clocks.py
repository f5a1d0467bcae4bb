"""Stamps of further loggers where a fit has their clocks: the sentence of the settings, worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from rigid_truck import campaign, empty_run

from sysid.campaign.clocks.moved import on_moved_clocks
from sysid.campaign.loggers import ClockFinding

#: The rate turns about 0.5 + 0.2 = 0.7 s of the run.
FOUND = ClockFinding("a.csv", "b.csv", "b", "motion", 0.2, 1e-3, 0.5, 0.0, 1e-4)


def two_loggers():
    run = empty_run("a.csv", 6.0, samples=200)
    channels = tuple(
        replace(c, sensor=replace(c.sensor, logger="b")) if k % 2 else c for k, c in enumerate(run.log.channels)
    )
    return replace(campaign([replace(run, log=replace(run.log, channels=channels))]), clocks=(FOUND,))


def test_stamps_of_the_logger_move_and_no_others() -> None:
    before = two_loggers()
    after = on_moved_clocks(before, [replace(FOUND, moved_s=0.002, moved_rate=0.01)])
    (old,), (new,) = before.bump_runs, after.bump_runs
    for k, (was, channel) in enumerate(zip(old.log.channels, new.log.channels, strict=True)):
        expected = was.time_s + 0.002 + 0.01 * (was.time_s - 0.7) if k % 2 else was.time_s
        np.testing.assert_allclose(channel.time_s, expected, atol=1e-15)
        np.testing.assert_array_equal(channel.value, was.value)
    # The last stamps went on, the grid does not.
    assert max(c.time_s[-1] for c in new.log.channels) > old.log.duration_s
    assert new.log.duration_s == old.log.duration_s


def test_a_second_move_counts_from_the_first() -> None:
    far = [replace(FOUND, moved_s=0.002)]
    once = on_moved_clocks(two_loggers(), far)
    again = on_moved_clocks(on_moved_clocks(two_loggers(), [replace(FOUND, moved_s=-0.001)]), far)
    for one, other in zip(once.bump_runs[0].log.channels, again.bump_runs[0].log.channels, strict=True):
        np.testing.assert_allclose(one.time_s, other.time_s, atol=1e-15)
    assert again.clocks == once.clocks


def test_clocks_that_are_not_used_stay() -> None:
    before = two_loggers()
    assert on_moved_clocks(before, ()) is before
    wrong = replace(FOUND, complaint="is not used", moved_s=0.5)
    after = on_moved_clocks(replace(before, clocks=(wrong,)), [wrong])
    np.testing.assert_array_equal(after.bump_runs[0].log.channels[1].time_s, before.bump_runs[0].log.channels[1].time_s)
