"""Runs on the clocks of further loggers as a fit has found them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from sysid.campaign.loggers import ClockFinding
from sysid.campaign.records import BumpRun, Campaign


def on_moved_clocks(campaign: Campaign, clocks: Sequence[ClockFinding]) -> Campaign:
    """The campaign with the stamps of further loggers moved as `clocks` says, and readings unchanged.

    Parameters
    ----------
    campaign : its clocks may have been moved already.
    clocks : those of the campaign, moved by a fit; none for a campaign that stays as it is.
    """
    if not clocks:
        return campaign
    before = {(c.file, c.logger): c for c in campaign.clocks}
    moves = {
        (c.file, c.logger): (
            c.moved_s - before[c.file, c.logger].moved_s,
            c.moved_rate - before[c.file, c.logger].moved_rate,
            c.about_s,
        )
        for c in clocks
        if c.is_unknown
    }
    runs = tuple(_moved(run, moves) for run in campaign.bump_runs)
    return replace(campaign, bump_runs=runs, clocks=tuple(clocks))


def _moved(run: BumpRun, moves: dict[tuple[str, str], tuple[float, float, float]]) -> BumpRun:
    channels = []
    for channel in run.log.channels:
        by_s, by_rate, about_s = moves.get((run.log.file, channel.sensor.logger), (0.0, 0.0, 0.0))
        moved = by_s != 0.0 or by_rate != 0.0
        time_s = channel.time_s + by_s + by_rate * (channel.time_s - about_s) if moved else channel.time_s
        channels.append(replace(channel, time_s=time_s))
    # Another length of a record would be another grid, on which weights of readings would not fit.
    return replace(run, log=replace(run.log, channels=tuple(channels), span_s=run.log.duration_s))
