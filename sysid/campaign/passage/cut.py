"""Long records cut down to the passage: what lies far from it says nothing about the suspension."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.campaign.passage.arrivals import find_passage
from sysid.campaign.passage.speed import believed_speed
from sysid.campaign.records import BumpRun, Campaign, Channel
from sysid.campaign.vehicle_records import Vehicle
from sysid.wording import shorten

#: What is kept before the first axle arrives, for the level at rest, and after the last one has, for the motion that
#: dies away: at 1.2 Hz and a damping ratio of 0.05, which is little, to 5 % (general knowledge).
_BEFORE_S, _AFTER_S = 2.0, 8.0
#: Records up to this many times as long are kept whole.
_LONG = 2.0


def cut_to_passages(campaign: Campaign) -> tuple[Campaign, str]:
    """The campaign with long records of bump runs cut to the passage, and a sentence about it; empty if none was cut.

    A record is cut if it is more than twice as long as the passage with 2 s before and 8 s after it, and its axles show
    when that is. Campaigns with several loggers are left as they are, because clocks are compared over whole records.

    Parameters
    ----------
    campaign : after the quality check.
    """
    if campaign.clocks:
        return campaign, ""
    runs = [_cut(run, campaign.vehicle) for run in campaign.bump_runs]
    pairs = [(old, new) for old, new in zip(campaign.bump_runs, runs, strict=True) if new is not old]
    return (replace(campaign, bump_runs=tuple(runs)), _sentence(pairs)) if pairs else (campaign, "")


def _cut(run: BumpRun, vehicle: Vehicle) -> BumpRun:
    log = run.log
    # The shortest passage of any truck: what is not longer need not be searched.
    if log.duration_s <= _LONG * (_BEFORE_S + _AFTER_S):
        return run
    passage = find_passage(log.channels, vehicle, run.nominal_speed_m_s)
    if passage is None or believed_speed(passage, vehicle) is None:
        return run
    times = [arrival.time_s for arrival in passage.arrivals.values()]
    begin = max(0.0, min(times) - _BEFORE_S)
    # On the grid of the record, so that even stamps stay even.
    begin = round(begin / log.sample_interval_s) * log.sample_interval_s
    end = max(times) + _AFTER_S
    if log.duration_s <= _LONG * (end - begin):
        return run
    # Channels of one clock go on sharing their stamps.
    stamps = {id(c.time_s): c.time_s for c in log.channels}
    kept = {key: (time >= begin - 1e-9) & (time <= end) for key, time in stamps.items()}
    moved = {key: time[kept[key]] - begin for key, time in stamps.items()}
    channels = tuple(_only(c, kept[id(c.time_s)], moved[id(c.time_s)]) for c in log.channels)
    seen = tuple(c for c in channels if np.isfinite(c.value).any())
    others = tuple(replace(c, time_s=c.time_s - begin) for c in log.auxiliary)
    return replace(
        run, log=replace(log, channels=seen, auxiliary=others, start_time_s=log.start_time_s + begin, span_s=None)
    )


def _only(channel: Channel, kept: np.ndarray, time_s: np.ndarray) -> Channel:
    return replace(channel, time_s=time_s, value=channel.value[kept], censored=channel.censored[kept])


def _sentence(pairs: Sequence[tuple[BumpRun, BumpRun]]) -> str:
    before = [old.log.duration_s for old, _ in pairs]
    after = [new.log.duration_s for _, new in pairs]
    which = shorten(pairs[0][0].log.file, 100) if len(pairs) == 1 else f"{len(pairs)} bump runs"
    return (
        f"{which}: of {_range(before)} s, the {_range(after)} s from {_BEFORE_S:g} s before to {_AFTER_S:g} s after "
        "the passage are used."
    )


def _range(values: Sequence[float]) -> str:
    low, high = f"{min(values):.3g}", f"{max(values):.3g}"
    return low if low == high else f"{low} to {high}"
