"""Motion of frames and axles from all sensors of a log together, by kinematics alone.

x = (body coordinates without fore-aft travel, heave of each axle) are displacements. Every sensor s sees one row of
them, differentiated p_s times, with a gain 1 + gamma_s near one:

    y_s = (1 + gamma_s) (i omega)^p_s r_s' x + n_s,    p = 0 deflection, 1 pitch rate, 2 acceleration,

and white noise n_s of standard deviation sigma_s. Weighted least squares at every frequency gives x and its covariance
C(omega) without bias: deflections lead below some 2 Hz, accelerations above. sigma_s and gamma_s follow from what the
sensors of one motion disagree by; sigma_s as the minimum norm quadratic estimate (C. R. Rao, J. Multivariate Anal. 1
(1971) 257), gamma_s by least squares with the prior of the installation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import next_fast_len
from scipy.signal import resample_poly

from sysid import limits
from sysid.campaign.gaps import readings_at
from sysid.campaign.records import Channel, Log
from sysid.vehicle_model.assembly import PlanarMatrices

#: Motion above this is taken from no reading: frames bend, and noise of rates grows (an assumption) [Hz].
HIGHEST_HZ = 25.0
#: What nobody knows of a displacement: far more than any truck moves at and above the second frequency [m, Hz].
_UNKNOWN_M, _SLOW_HZ = 1.0, 0.4
#: Readings of faster logs are made this far apart [s]. With 10 ms, friction turns too late: c came out 1.5 % lower on a
#: truck with leaf springs.
_STEP_S = 0.005
#: A stretch is used if it is this long; its ends are left out, where the smoother does not know what comes [s].
SHORTEST_S, END_S = 4.0, 1.0
#: A channel is left out, instead of what it alone does not see, if that is more than this share of a log.
_LOST = 0.1
#: Noise where no other sensor sees the same motion: assumptions [m, rad/s, m/s2].
_NOISE = {"suspension_deflection": 3e-4, "axle_acceleration": 0.2, "body_acceleration": 0.15, "pitch_rate": 0.005}
_DERIVATIVE = {"suspension_deflection": 0, "pitch_rate": 1, "axle_acceleration": 2, "body_acceleration": 2}
#: Standard deviation of a gain about one, as in the calibration over bumps.
_GAIN_SD = {"suspension_deflection": 0.005, "pitch_rate": 0.01, "axle_acceleration": 0.01, "body_acceleration": 0.01}
#: Frequencies from which noise and gains are found, and at which the smoother is computed.
_LOWEST_NOISE_HZ, _NOISE_BINS, _GRID = 1.0, 300, 600
_ROUNDS = 30
#: A share of the noise below this is not seen by other sensors.
_SEEN = 0.02


@dataclass(frozen=True)
class Stretch:
    """Readings of all sensors without a break: n samples every `step_s` from `start_s` of the log [s].

    `readings` (sensors, n) in SI, mean zero; `rows` (sensors, nx); `derivatives` (sensors,); `noise` (sensors,)
    sigma_s, and `gain_sd` (sensors,) of the installation.
    """

    start_s: float
    step_s: float
    columns: tuple[str, ...]
    readings: np.ndarray
    rows: np.ndarray
    derivatives: np.ndarray
    noise: np.ndarray
    gain_sd: np.ndarray

    @property
    def count(self) -> int:
        """n."""
        return int(self.readings.shape[1])


@dataclass(frozen=True)
class Gains:
    """gamma of every sensor by its column: `columns` (s,), `value` (s,) and `covariance` (s, s)."""

    columns: tuple[str, ...]
    value: np.ndarray
    covariance: np.ndarray

    def of(self, stretch: Stretch) -> np.ndarray:
        """Places (sensors,) of the sensors of a stretch."""
        return np.array([self.columns.index(c) for c in stretch.columns])


@dataclass(frozen=True)
class Motion:
    """Displacements in one stretch, all (..., n).

    `rate` and `acceleration` (nx, n) of x, [m/s, rad/s] and [m/s2, rad/s2], `displacement` (nx, n) without its slow
    part; `deflection` (na, n) [m] and `deflection_rate` (na, n) [m/s] of the suspensions, + = longer, about their mean.
    """

    displacement: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    deflection: np.ndarray
    deflection_rate: np.ndarray


def vertical_columns(matrices: PlanarMatrices) -> np.ndarray:
    """Places of the body coordinates that vertical sensors see: all but the fore-aft travel of each chain."""
    travel = np.any(matrices.drive != 0.0, axis=0) & ~np.any(matrices.heave_rows != 0.0, axis=0)
    return np.flatnonzero(~(travel & ~np.any(matrices.pitch_rows != 0.0, axis=0)))


def stretches_of(log: Log, matrices: PlanarMatrices) -> list[Stretch]:
    """Unbroken stretches of a log; empty where there is none that is long enough. Faster logs get steps of 5 ms."""
    step = log.sample_interval_s
    fewer = max(1, int(_STEP_S / step + 1e-6))
    channels = [c for c in log.channels if c.sensor.kind in _DERIVATIVE]
    if not channels or log.duration_s < SHORTEST_S or log.duration_s / step > limits.GRID_STEPS:
        return []
    time = step * np.arange(int(log.duration_s / step + 1e-6) + 1)
    values = np.array([readings_at(c, time, HIGHEST_HZ, clipped=False) for c in channels])
    seen = np.isfinite(values)
    alone = (~seen & (seen.sum(axis=0) > len(channels) // 2)).mean(axis=1)
    kept = np.flatnonzero(alone <= _LOST)
    if not kept.size:
        return []
    used = [channels[i] for i in kept]
    kinds = [c.sensor.kind for c in used]
    whole = Stretch(
        0.0, step * fewer, tuple(c.sensor.column for c in used), values[kept], _rows(used, matrices),
        np.array([_DERIVATIVE[k] for k in kinds]), np.array([_NOISE[k] for k in kinds]) / np.sqrt(fewer),
        np.array([_GAIN_SD[k] for k in kinds]),
    )  # fmt: skip
    edges = np.flatnonzero(np.diff(np.concatenate([[0], seen[kept].all(axis=0).astype(int), [0]])))
    found = []
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        count = _fast((last - first) // fewer)
        if count * whole.step_s >= SHORTEST_S:
            readings = values[kept, first : first + fewer * count]
            if fewer > 1:
                readings = resample_poly(readings, 1, fewer, axis=1, padtype="line")
            found.append(replace(whole, start_s=first * step, readings=readings - readings.mean(axis=1, keepdims=True)))
    return found


def _fast(count: int) -> int:
    """The largest even number up to `count` whose transform is fast."""
    while count > 2 and (count % 2 or next_fast_len(count, real=True) != count):
        count -= 1
    return count


def _rows(channels: Sequence[Channel], matrices: PlanarMatrices) -> np.ndarray:
    bodies = vertical_columns(matrices)
    axles = np.eye(len(matrices.unsprung_mass))
    rows = []
    for channel in channels:
        s = channel.sensor
        if s.kind == "suspension_deflection" and s.axle is not None:
            rows.append(np.concatenate([matrices.attachment[s.axle][bodies], -axles[s.axle]]))
        elif s.kind == "axle_acceleration" and s.axle is not None:
            rows.append(np.concatenate([np.zeros(bodies.size), axles[s.axle]]))
        elif s.body is not None:
            turns = s.kind == "pitch_rate" or s.x_m is None
            row = matrices.body_turn(s.body, s.x_m) if turns else matrices.body_point(s.body, float(s.x_m or 0.0))
            rows.append(np.concatenate([row[bodies], np.zeros(axles.shape[0])]))
        else:
            raise ValueError(f"{s.column} has no place")
    return np.array(rows)


def stretching(matrices: PlanarMatrices) -> np.ndarray:
    """Rows (na, nx) that give the deflections of the suspensions from x."""
    axles = np.eye(len(matrices.unsprung_mass))
    return np.concatenate([matrices.attachment[:, vertical_columns(matrices)], -axles], axis=1)


def smoother(stretch: Stretch, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gain (F, nx, sensors) from readings to displacements, and the covariance C (F, nx, nx), at `omega` (F,)."""
    design = (1j * omega[:, None]) ** stretch.derivatives * np.ones((omega.size, 1))
    design = design[:, :, None] * stretch.rows
    weighted = np.conj(np.swapaxes(design, 1, 2)) / stretch.noise**2
    slow = (2.0 * np.pi * _SLOW_HZ / np.maximum(omega, 1e-3)) ** 6
    prior = np.eye(stretch.rows.shape[1]) * ((1.0 + slow) / _UNKNOWN_M**2)[:, None, None]
    covariance = np.linalg.inv(weighted @ design + prior)
    return covariance @ weighted, covariance


