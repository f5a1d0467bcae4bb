"""Drives over ordinary roads against declared places and speeds: every axle meets what the one before it has met.

The delay tau_ij between two neighbouring axles is where the phase transform of their accelerations peaks,

    R(tau) = sum over 0.8 to 6 Hz of  Re[ X_i conj(X_j) / |X_i X_j| exp(-i omega tau) ],

at (x_j - x_i) / v (C. H. Knapp, G. C. Carter, IEEE Transactions on Acoustics, Speech, and Signal Processing 24 (1976)
320). Delays that are all longer or shorter by one share show the speed; those of one pair of axles show its distance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.campaign.gaps import readings_at
from sysid.campaign.records import Campaign, RoadDrive

#: Band in which axles follow the road, far below wheel hop [Hz]; shortest log [s].
_BAND_HZ, _SHORTEST_S = (0.8, 6.0), 10.0
#: A peak counts from this many times the scatter of R; it is looked for to so many times the declared delay.
_CLEAR, _REACH = 6.0, 2.5
#: Differences that are said: share of a speed, share and length of a distance [m]. Axles on other springs answer the
#: road some 20 ms apart, which is 10 % of a delay of 0.2 s (assumptions).
_SPEED, _SHARE, _LENGTH_M = 0.12, 0.15, 0.2
#: An explanation is said alone if it leaves so many times less than the other (an assumption).
_BETTER = 3.0
#: Points per sample between which the peak is looked for.
_FINER = 8


@dataclass(frozen=True)
class _Delay:
    """Of a pair of neighbours (index of the front one): delay times declared speed [m], and the sign of the peak."""

    pair: int
    way_m: float
    opposite: bool


def drive_complaints(campaign: Campaign) -> list[str]:
    """Sentences about speeds, places and signs of axles that drives contradict.

    Of the explanations "the speed of a drive", "the place of one axle" and both, the one is said that leaves clearly
    less of the delays than the others.

    Parameters
    ----------
    campaign
        After the quality check.
    """
    x = np.array([a.x_m for a in campaign.vehicle.axles])
    of_drives = [(drive, _delays(drive, x)) for drive in campaign.road_drives]
    said: list[str] = []
    turned = _turned({d.pair for _, found in of_drives for d in found if d.opposite}, x.size)
    if turned:
        said.append(
            f"In road drives axle {turned[0]} moves against the axles beside it: look at the sign of its acceleration."
        )
    told = [(drive, found) for drive, found in of_drives if found]
    if not told:
        return said
    drive_of = np.concatenate([np.full(len(found), i) for i, (_, found) in enumerate(told)])
    pair = np.array([d.pair for _, found in told for d in found])
    way = np.array([d.way_m for _, found in told for d in found])
    distance = np.diff(x)[pair]
    if np.all(np.abs(way - distance) <= np.maximum(_SHARE * distance, _LENGTH_M)):
        return said
    ratios = np.array([np.sum((way * distance)[drive_of == i]) / np.sum(distance[drive_of == i] ** 2)
                       for i in range(len(told))])  # fmt: skip
    by_speed = float(np.sum((way - ratios[drive_of] * distance) ** 2))
    moved = []
    for j in range(x.size):
        lever = 1.0 * (pair == j - 1) - 1.0 * (pair == j)
        # Behind the last axle with neighbours nothing is seen.
        further = float(lever @ (way - distance) / max(float(lever @ lever), 1.0))
        moved.append((float(np.sum((way - distance - further * lever) ** 2)), further))
    best = min(range(x.size), key=lambda j: moved[j][0])
    left, further = moved[best]
    fast = [(told[i][0], float(r)) for i, r in enumerate(ratios) if abs(r - 1.0) > _SPEED]
    if x.size > 2 and _BETTER * left < by_speed and abs(further) > _LENGTH_M:
        count = f"{len(told)} road drive" + ("s" if len(told) > 1 else "")
        said.append(
            f"By the delays in {count} axle {best + 1} is at {x[best] + further - x[0]:.2f} m, not at "
            f"{x[best] - x[0]:.2f} m behind axle 1: look at its x_m."
            if best
            else f"By the delays in {count} axle 1 is {abs(further):.2f} m "
            f"{'nearer to' if further > 0.0 else 'further from'} the axles behind it than x_m says."
        )
    else:
        alone = x.size > 2 and _BETTER * by_speed < left
        said += [
            f"{drive.log.file}: the road passes from axle to axle as at {3.6 * drive.speed_m_s / ratio:.0f} km/h, and "
            f"{3.6 * drive.speed_m_s:.0f} km/h is given: look at nominal_speed_km_h"
            + ("." if alone else ", or at x_m of the axles.")
            for drive, ratio in fast
        ]
    return said


def _turned(pairs: set[int], axles: int) -> list[int]:
    """Number of the axle whose pairs are just these, if there is one."""
    every = [{p for p in (j - 1, j) if 0 <= p < axles - 1} for j in range(axles)]
    found = [j + 1 for j, own in enumerate(every) if pairs and own == pairs]
    return found if len(found) == 1 else []


def _delays(drive: RoadDrive, x: np.ndarray) -> list[_Delay]:
    log = drive.log
    step = log.sample_interval_s
    channels = {c.sensor.axle: c for c in log.channels if c.sensor.kind == "axle_acceleration"}
    if log.duration_s < _SHORTEST_S or drive.speed_m_s <= 0.0:
        return []
    time = step * np.arange(int(log.duration_s / step))
    omega = 2.0 * np.pi * np.fft.rfftfreq(time.size, step)
    band = (omega >= 2.0 * np.pi * _BAND_HZ[0]) & (omega <= 2.0 * np.pi * _BAND_HZ[1])
    spectra = {}
    for i, channel in channels.items():
        values = readings_at(channel, time, 2.0 * _BAND_HZ[1], clipped=False)
        seen = np.isfinite(values)
        if i is not None and seen.mean() > 0.9:
            spectra[i] = np.fft.rfft(np.where(seen, values - np.mean(values[seen]), 0.0))[band]
    found = []
    for p in range(x.size - 1):
        if p in spectra and p + 1 in spectra and x[p + 1] > x[p]:
            expected = float(x[p + 1] - x[p]) / drive.speed_m_s
            crossed = spectra[p] * np.conj(spectra[p + 1])
            lags = step / _FINER * np.arange(-_FINER, int(_REACH * expected / step * _FINER) + _FINER)
            phases = crossed / np.maximum(np.abs(crossed), 1e-300)
            peak = np.array([np.sum((phases * np.exp(-1j * omega[band] * lag)).real) for lag in lags])
            best = int(np.argmax(np.abs(peak)))
            if abs(peak[best]) > _CLEAR * np.sqrt(0.5 * band.sum()) and 0 < best < lags.size - 1:
                found.append(_Delay(p, float(lags[best]) * drive.speed_m_s, bool(peak[best] < 0.0)))
    return found
