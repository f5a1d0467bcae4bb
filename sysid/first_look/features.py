"""How the columns of one log behave: rest, noise, size, frequencies, arrival, and which three belong to one axle.

The second derivative of a suspension deflection is the acceleration of the frame minus that of the axle below,
q'' = b - a.  Among all threes of columns those that belong to one axle fulfil it, whatever their names say; the factors
tell the units, their signs which of them is upside down.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.campaign.gaps import Window, parted, readings_at, window_over
from sysid.campaign.quality import defects
from sysid.campaign.quality.sensor_trios import BAND_HZ, PAIR_BAND_HZ, arrival, first_lift
from sysid.campaign.records import Channel, Sensor
from sysid.logs.channels import RawChannel

#: Wheel hop [Hz], where an axle moves more than the frame above it.
HOP_HZ = (6.0, 20.0)
#: Columns of a log that are compared in threes, and steps of the grid on which they are.
MOST_COMPARED = 48
_MOST_STEPS = 200_000
_ALIVE = 6.0  # largest departure over noise
_LEAST_SAMPLES = 40
_LEAST_SECONDS = 15
_SEEN = 0.7  # share of a log that a column must have seen to be compared
_COLLINEAR = 0.999  # correlation of two columns beyond which their factors mean nothing


@dataclass(frozen=True)
class Look:
    """Behaviour of one column in the unit of the file; None where it cannot be told.

    `middle` is its median.  `rest` and `noise` are those of its quiet start, `size` its largest departure from rest,
    `hop_share` the share of its power in the band of wheel hop, `arrival_s` when it first moves, `lift` how clearly it
    rises first (1) or falls (-1).  `steady` is the median over the largest of its spreads in single seconds, 0 where it
    has fewer than 15: that of a drive over a road is about a half, that of a passage over a bump far less.
    """

    name: str
    unit: str | None
    rate_hz: float
    samples: int
    duration_s: float
    rest: float = 0.0
    noise: float = 0.0
    size: float = 0.0
    hop_share: float = 0.0
    arrival_s: float | None = None
    lift: float = 0.0
    alive: bool = False
    middle: float = 0.0
    steady: float = 0.0


@dataclass(frozen=True)
class Threes:
    """Fit of q'' = beta b - alpha a for all threes of the columns `names` (n), and of q'' = -alpha a for all pairs.

    `unexplained` (q, a, b) is the share of q'' that is left, NaN where two are alike; `alpha`, `beta` (q, a, b) in
    units of the file.  `pair_unexplained`, `pair_alpha` (q, a) are those of pairs in the band of wheel hop, where the
    frame moves little.
    """

    names: tuple[str, ...]
    unexplained: np.ndarray
    alpha: np.ndarray
    beta: np.ndarray
    pair_unexplained: np.ndarray
    pair_alpha: np.ndarray


def looks(channels: Sequence[RawChannel]) -> tuple[Look, ...]:
    """Behaviour of every column of a log."""
    plain = [_channel(c) for c in channels]
    start = defects.motion_start(defects.motion_starts([c for c in plain if c.value.size >= _LEAST_SAMPLES]))
    return tuple(_look(raw, channel, start) for raw, channel in zip(channels, plain, strict=True))


def _channel(raw: RawChannel) -> Channel:
    good = np.isfinite(raw.clock.time_s)
    time, value = raw.clock.time_s[good], raw.values[good].copy()
    forward = np.concatenate([[True], np.diff(time) > 0.0]) if time.size else np.zeros(0, bool)
    time, value = time[forward], value[forward]
    # Kind and unit are what is looked for: the record only carries the readings.
    channel = Channel(Sensor(raw.name, "axle_acceleration", "m/s^2"), time, value, np.zeros(value.size, np.int8))
    beside, place = parted(channel)
    value[np.isin(place, defects.spikes(beside.value))] = np.nan
    return channel


def _look(raw: RawChannel, channel: Channel, start_s: float | None) -> Look:
    good = np.isfinite(channel.value)
    time, value = channel.time_s[good], channel.value[good]
    steps = np.diff(time)
    step = float(np.median(steps)) if steps.size else 0.0
    told = (raw.name, raw.unit, 1.0 / step if step > 0.0 else 0.0, int(value.size))
    duration = float(time[-1] - time[0]) if time.size else 0.0
    if value.size < _LEAST_SAMPLES or step <= 0.0 or np.ptp(value) == 0.0:
        return Look(*told, duration, middle=float(np.median(value)) if value.size else 0.0)
    # The first axle moves before most columns do: its rest ends with its own first motion.
    channel_s = defects.motion_start(defects.motion_starts([channel]))
    starts = [s for s in (channel_s, start_s) if s is not None]
    rest, noise = defects.rest_of(defects.quiet_readings(channel, min(starts, default=None)))
    if rest is None or noise is None:
        rest, noise = float(np.median(value)), float(np.std(np.diff(value, 2)) / np.sqrt(6.0))
    size = float(np.max(np.abs(value - rest)))
    moved = arrival(channel, rest)
    return Look(
        *told,
        duration,
        rest,
        noise,
        size,
        _share(channel, step),
        moved,
        0.0 if moved is None else first_lift(channel, rest, moved),
        size > _ALIVE * noise,
        float(np.median(value)),
        _steadiness(time, value),
    )


def _steadiness(time: np.ndarray, value: np.ndarray) -> float:
    second = (time - time[0]).astype(int)
    count = np.bincount(second)
    if count.size < _LEAST_SECONDS:
        return 0.0
    seen = count >= 0.5 * np.median(count)
    number = np.maximum(count, 1)
    mean = np.bincount(second, value) / number
    spread = np.sqrt(np.bincount(second, (value - mean[second]) ** 2) / number)[seen]
    return float(np.median(spread) / spread.max()) if spread.size and spread.max() > 0.0 else 0.0


def _share(channel: Channel, step: float) -> float:
    """Share of the power between 0.3 and 40 Hz that lies in the band of wheel hop."""
    count = int((channel.time_s[-1] - channel.time_s[0]) / step) + 1
    if count > _MOST_STEPS:
        return 0.0
    time = channel.time_s[0] + step * np.arange(count)
    value = readings_at(channel, time, HOP_HZ[1])
    window = window_over(time, [value])
    if window is None:
        return 0.0
    frequency = np.fft.rfftfreq(count, step)
    power = np.abs(window.transform(value, 2.0 * np.pi * frequency)) ** 2
    total = float(power[(frequency > 0.3) & (frequency < 40.0)].sum())
    hop = float(power[(frequency >= HOP_HZ[0]) & (frequency <= HOP_HZ[1])].sum())
    return hop / total if total > 0.0 else 0.0


def threes(channels: Sequence[RawChannel], seen: Sequence[Look]) -> Threes | None:
    """Fit of all threes and pairs of living columns of a log; None where there are too few or the log is too short."""
    chosen = [(_channel(c), look) for c, look in zip(channels, seen, strict=True) if look.alive][:MOST_COMPARED]
    if len(chosen) < 2:
        return None
    step = max(1.0 / look.rate_hz for _, look in chosen)
    begin = max(float(c.time_s[0]) for c, _ in chosen)
    end = min(float(c.time_s[-1]) for c, _ in chosen)
    count = int((end - begin) / step) + 1
    if count < _LEAST_SAMPLES or count > _MOST_STEPS or step > 0.4 / BAND_HZ[1] or count * step < 1.0:
        return None
    grid = begin + step * np.arange(count)
    readings = [(readings_at(c, grid, BAND_HZ[1]), look) for c, look in chosen]
    # A column that lost half of its record would take it from all others.
    members = [(r, look) for r, look in readings if np.isfinite(r).mean() > _SEEN]
    window = window_over(grid, [r for r, _ in members]) if len(members) > 1 else None
    if window is None:
        return None
    broad, narrow = (_scaled(*_spectra([r for r, _ in members], window, band)) for band in (BAND_HZ, PAIR_BAND_HZ))
    if broad is None or narrow is None:
        return None
    return Threes(tuple(look.name for _, look in members), *_of_threes(broad), *_of_pairs(narrow))


def _spectra(
    readings: Sequence[np.ndarray], window: Window, band_hz: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Columns as accelerations and as deflections differentiated twice, at the level of velocity (see
    :func:`sysid.campaign.quality.sensor_trios.fit_factors`): real and imaginary parts (2 F, n)."""
    step = float(window.time_s[1] - window.time_s[0])
    frequency = np.fft.rfftfreq(window.time_s.size, step)
    omega = 2.0 * np.pi * frequency[(frequency >= band_hz[0]) & (frequency <= min(band_hz[1], 0.4 / step))]
    plain, twice = (
        np.stack([window.transform(r, omega, derivative) / omega for r in readings], axis=1) for derivative in (0, 2)
    )
    return tuple(np.concatenate([s.real, s.imag]) for s in (plain, twice))  # type: ignore[return-value]


