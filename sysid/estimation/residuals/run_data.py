"""Bump runs as rectangular arrays: groups of runs of similar length, one row of samples on a uniform grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from sysid import limits
from sysid.arrays import SamplesByRunsByChannels
from sysid.campaign.records import BumpRun, Campaign, Channel, Sensor
from sysid.errors import DataRejectedError

#: Share of the interval by which stamps may depart from an even grid and still count as even. Stamps of further loggers
#: are known to microseconds after a fit has found their clocks.
_EVEN, _EVEN_OF_CLOCK = 0.02, 0.001
#: Runs of one group differ in length by less than this share.
_WASTE = 0.15


@dataclass(frozen=True)
class ChannelLayout:
    """Sensors of all bump runs in the order of the simulated channels.

    Deflections first, also those of bellows, then accelerations of axles and bodies, and pitch rates; `sensors` (C,).
    """

    sensors: tuple[Sensor, ...]

    @property
    def deflection_axles(self) -> tuple[int, ...]:
        """Axle index of each deflection channel, by a sensor of its own or by a bellows."""
        return tuple(s.axle for s in self.sensors if s.kind in _KIND_ORDER[:2] and s.axle is not None)

    @property
    def acceleration_axles(self) -> tuple[int, ...]:
        """Axle index of each axle-acceleration channel."""
        return tuple(s.axle for s in self.sensors if s.kind == "axle_acceleration" and s.axle is not None)

    @property
    def body_points(self) -> list[tuple[int, float]]:
        """Body index and x [m] of each body-acceleration channel."""
        return [(int(s.body or 0), float(s.x_m or 0.0)) for s in self.sensors if s.kind == "body_acceleration"]

    @property
    def rate_points(self) -> list[tuple[int, float | None]]:
        """Body index and x [m], if known, of each pitch-rate channel."""
        return [(int(s.body or 0), s.x_m) for s in self.sensors if s.kind == "pitch_rate"]


@dataclass(frozen=True)
class RunGroup:
    """R runs of similar length on one time grid of T samples and C channels.

    `value` (T, R, C) in SI with zeros where nothing was measured; `measured` (T, R, C) bool, True where a plain reading
    exists; `censored` (T, R, C) int8 as in the records.
    """

    runs: tuple[int, ...]
    interval_s: float
    value: SamplesByRunsByChannels
    measured: SamplesByRunsByChannels
    censored: SamplesByRunsByChannels

    @property
    def samples(self) -> int:
        """Number of samples T."""
        return int(self.value.shape[0])


_KIND_ORDER = ("suspension_deflection", "bellows_extension", "axle_acceleration", "body_acceleration", "pitch_rate")


def channel_layout(runs: tuple[BumpRun, ...]) -> ChannelLayout:
    """All sensors that appear in any run, ordered by kind, then as in the log."""
    seen: dict[str, Sensor] = {}
    for run in runs:
        for channel in run.log.channels:
            seen.setdefault(channel.sensor.column, channel.sensor)
    return ChannelLayout(tuple(sorted(seen.values(), key=lambda s: _KIND_ORDER.index(s.kind))))


def grid_phase(channels: Sequence[Channel], interval_s: float) -> float | None:
    """Delay of the grid of a run as a share of the interval: that of its first channel with even stamps."""
    return next((phase for c in channels if (phase := _even_phase(c.time_s / interval_s)) is not None), None)


def _even_phase(position: np.ndarray, near: float = _EVEN) -> float | None:
    """Offset (-1/2 to 1/2) that stamps share, in intervals; None where some are not `near` an even grid."""
    phase = float(np.angle(np.mean(np.exp(2j * np.pi * position))) / (2.0 * np.pi))
    # All stamps are judged, so that every channel of one clock goes the same way.
    even = position - phase
    return phase if bool(np.all(np.abs(even - np.rint(even)) < near)) else None


def on_grid(
    channel: Channel, samples: int, interval_s: float, phase: float | None = None, near: float = _EVEN
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Value, measured mask and censoring (samples,) of one channel on the uniform grid (k + phase) * interval.

    Stamps that are all `near` grid times (in intervals) are treated as being at these times. Without a `phase` (of the
    run), a common offset of the stamps is allowed, which shifts a run as a whole. Other readings are interpolated by a
    cubic spline inside stretches without gaps; clipped readings are put at the nearest grid time.
    """
    value = np.zeros(samples)
    measured = np.zeros(samples, bool)
    censored = np.zeros(samples, np.int8)
    position = channel.time_s / interval_s
    sampled_phase = _even_phase(position, near)
    begin = (sampled_phase or 0.0) if phase is None else phase
    apart = 0.0 if sampled_phase is None else sampled_phase - begin
    regular = sampled_phase is not None and abs(apart - np.rint(apart)) < near
    index = np.rint(position - begin).astype(int)
    inside = (index >= 0) & (index < samples) & np.isfinite(channel.value)
    if regular:
        value[index[inside]] = channel.value[inside]
        censored[index[inside]] = channel.censored[inside]
        measured[index[inside]] = channel.censored[inside] == 0
        return value, measured, censored
    good = np.isfinite(channel.value) & (channel.censored == 0)
    grid = (np.arange(samples) + begin) * interval_s
    stamps, readings = channel.time_s[good], channel.value[good]
    for part in np.split(np.arange(stamps.size), np.flatnonzero(np.diff(stamps) > 1.6 * interval_s) + 1):
        if part.size < 4:
            continue
        within = (grid >= stamps[part[0]]) & (grid <= stamps[part[-1]])
        value[within] = CubicSpline(stamps[part], readings[part])(grid[within])
        measured |= within
    clipped = inside & (channel.censored != 0)
    clipped[clipped] = ~measured[index[clipped]]
    value[index[clipped]] = channel.value[clipped]
    censored[index[clipped]] = channel.censored[clipped]
    return value, measured, censored