def noise_bins(stretch: Stretch) -> tuple[np.ndarray, np.ndarray, float]:
    """Spectra (sensors, F) at up to 300 frequencies `omega` (F,), and how many of the record one stands for."""
    taper, scale = edge_taper(stretch.count, stretch.step_s)
    frequency = np.fft.rfftfreq(stretch.count, stretch.step_s)
    chosen = np.flatnonzero((frequency >= _LOWEST_NOISE_HZ) & (frequency <= min(HIGHEST_HZ, 0.4 / stretch.step_s)))
    every = max(1, chosen.size // _NOISE_BINS)
    chosen = chosen[::every]
    return np.fft.rfft(stretch.readings * taper, axis=1)[:, chosen] / scale, 2.0 * np.pi * frequency[chosen], every


def with_noise_and_gains(stretches: Sequence[Stretch]) -> tuple[list[Stretch], Gains]:
    """Stretches with the noise of their sensors and with gains corrected, and these gains, common to all stretches.

    Gains and noise depend on each other: they are found in turn, three times.
    """
    columns = tuple(dict.fromkeys(c for s in stretches for c in s.columns))
    gain_sd = {c: sd for s in stretches for c, sd in zip(s.columns, s.gain_sd, strict=True)}
    prior = np.array([gain_sd[c] for c in columns])
    gains = Gains(columns, np.zeros(prior.size), np.diag(prior**2))
    bins = [noise_bins(s) for s in stretches]
    found = list(stretches)
    for _ in range(3):
        information, score = np.diag(1.0 / prior**2), -gains.value / prior**2
        for k, stretch in enumerate(stretches):
            spectrum, omega, every = bins[k]
            places = gains.of(stretch)
            corrected = spectrum / (1.0 + gains.value[places])[:, None]
            found[k] = replace(found[k], noise=_noise(found[k], corrected, omega))
            fitted, precision = _agreed(found[k], corrected, omega)
            # Errors of the fitted readings and what is left are independent, so that noise does not move the gains.
            left = (corrected - fitted) / found[k].noise[:, None] ** 2
            pairs = np.sum(np.conj(fitted.T)[:, :, None] * precision * fitted.T[:, None, :], axis=0)
            information[np.ix_(places, places)] += 2.0 * every * pairs.real
            score[places] += 2.0 * every * np.sum(np.conj(fitted) * left, axis=1).real
        covariance = np.linalg.inv(information)
        gains = Gains(columns, gains.value + covariance @ score, covariance)
    for k, stretch in enumerate(stretches):
        readings = stretch.readings / (1.0 + gains.value[gains.of(stretch)])[:, None]
        found[k] = replace(found[k], readings=readings)
    return found, gains


def _agreed(stretch: Stretch, spectrum: np.ndarray, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Readings (sensors, F) that one motion gives, and the precision (F, sensors, sensors) of what is left."""
    gain, _ = smoother(stretch, omega)
    design = (1j * omega[:, None]) ** stretch.derivatives * np.ones((omega.size, 1))
    hat = (design[:, :, None] * stretch.rows) @ gain
    precision = (np.eye(stretch.noise.size) - hat) / stretch.noise[:, None] ** 2
    return (hat @ spectrum.T[:, :, None])[:, :, 0].T, precision


def _noise(stretch: Stretch, spectrum: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """sigma_s (sensors,), from spectra (sensors, F) in which white noise has its variance."""
    noise = stretch.noise
    seen = (1j * omega[:, None]) ** stretch.derivatives * np.ones((omega.size, 1))
    for _ in range(_ROUNDS):
        gain, covariance = smoother(replace(stretch, noise=noise), omega)
        fitted = seen.T * (stretch.rows @ (gain @ spectrum.T[:, :, None])[:, :, 0].T)
        left = np.mean(np.abs(spectrum - fitted) ** 2, axis=1)
        by_motion = np.sum((stretch.rows @ covariance) * stretch.rows, axis=2).real
        free = noise**2 - np.mean(np.abs(seen) ** 2 * by_motion, axis=0)
        shown = free > _SEEN * noise**2
        change = np.where(shown, left / np.where(shown, free, 1.0), 1.0)
        noise = np.where(shown, noise * np.sqrt(change), noise)
        if np.all(np.abs(change - 1.0) < 1e-3):
            break
    return np.asarray(noise)


def smoothed(stretch: Stretch, matrices: PlanarMatrices) -> Motion:
    """Motion in a stretch."""
    count, step = stretch.count, stretch.step_s
    # Readings go on, turned about their ends, so that no step stands there.
    ends = min(count - 1, int(4.0 * END_S / step))
    before = 2.0 * stretch.readings[:, :1] - stretch.readings[:, ends:0:-1]
    after = 2.0 * stretch.readings[:, -1:] - stretch.readings[:, -2 : -ends - 2 : -1]
    fade = np.sin(0.5 * np.pi * np.arange(ends) / ends) ** 2
    whole = np.concatenate([before * fade, stretch.readings, after * fade[::-1]], axis=1)
    size = int(next_fast_len(whole.shape[1], real=True))
    omega = 2.0 * np.pi * np.fft.rfftfreq(size, step)
    # Above the band all fades out, in the same way for every signal, so that equations of motion still hold.
    corner = 2.0 * np.pi * min(1.2 * HIGHEST_HZ, 0.45 / step)
    inside = omega < 2.0 * corner
    spectrum = np.fft.rfft(whole, size, axis=1)[:, inside]
    motion = np.zeros((stretch.rows.shape[1], omega.size), complex)
    grid = np.concatenate([[0.0], np.geomspace(0.1, omega[inside][-1] + 1e-9, _GRID)])
    coarse, _ = smoother(stretch, grid)
    # Times (i omega)^p the gain is smooth, so that a line between frequencies of the grid will do.
    upper = np.clip(np.searchsorted(grid, omega[inside]), 1, grid.size - 1)
    share = (omega[inside] - grid[upper - 1]) / (grid[upper] - grid[upper - 1])
    for x in range(motion.shape[0]):
        for s in range(stretch.noise.size):
            rows = coarse[:, x, s]
            motion[x, inside] += (rows[upper - 1] + share * (rows[upper] - rows[upper - 1])) * spectrum[s]
    motion /= 1.0 + (omega / corner) ** 16

    def back(spectra: np.ndarray) -> np.ndarray:
        return np.fft.irfft(spectra, size, axis=1)[:, ends : ends + count]

    deflection = stretching(matrices) @ motion
    return Motion(
        back(motion), back(1j * omega * motion), back(-(omega**2) * motion), back(deflection),
        back(1j * omega * deflection),
    )  # fmt: skip


def edge_taper(count: int, step_s: float) -> tuple[np.ndarray, float]:
    """Weight (n,) that rises from nothing at both ends, and its norm: white noise keeps its variance."""
    edge = max(1, min(int(END_S / step_s), count // 4))
    rise = np.sin(0.5 * np.pi * (np.arange(edge) + 0.5) / edge) ** 2
    weight = np.ones(count)
    weight[:edge], weight[-edge:] = rise, rise[::-1]
    return weight, float(np.sqrt(np.sum(weight**2)))
