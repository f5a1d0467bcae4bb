"""Sensors of pitch rate against the frame's own motion: a rigid body turns as its points rise.

A point of a body at x_m rises as z = z_0 - theta x, nose up. The accelerations of its points, from frame accelerometers
and from axle accelerations with the deflections above them, give the pitch acceleration; over i omega it is the rate.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid import limits
from sysid.campaign.quality.exchanges import Suspicion, accuse, quoted
from sysid.campaign.quality.sensor_trios import trios
from sysid.campaign.records import Channel, Log, Sensor
from sysid.campaign.vehicle_records import Vehicle
from sysid.wording import shorten

#: Below, drift; above, frames bend [Hz].
_BAND_HZ = (0.7, 5.0)
#: Share of the power that is common to both from which they show the same motion, and below which they do not.
_SAME, _OTHER = 0.8, 0.1
#: |ln| of a factor that no calibration explains, and by which a unit explains it.
_OFF, _UNIT = 0.25, 0.3
_LEAST_M = 1.0  # distance between the points that show the pitch


def pitch_rate_suspicions(
    log: Log, channels: Sequence[Channel], vehicle: Vehicle, accused: frozenset[str]
) -> dict[str, list[Suspicion]]:
    """Suspicions about the pitch-rate channels of one log, by column.

    Parameters
    ----------
    log : for its sample interval and duration.
    channels : those that can be used.
    accused : columns that are suspected already; they are no witnesses.
    """
    suspects: dict[str, list[Suspicion]] = {}
    rates = [c for c in channels if c.sensor.kind == "pitch_rate" and _whole(c)]
    step = log.sample_interval_s
    if not rates or log.duration_s / step > limits.GRID_STEPS:
        return suspects
    grid = np.arange(0.0, log.duration_s, step)
    frequency = np.fft.rfftfreq(grid.size, step)
    band = (frequency >= _BAND_HZ[0]) & (frequency <= min(_BAND_HZ[1], 0.4 / step))
    omega = 2.0 * np.pi * frequency[band]
    if omega.size < 10:
        return suspects
    witnesses = [c for c in channels if c.sensor.column not in accused and _whole(c)]
    points = _frame_points(witnesses, vehicle, grid, band, omega)
    for channel in rates:
        body = channel.sensor.body
        x = np.array([at for b, at, _ in points if b == body])
        if x.size < 2 or np.ptp(x) < _LEAST_M:
            continue
        design = np.stack([np.ones(x.size), -(x - x.mean())], axis=1)
        motion = np.linalg.lstsq(design, np.array([s for b, _, s in points if b == body]), rcond=None)[0]
        expected, shown = motion[1] / (1j * omega), _spectrum(channel, grid, band)
        common = float(np.real(np.vdot(expected, shown)))
        sizes = _power(expected), _power(shown)
        if min(sizes) > 0.0:
            sentence, rejected = _sentence(channel.sensor, common / sizes[0], common**2 / (sizes[0] * sizes[1]), x.size)
            if sentence:
                accuse(suspects, channel.sensor, sentence, rejected)
    return suspects


def _sentence(sensor: Sensor, factor: float, same: float, points: int) -> tuple[str, bool]:
    """What a factor on the expected rate says, with the share of power that is the same; empty where all is well."""
    name, others = quoted(sensor), "the other sensors of its body"
    if same < _OTHER and points > 2:
        return (
            f"{name} does not turn as the points of its body rise and fall: it holds no pitch rate of that body; check "
            "its axis (pitch, not roll or yaw) and its body in campaign.toml.",
            True,
        )
    if same < _SAME:
        return "", False
    size, flipped = float(np.log(abs(factor))), factor < 0.0
    unit = next((u for u, f in _UNITS.get(sensor.unit, {}).items() if abs(size - np.log(f)) < _UNIT), None)
    if unit is not None:
        also = " and its sign is flipped" if flipped else ""
        return (
            f"{name} reads {abs(factor):.3g} times what {others} imply: the file is in {shorten(unit)}, not in "
            f'{sensor.unit}{also}; set unit = "{unit}" for it in campaign.toml.',
            True,
        )
    if flipped:
        return (
            f"{name} turns opposite to what {others} show: its sign is flipped (+ is nose up); set sign = "
            f"{-sensor.sign} for it in campaign.toml.",
            True,
        )
    if abs(size) > _OFF:
        return f"{name} reads {factor:.2g} times what {others} imply; check its calibration.", False
    return "", False


_DEGREE = np.pi / 180.0
#: By declared unit: the units that a file may be in, and how many times too much is read then.
_UNITS = {
    "deg/s": {"rad/s": _DEGREE, "mrad/s": 1e3 * _DEGREE},
    "°/s": {"rad/s": _DEGREE, "mrad/s": 1e3 * _DEGREE},
    "rad/s": {"deg/s": 1.0 / _DEGREE, "mrad/s": 1e3},
    "mrad/s": {"rad/s": 1e-3, "deg/s": 1e-3 / _DEGREE},
}


def _frame_points(
    channels: Sequence[Channel], vehicle: Vehicle, grid: np.ndarray, band: np.ndarray, omega: np.ndarray
) -> list[tuple[int, float, np.ndarray]]:
    """Points of bodies: body, x [m], and the spectrum of their acceleration."""
    points = [
        (c.sensor.body, c.sensor.x_m, _spectrum(c, grid, band))
        for c in channels
        if c.sensor.kind == "body_acceleration" and c.sensor.body is not None and c.sensor.x_m is not None
    ]
    for trio in trios(channels, vehicle):
        axle = vehicle.axles[trio.axle]
        above = _spectrum(trio.axle_acceleration, grid, band) - omega**2 * _spectrum(trio.deflection, grid, band)
        points.append((axle.body, axle.x_m, above))
    return points


def _whole(channel: Channel) -> bool:
    """Whether a channel has all of its readings: nothing is made up across a gap here."""
    steps = np.diff(channel.time_s)
    return bool(
        channel.value.size > 20
        and np.isfinite(channel.value).mean() > 0.995
        and not channel.censored.any()
        and steps.max() < 3.0 * np.median(steps)
    )


def _spectrum(channel: Channel, grid: np.ndarray, band: np.ndarray) -> np.ndarray:
    good = np.isfinite(channel.value)
    value = np.interp(grid, channel.time_s[good], channel.value[good])
    return np.asarray(np.fft.rfft((value - np.median(value)) * np.hanning(grid.size))[band])


def _power(spectrum: np.ndarray) -> float:
    return float(np.sum(np.abs(spectrum) ** 2))
