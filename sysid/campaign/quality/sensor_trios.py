"""What the sensors of one axle say about each other: wrong units, flipped signs, exchanged columns.

The second derivative of a suspension deflection is the acceleration of the frame minus that of the axle below,
q'' = beta b - alpha a.  Both factors are 1 if all three sensors are right.  If one of them reads f times the truth the
factors change in a way of its own: deflection alpha = beta = f, axle alpha = 1/f, frame beta = 1/f.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid import limits
from sysid.campaign.gaps import Window, is_whole, readings_at, window_over
from sysid.campaign.records import Channel
from sysid.campaign.vehicle_records import Vehicle

BAND_HZ = (1.0, 10.0)  # below, drift is integrated twice; above, the displacement sensor shows noise only
PAIR_BAND_HZ = (5.0, 15.0)  # wheel hop, where the frame moves little
REACH_M = 0.5  # a frame sensor this near to the axle counts as above it
HOP_HZ = (6.0, 20.0)  # where an axle moves more than the frame above it
EXPLAINED_MORE = 0.05  # of the power of q'': a third too much of one of two accelerations of like size
LEAST_S = 1.0  # a cycle of the lowest frequency of BAND_HZ
_BEFORE_ARRIVAL_S = 0.2  # a wheel at 10 km/h rolls over a bump of half a metre in this time
RATE_NEEDED_HZ = 25.0  # two and a half samples per cycle of the highest frequency of BAND_HZ


@dataclass(frozen=True)
class Trio:
    """Sensors of one axle: deflection, axle acceleration and the frame acceleration above it, None if there is none."""

    axle: int
    deflection: Channel
    axle_acceleration: Channel
    body_acceleration: Channel | None

    @property
    def channels(self) -> list[Channel]:
        """The channels there are, deflection first."""
        return [c for c in (self.deflection, self.axle_acceleration, self.body_acceleration) if c is not None]


@dataclass(frozen=True)
class Fit:
    """Factors alpha (axle) and beta (frame) with standard errors, and the share of q'' that they leave unexplained.

    `unexplained_by_one` is the share that factors of 1 leave.
    """

    alpha: float
    alpha_se: float
    beta: float
    beta_se: float
    unexplained: float
    unexplained_by_one: float

    @property
    def right(self) -> bool:
        """Whether both factors are compatible with 1, or other factors explain hardly more.

        A sensor that moves little while all three are seen has a factor that its noise makes too small.
        """
        if self.unexplained_by_one < self.unexplained + EXPLAINED_MORE:
            return True
        return abs(self.alpha - 1.0) < max(0.3, 4.0 * self.alpha_se) and (
            abs(self.beta - 1.0) < max(0.3, 4.0 * self.beta_se)
        )

    @property
    def clear(self) -> bool:
        """Whether the factors are known well enough to accuse a sensor."""
        return abs(self.alpha) > 6.0 * self.alpha_se and (
            abs(self.beta) > 6.0 * self.beta_se or not np.isfinite(self.beta_se)
        )


def trios(channels: Sequence[Channel], vehicle: Vehicle) -> list[Trio]:
    """Deflection, axle and frame sensors that belong together: one entry per axle that has the first two, in order."""
    result: list[Trio] = []
    for q in channels:
        if q.sensor.kind != "suspension_deflection" or q.sensor.axle is None:
            continue
        axle = vehicle.axles[q.sensor.axle]
        a = next(
            (c for c in channels if c.sensor.kind == "axle_acceleration" and c.sensor.axle == q.sensor.axle),
            None,
        )
        if a is None or any(t.axle == q.sensor.axle for t in result):
            continue
        above = [
            (abs(c.sensor.x_m - axle.x_m), i)
            for i, c in enumerate(channels)
            if c.sensor.kind == "body_acceleration" and c.sensor.body == axle.body and c.sensor.x_m is not None
        ]
        nearest = min(above, default=None)
        b = channels[nearest[1]] if nearest is not None and nearest[0] <= REACH_M else None
        result.append(Trio(q.sensor.axle, q, a, b))
    return sorted(result, key=lambda t: t.axle)


def fit_factors(q: Channel, a: Channel, b: Channel | None, step_s: float) -> Fit | None:
    """Fit alpha and beta of q'' = beta b - alpha a in the band of body and hop motion.

    Spectra are compared at the level of velocity, divided by omega, so that neither drift (low) nor displacement noise
    (high) weighs too much.

    Parameters
    ----------
    q, a, b : deflection [m], axle and frame acceleration [m/s^2]; without `b` the frame is taken as still and the band
        is that of wheel hop.
    step_s : sample interval [s].

    Returns
    -------
    Fit or None
        None where the channels share too short a record.
    """
    members = [q, a] + ([] if b is None else [b])
    low, high = PAIR_BAND_HZ if b is None else BAND_HZ
    seen = _seen_together(members, step_s, high)
    if seen is None:
        return None
    window, readings = seen
    frequency = np.fft.rfftfreq(window.time_s.size, step_s)
    omega = 2.0 * np.pi * frequency[(frequency >= low) & (frequency <= min(high, 0.4 / step_s))]
    if omega.size < 6:
        return None
    spectra = [window.transform(r, omega, 2 * (k == 0)) / omega for k, r in enumerate(readings)]
    target = _stacked(spectra[0])
    columns = [_stacked(-spectra[1])] + ([] if b is None else [_stacked(spectra[2])])
    design = np.stack(columns, axis=1)
    scale = np.linalg.norm(design, axis=0)
    size = float(target @ target)
    if not np.all(scale > 0.0) or size <= 0.0:
        return None
    solution, _, rank, _ = np.linalg.lstsq(design / scale, target, rcond=1e-8)
    if rank < design.shape[1]:
        return None
    residual = target - design / scale @ solution
    variance = float(residual @ residual) / max(1, target.size - design.shape[1])
    error = np.sqrt(np.diag(np.linalg.inv((design / scale).T @ (design / scale))) * variance) / scale
    solution = solution / scale
    return Fit(
        alpha=float(solution[0]),
        alpha_se=float(error[0]),
        beta=float(solution[1]) if b is not None else 1.0,
        beta_se=float(error[1]) if b is not None else np.inf,
        unexplained=float(residual @ residual) / size,
        unexplained_by_one=float(np.sum((target - design.sum(axis=1)) ** 2)) / size,
    )


def hop_size(channel: Channel, step_s: float) -> float:
    """Root mean square of a channel between 6 and 20 Hz, where an axle moves more than the frame above it."""
    seen = _seen_together([channel], step_s, HOP_HZ[1])
    if seen is None:
        return 0.0
    window, (value,) = seen
    frequency = np.fft.rfftfreq(window.time_s.size, step_s)
    omega = 2.0 * np.pi * frequency[(frequency >= HOP_HZ[0]) & (frequency <= HOP_HZ[1])]
    return float(np.sqrt(2.0 * np.sum(np.abs(window.transform(value, omega)) ** 2)) / window.time_s.size)


def arrival(channel: Channel, rest_level: float) -> float | None:
    """Time [s] at which an axle acceleration first exceeds a third of its largest departure from `rest_level`.

    None where that happens in a gap, and where a gap of this channel may hide that it happened before.
    """
    departure = np.abs(channel.value - rest_level)
    good = np.isfinite(departure)
    if good.sum() < 20:
        return None
    time = float(channel.time_s[np.argmax(np.where(good, departure, 0.0) > np.nanmax(departure) / 3.0)])
    return time if is_whole(channel, time - _BEFORE_ARRIVAL_S, time, HOP_HZ[1]) else None


def first_lift(channel: Channel, rest_level: float, arrival_s: float) -> float:
    """How clearly an axle rises (towards +1) or falls (towards -1) when it meets the obstacle; 0 beside a gap.

    The acceleration is integrated twice over 0.35 s around the arrival; the largest departure of the displacement
    from zero decides, relative to the largest one of the other sign.
    """
    begin, end = arrival_s - 0.15, arrival_s + 0.2
    inside = (channel.time_s > begin) & (channel.time_s < end) & np.isfinite(channel.value)
    time, value = channel.time_s[inside], channel.value[inside] - rest_level
    if time.size < 6 or not is_whole(channel, begin, end, HOP_HZ[1]):
        return 0.0
    steps = np.diff(time)
    velocity = np.concatenate([[0.0], np.cumsum(0.5 * steps * (value[1:] + value[:-1]))])
    lift = np.concatenate([[0.0], np.cumsum(0.5 * steps * (velocity[1:] + velocity[:-1]))])
    up, down = float(lift.max()), float(-lift.min())
    return (up - down) / (up + down) if up + down > 0.0 else 0.0


def _seen_together(
    channels: Sequence[Channel], step_s: float, highest_hz: float
) -> tuple[Window, list[np.ndarray]] | None:
    """Readings of several channels at even times, under a window that vanishes where any of them has none."""
    begin, end = max(float(c.time_s[0]) for c in channels), min(float(c.time_s[-1]) for c in channels)
    count = int((end - begin) / step_s) + 1
    if step_s > 1.0 / RATE_NEEDED_HZ or count * step_s < LEAST_S or count > limits.GRID_STEPS:
        return None
    time = begin + step_s * np.arange(count)
    readings = [readings_at(c, time, highest_hz) for c in channels]
    window = window_over(time, readings)
    return None if window is None or window.known_s < LEAST_S else (window, readings)


def _stacked(spectrum: np.ndarray) -> np.ndarray:
    return np.concatenate([spectrum.real, spectrum.imag])
