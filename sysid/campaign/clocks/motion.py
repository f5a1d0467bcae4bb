"""Difference between the clocks of two loggers, from the motion of the bodies that both record.

Every frame sensor, and every axle acceleration with the deflection above it (a + q''), shows the vertical acceleration
of a body at one place.  With rigid bodies and hinges these are y(w) = D u(w): D of the places, u the heave and pitch of
the chain.  With the readings y_a of the first logger and y_b of the second, whose stamps lack a lag, and weights W,

    J(lag) = sum_w | Q (W y_a + exp(-i w lag) W y_b) |^2,    Q = I - (W D) (W D)^+,

is smallest at the true lag: what remains is noise and what the frame bends.  It is a cross-correlation, so that all
lags are tried at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.campaign.gaps import readings_at, window_over
from sysid.campaign.records import Channel, SensorKind
from sysid.campaign.vehicle_records import Vehicle

#: Below, drift; above, frames bend and deflections, differentiated twice, are noise.
BAND_HZ = (0.8, 8.0)
#: Noise of ordinary sensors [SI]: only their ratio counts here (an assumption).
_NOISE: dict[SensorKind, float] = {
    "suspension_deflection": 3e-4,
    "axle_acceleration": 0.25,
    "body_acceleration": 0.15,
}
#: Contribution of bending frames, gains and different filters to the standard deviation of the lag [s]. Lags of
#: simulated trucks, also of those of another model, were off by this in addition to the jackknife's value.
MODEL_SD_S = 5e-4
#: Share of the motion that the lag must bring into agreement.
LEAST_SHARE = 0.5
#: If another lag explains more than this share of what the best one explains, the motion is periodic.
RIVAL = 0.93
#: Lags further apart than this, about a cycle of the highest frequency of the band, are other lags.
_APART_S = 0.15
#: Parts of the band that the jackknife leaves out in turn.
_BLOCKS = 8
#: Most sensors that may disagree with the others, and the share of what remains unexplained that must go with each
#: (assumptions).
_MOST_LEFT_OUT, _BETTER = 3, 0.6
#: Longest sample interval: six samples per cycle of the highest frequency of the band.
_SLOWEST_S = 0.02
#: Longest records together: ten minutes at 200 Hz.
_MOST_STEPS = 120_000
#: Range about the coarse lag, which is right to a sample, in which the fine one is searched for: three slow samples.
_NEAR_S = 0.06


@dataclass(frozen=True)
class Lag:
    """Time to add to the stamps of the second log [s], with its standard deviation, at `at_s` of its stamps."""

    lag_s: float
    sd_s: float
    at_s: float


@dataclass(frozen=True)
class _Part:
    channel: Channel
    second: bool
    twice: bool


@dataclass(frozen=True)
class _Observation:
    """Acceleration of a body at one place as sensors of one or both loggers show it; `row` of the design D."""

    row: np.ndarray
    parts: tuple[_Part, ...]


@dataclass(frozen=True)
class _Spectra:
    """Whitened residuals Q W y (frequencies, observations) of both loggers, and their products."""

    omega: np.ndarray
    first: np.ndarray
    second: np.ndarray

    @property
    def product(self) -> np.ndarray:
        return np.asarray(np.sum(np.conj(self.first) * self.second, axis=1))

    @property
    def size(self) -> float:
        return float(np.sum(np.abs(self.first) ** 2) + np.sum(np.abs(self.second) ** 2))


def motion_lag(
    first: Sequence[Channel],
    second: Sequence[Channel],
    vehicle: Vehicle,
    within_s: tuple[float, float] | None = None,
) -> Lag | None:
    """Lag of the second logger's stamps from the motion that both loggers record.

    Parameters
    ----------
    first, second : channels of both logs of one run, each with its own stamps, without defects.
    vehicle : for the places of axles and hinges.
    within_s : expected lag (a guess by other means); it is used if it explains most of what the best lag explains.

    Returns
    -------
    Lag or None
        None where the loggers share no motion, or several lags explain it alike.
    """
    observations = _observations(first, second, vehicle)
    rows = _rows(observations)
    if rows is None:
        return None
    step = max(float(np.median(np.diff(c.time_s))) for c in (*first, *second))
    length = sum(max(float(c.time_s[-1]) for c in cs) - min(float(c.time_s[0]) for c in cs) for cs in (first, second))
    if step > _SLOWEST_S or length / step > _MOST_STEPS:
        return None
    coarse = _coarse(observations, (first, second), step, within_s)
    return None if coarse is None else _fine(*coarse, (first, second), step)


def _observations(first: Sequence[Channel], second: Sequence[Channel], vehicle: Vehicle) -> list[_Observation]:
    whole = [(c, k == 1) for k, cs in enumerate((first, second)) for c in cs if _whole(c)]
    usable = []
    for channel, late in whole:
        sensor = channel.sensor
        if sensor.kind == "body_acceleration" and sensor.body is not None and sensor.x_m is not None:
            row = _row(vehicle, sensor.body, sensor.x_m)
            usable.append(_Observation(row, (_Part(channel, late, False),)))
        elif sensor.kind == "axle_acceleration" and sensor.axle is not None:
            deflection = next(
                (
                    _Part(c, other, True)
                    for c, other in whole
                    if c.sensor.kind == "suspension_deflection" and c.sensor.axle == sensor.axle
                ),
                None,
            )
            if deflection is not None:
                axle = vehicle.axles[sensor.axle]
                row = _row(vehicle, axle.body, axle.x_m)
                usable.append(_Observation(row, (_Part(channel, late, False), deflection)))
    return usable


def _whole(channel: Channel) -> bool:
    good = np.isfinite(channel.value)
    return bool(good.sum() > 50 and good.mean() > 0.97 and not channel.censored.any())


def _row(vehicle: Vehicle, body: int, x_m: float) -> np.ndarray:
    """Vertical motion at a place of a body by the motions of its chain: one per body, and one more per chain."""
    count = len(vehicle.bodies)
    row = np.zeros(2 * count)
    hinge = vehicle.bodies[body].hitch_x_m
    if body == 0 or hinge is None:
        row[count + body], row[body] = 1.0, x_m
    else:
        row = _row(vehicle, body - 1, hinge)
        row[body] += x_m - hinge
    return row


def _rows(observations: Sequence[_Observation]) -> np.ndarray | None:
    """Design D (observations, motions); None where the loggers do not share motion that is redundant."""
    seconds = [{part.second for part in o.parts} for o in observations]
    if not any(True in s for s in seconds) or not any(False in s for s in seconds):
        return None
    design = np.array([o.row for o in observations])
    return design if np.linalg.matrix_rank(design, tol=1e-6) < len(observations) else None


def _spectra(
    observations: Sequence[_Observation], window_s: tuple[tuple[float, float], tuple[float, float]], step: float, n: int
) -> _Spectra:
    """Whitened residual spectra; times count from the begin of each logger's window."""
    frequency = np.fft.rfftfreq(n, step)
    band = (frequency >= BAND_HZ[0]) & (frequency <= min(BAND_HZ[1], 0.4 / step))
    omega = 2.0 * np.pi * frequency[band]
    shape = (omega.size, len(observations))
    parts, variance = np.zeros((2, *shape), complex), np.zeros(shape)
    for k, observation in enumerate(observations):
        for part in observation.parts:
            begin, end = window_s[int(part.second)]
            parts[int(part.second), :, k] += _spectrum(part, begin, end, step, omega, n)
            variance[:, k] += ((omega**2 if part.twice else 1.0) * _NOISE[part.channel.sensor.kind]) ** 2
    weight = 1.0 / np.sqrt(variance)
    design = weight[:, :, None] * np.array([o.row for o in observations])
    left = np.eye(len(observations)) - design @ np.linalg.pinv(design, rcond=1e-9)
    first, second = (np.einsum("fij,fj->fi", left, weight * p) for p in parts)
    return _Spectra(omega, first, second)


