"""The speed of the truck as its own sensors log it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from sysid.campaign.records import Channel, Log

#: A truck that is slower than this stands: it crosses no bump [m/s].
STANDING_M_S = 0.3
#: Readings this near the bump count [s]: a GPS writes one or more per second, and shows it late.
_AROUND_S = 1.0


def speed_channels(log: Log) -> tuple[Channel, ...]:
    """Channels of a log that hold the speed of the truck."""
    return tuple(c for c in log.auxiliary if c.sensor.kind == "speed")


def speed_at_bump(log: Log) -> float | None:
    """Median [m/s] of the logged speed where the truck shakes most, None where no sensor shows that it moves."""
    return _median(value for c in speed_channels(log) if (value := _near(c, shaken_at(log.channels))) is not None)


def _median(values: Iterable[float]) -> float | None:
    known = list(values)
    return float(np.median(known)) if known else None


def shaken_at(channels: Iterable[Channel]) -> float | None:
    """Time [s] of the largest acceleration, as the median of all sensors."""
    times = []
    for channel in channels:
        good = np.isfinite(channel.value)
        if channel.sensor.dimension == "acceleration" and good.any():
            off = np.abs(channel.value - np.median(channel.value[good]))
            times.append(float(channel.time_s[np.nanargmax(off)]))
    return _median(times)


def _near(channel: Channel, time_s: float | None) -> float | None:
    """Median of the readings near a time, or of all while the truck moves."""
    moves = np.isfinite(channel.value) & (np.abs(channel.value) > STANDING_M_S)
    if not moves.any():
        return None
    time, value = channel.time_s[moves], np.abs(channel.value[moves])
    if time_s is None:
        return float(np.median(value))
    near = np.abs(time - time_s) < max(_AROUND_S, float(np.abs(time - time_s).min()) * 1.001)
    return float(np.median(value[near]))
