"""Sensors on the left and right of the same place become one channel, their mean."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sysid.campaign.gaps import readings_at
from sysid.campaign.records import AUXILIARY_KINDS, Channel
from sysid.wording import shorten

SIDE_DISAGREEMENT = 0.3  # roll makes left and right differ by less than this on a bump taken straight


def join_sides(channels: list[Channel], label: str, messages: list[str]) -> list[Channel]:
    """Channels with every pair replaced by its mean; what is to be said about pairs goes to `messages`."""
    result: list[Channel] = []
    used: set[int] = set()
    for i, one in enumerate(channels):
        if i in used:
            continue
        other = next((j for j in range(i + 1, len(channels)) if j not in used and _is_pair(one, channels[j])), None)
        if other is None:
            result.append(one)
            continue
        used.add(other)
        result.append(_mean_of_sides(one, channels[other], label, messages))
    return result


def _is_pair(one: Channel, two: Channel) -> bool:
    a, b = one.sensor, two.sensor
    place = (a.kind, a.axle, a.body, a.x_m) == (b.kind, b.axle, b.body, b.x_m)
    return place and {a.side, b.side} == {"left", "right"}


def _mean_of_sides(one: Channel, two: Channel, label: str, messages: list[str]) -> Channel:
    names = f"'{shorten(one.sensor.column)}' and '{shorten(two.sensor.column)}'"
    for dead, alive in ((one, two), (two, one)):
        seen = dead.value[np.isfinite(dead.value)]
        still = one.sensor.kind not in AUXILIARY_KINDS and seen.size > 0 and np.ptp(seen) == 0.0
        if seen.size < 0.5 * dead.value.size or still:
            messages.append(
                f"{label}: of the pair {names} only '{shorten(alive.sensor.column)}' is used; the other side shows "
                "nothing."
            )
            return alive
    two = _at_times_of(one, two)
    mean = 0.5 * (one.value + two.value)
    difference = one.value - two.value
    both = np.isfinite(mean)
    if both.sum() > 1:
        # What does not vibrate is compared by its level.
        size_of = _rms if one.sensor.kind in AUXILIARY_KINDS else np.std
        spread, size = float(size_of(difference[both])), float(size_of(mean[both]))
        if spread > SIDE_DISAGREEMENT * 2.0 * size:
            messages.append(
                f"{label}: left and right ({names}) differ by {spread / max(size, 1e-300):.1f} times the size of their "
                "mean; check sign, unit and mounting of both sensors."
            )
    # A bound on one side bounds the mean only if the other side does not point the opposite way.
    upper = (one.censored == 1) | (two.censored == 1)
    lower = (one.censored == -1) | (two.censored == -1)
    mean[upper & lower] = np.nan
    censored = np.where(upper, 1, np.where(lower, -1, 0)).astype(np.int8)
    censored[upper & lower] = 0
    scales = [s.full_scale for s in (one.sensor, two.sensor) if s.full_scale is not None]
    sensor = replace(
        one.sensor,
        column=f"{one.sensor.column}+{two.sensor.column}",
        side=None,
        full_scale=min(scales) if len(scales) == 2 else None,
    )
    return Channel(sensor, one.time_s, mean, censored)


def _at_times_of(one: Channel, two: Channel) -> Channel:
    """The second channel at the times of the first, where it has another clock; clipped readings stay clipped."""
    if one.time_s.size == two.time_s.size and np.array_equal(one.time_s, two.time_s):
        return two
    nearest = np.clip(np.searchsorted(two.time_s, one.time_s), 0, two.time_s.size - 1)
    value = readings_at(two, one.time_s)
    return replace(two, time_s=one.time_s, value=value, censored=np.where(np.isfinite(value), two.censored[nearest], 0))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