def _spectrum(part: _Part, begin: float, end: float, step: float, omega: np.ndarray, n: int) -> np.ndarray:
    """Acceleration (F,) that a channel shows from begin to end, under a window that vanishes in its gaps."""
    time = begin + step * np.arange(int((end - begin) / step) + 1)
    value = readings_at(part.channel, time, BAND_HZ[1])
    window = window_over(time, [value])
    return np.zeros(omega.size) if window is None else window.transform(value, omega, 2 * part.twice, n)


def _span(channels: Sequence[Channel]) -> tuple[float, float]:
    return min(float(c.time_s[0]) for c in channels), max(float(c.time_s[-1]) for c in channels)


def _coarse(
    observations: list[_Observation],
    logs: tuple[Sequence[Channel], Sequence[Channel]],
    step: float,
    within_s: tuple[float, float] | None,
) -> tuple[list[_Observation], float] | None:
    """The lag among all, to a sample, and the observations that agree with each other."""
    windows = _span(logs[0]), _span(logs[1])
    best = _whole_search(observations, windows, step, within_s)
    for _ in range(_MOST_LEFT_OUT):
        fewer = [[o for o in observations if o is not gone] for gone in observations]
        tried = [(_whole_search(some, windows, step, within_s), some) for some in fewer if _rows(some) is not None]
        if not tried:
            break
        without, some = max(tried, key=lambda t: t[0][1])
        if 1.0 - without[1] > _BETTER * (1.0 - best[1]):
            break
        best, observations = without, some
    lag, share, rival = best
    return (observations, lag) if share >= LEAST_SHARE and rival <= RIVAL else None