def group_runs(campaign: Campaign, layout: ChannelLayout) -> tuple[RunGroup, ...]:
    """Group runs whose lengths differ by less than `_WASTE`, so that padding costs little simulation time.

    A group has no more readings than :data:`sysid.limits.GROUP_READINGS`, unless a single run has.

    Raises
    ------
    DataRejectedError
        If no run has a usable reading.
    """
    runs = campaign.bump_runs
    count = [round(r.log.duration_s / r.log.sample_interval_s) + 1 for r in runs]
    usable = [i for i, r in enumerate(runs) if any(np.isfinite(c.value).any() for c in r.log.channels)]
    if not usable:
        raise DataRejectedError(
            "No bump run has a usable channel, so there is nothing to fit; run the stage 'check' to see why."
        )
    usable.sort(key=lambda i: (runs[i].log.sample_interval_s, -count[i], i))
    members: list[list[int]] = []
    for i in usable:
        if members:
            head = members[-1][0]
            same = np.isclose(runs[head].log.sample_interval_s, runs[i].log.sample_interval_s)
            if same and count[i] >= (1.0 - _WASTE) * count[head]:
                members[-1].append(i)
                continue
        members.append([i])
    groups = []
    for alike in members:
        samples = max(count[i] for i in alike)
        most = max(1, limits.GROUP_READINGS // (samples * len(layout.sensors)))
        # Parts of equal size where that is possible: the reference engine compiles each size.
        parts = np.array_split(np.array(alike), -(-len(alike) // most))
        groups += [_group(campaign, layout, tuple(part.tolist()), samples) for part in parts]
    return tuple(groups)


def _group(campaign: Campaign, layout: ChannelLayout, members: tuple[int, ...], samples: int) -> RunGroup:
    shape = (samples, len(members), len(layout.sensors))
    value, measured, censored = np.zeros(shape), np.zeros(shape, bool), np.zeros(shape, np.int8)
    interval = campaign.bump_runs[members[0]].log.sample_interval_s
    column = {s.column: c for c, s in enumerate(layout.sensors)}
    for r, i in enumerate(members):
        channels = campaign.bump_runs[i].log.channels
        phase = grid_phase(channels, interval)
        for channel in channels:
            c = column[channel.sensor.column]
            near = _EVEN_OF_CLOCK if channel.sensor.logger else _EVEN
            value[:, r, c], measured[:, r, c], censored[:, r, c] = on_grid(channel, samples, interval, phase, near)
    return RunGroup(members, interval, value, measured, censored)