@dataclass(frozen=True)
class _Correlations:
    """Correlations between columns as accelerations (a, b), of deflections differentiated twice with them (q, a), and
    the factor from each column's unit length to its own (q, a)."""

    alike: np.ndarray
    with_deflection: np.ndarray
    gain: np.ndarray


def _scaled(predictors: np.ndarray, targets: np.ndarray) -> _Correlations | None:
    scale, size = np.linalg.norm(predictors, axis=0), np.linalg.norm(targets, axis=0)
    if predictors.shape[0] < 12 or not (np.all(scale > 0.0) and np.all(size > 0.0)):
        return None
    predictors, targets = predictors / scale, targets / size
    return _Correlations(predictors.T @ predictors, targets.T @ predictors, size[:, None] / scale[None, :])


def _of_threes(c: _Correlations) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unexplained share, alpha and beta (q, a, b)."""
    a, b = c.with_deflection[:, :, None], c.with_deflection[:, None, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = 1.0 - c.alike[None] ** 2
        of_a = (a - c.alike[None] * b) / determinant
        of_b = (b - c.alike[None] * a) / determinant
        left = 1.0 - of_a * a - of_b * b
    left[:, np.abs(c.alike) > _COLLINEAR] = np.nan
    index = np.arange(c.with_deflection.shape[0])
    left[index, index, :] = np.nan
    left[index, :, index] = np.nan
    result = (np.clip(left, 0.0, 1.0), -of_a * c.gain[:, :, None], of_b * c.gain[:, None, :])
    # All threes of many logs are kept at once.
    return result[0].astype(np.float32), result[1].astype(np.float32), result[2].astype(np.float32)


def _of_pairs(c: _Correlations) -> tuple[np.ndarray, np.ndarray]:
    """Unexplained share and alpha (q, a)."""
    left = 1.0 - c.with_deflection**2
    np.fill_diagonal(left, np.nan)
    return left, -c.with_deflection * c.gain