def _whole_search(
    observations: Sequence[_Observation],
    windows: tuple[tuple[float, float], tuple[float, float]],
    step: float,
    within_s: tuple[float, float] | None,
) -> tuple[float, float, float]:
    """Best lag [s], share of the motion that it explains, and that of the best other lag relative to it."""
    counts = [int((end - begin) / step) + 1 for begin, end in windows]
    n = sum(counts)
    spectra = _spectra(observations, windows, step, n)
    whole = np.zeros(n // 2 + 1, complex)
    frequency = 2.0 * np.pi * np.fft.rfftfreq(n, step)
    whole[np.searchsorted(frequency, spectra.omega - 1e-9)] = np.conj(spectra.product)
    height = -0.5 * n * np.fft.irfft(whole, n)
    index = np.arange(n)
    index = np.where(index < counts[0], index, index - n)
    # Half of the shorter record at least is common to both.
    enough = np.minimum(counts[0], counts[1] + index) - np.maximum(0, index) >= 0.5 * min(counts)
    lags = index * step + windows[0][0] - windows[1][0]
    height = np.where(enough, height, -np.inf)
    k = int(np.argmax(height))
    if within_s is not None:
        near = np.where((lags >= within_s[0]) & (lags <= within_s[1]), height, -np.inf)
        if np.max(near) > 0.7 * height[k]:
            height, k = near, int(np.argmax(near))
    top = float(height[k])
    if not np.isfinite(top) or top <= 0.0:
        return 0.0, 0.0, 1.0
    far = height[np.abs(lags - lags[k]) > _APART_S]
    rival = float(np.max(far, initial=-np.inf)) / top
    return float(lags[k]), 2.0 * top / max(spectra.size, 1e-300), rival


def _fine(
    observations: Sequence[_Observation], lag: float, logs: tuple[Sequence[Channel], Sequence[Channel]], step: float
) -> Lag | None:
    """The lag from the common part of both records, with its standard deviation."""
    a, b = _span(logs[0]), _span(logs[1])
    begin, end = max(a[0], b[0] + lag), min(a[1], b[1] + lag)
    count = int((end - begin) / step) + 1
    if count < 100:
        return None
    spectra = _spectra(observations, ((begin, end), (begin - lag, end - lag)), step, count)
    count_of_frequencies = spectra.omega.size
    block = np.arange(count_of_frequencies) * _BLOCKS // count_of_frequencies
    rest = _lowest(spectra, block >= 0)
    left_out = np.array([_lowest(spectra, block != k) for k in range(_BLOCKS)])
    jackknife = np.sqrt((_BLOCKS - 1) / _BLOCKS * np.sum((left_out - left_out.mean()) ** 2))
    turned = spectra.product * np.exp(-1j * spectra.omega * rest)
    remaining = max(spectra.size + 2.0 * float(np.sum(turned.real)), 0.0)
    curvature = -2.0 * float(np.sum(spectra.omega**2 * turned.real))
    if curvature <= 0.0:
        return None
    redundant = len(observations) - np.linalg.matrix_rank(np.array([o.row for o in observations]), tol=1e-6)
    formula = np.sqrt(remaining / (2.0 * count_of_frequencies * redundant) * 2.0 / curvature)
    sd = float(np.hypot(max(jackknife, formula), MODEL_SD_S))
    return Lag(lag + rest, sd, _middle(spectra, count, step) + begin - lag)


def _lowest(spectra: _Spectra, used: np.ndarray) -> float:
    """Lag [s] near zero with the smallest remainder, to 0.01 ms."""
    omega, product = spectra.omega[used], spectra.product[used]
    lag, reach = 0.0, _NEAR_S
    for _ in range(4):
        tried = lag + reach * np.linspace(-1.0, 1.0, 41)
        lag = float(tried[np.argmin(np.real(np.exp(-1j * np.outer(tried, omega)) @ product))])
        reach /= 10.0
    return lag


def _middle(spectra: _Spectra, count: int, step: float) -> float:
    """Time [s] about which the motion that shows the lag is centred."""
    whole = np.zeros((count // 2 + 1, spectra.second.shape[1]), complex)
    frequency = 2.0 * np.pi * np.fft.rfftfreq(count, step)
    whole[np.searchsorted(frequency, spectra.omega - 1e-9)] = 1j * spectra.omega[:, None] * spectra.second
    power = np.sum(np.fft.irfft(whole, count, axis=0) ** 2, axis=1)
    return float(step * (power @ np.arange(count)) / max(float(power.sum()), 1e-300))
