"""The speed at which the axles of a run meet the bump, against the one that is listed."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from sysid.campaign.consistency import arrival
from sysid.campaign.records import BumpRun, Channel, Vehicle

#: Logarithms of listed over measured speed: arrivals are read to some three per cent, the least squares find a speed
#: that is a fifth off, and none that is off by half.
DOUBTFUL, HOPELESS = 0.12, 0.3
#: Pairs of axles that are closer tell little; pairs must agree so well to be believed.
_NEAREST_M, _AGREEMENT = 1.5, 0.10
_UNITS = {"m/s": 3.6, "mph": 1.609344}


def passage_speed(channels: tuple[Channel, ...], vehicle: Vehicle, rests: Mapping[str, float]) -> float | None:
    """Speed [m/s] from the arrivals of the axle accelerations, None where they do not agree on one.

    Parameters
    ----------
    channels : of one run, without rejected ones.
    rests : rest level of each column [SI].
    """
    times: dict[int, list[float]] = {}
    for channel in channels:
        axle = channel.sensor.axle
        if channel.sensor.kind == "axle_acceleration" and axle is not None:
            time = arrival(channel, rests.get(channel.sensor.column, 0.0))
            if time is not None:
                times.setdefault(axle, []).append(time)
    places = {axle: (vehicle.axles[axle].x_m, float(np.mean(t))) for axle, t in times.items()}
    pairs = [(a, b) for a, b in combinations(places.values(), 2) if abs(a[0] - b[0]) >= _NEAREST_M]
    speeds = np.array([(b[0] - a[0]) / (b[1] - a[1]) if b[1] != a[1] else np.inf for a, b in pairs])
    if speeds.size == 0 or not np.all(np.isfinite(speeds)) or np.any(speeds <= 0.0):
        return None
    speed = float(np.median(speeds))
    return speed if np.all(np.abs(np.log(speeds / speed)) < _AGREEMENT) else None


def speed_complaint(run: BumpRun, vehicle: Vehicle, rests: Mapping[str, float]) -> tuple[str, bool] | None:
    """A sentence where the axles of a run contradict its listed speed, and whether no search finds it; else None."""
    speed = passage_speed(run.log.channels, vehicle, rests)
    if speed is None:
        return None
    ratio = speed / run.nominal_speed_m_s
    far = abs(float(np.log(ratio)))
    if far < (DOUBTFUL if len(vehicle.axles) > 2 else HOPELESS):
        return None
    unit = next((u for u, factor in _UNITS.items() if abs(np.log(ratio / factor)) < 0.05), None)
    likely = f", which looks like {unit}" if unit else ""
    ending = "the run is left out" if far >= HOPELESS else "the run is used, with its speed sought"
    sentence = (
        f"{run.log.file}: its axles meet the bump one after the other as at {3.6 * speed:.3g} km/h, but "
        f"{3.6 * run.nominal_speed_m_s:.3g} km/h are listed{likely}; {ending}. Correct nominal_speed_km_h, or the axle "
        "positions x_m or the clock of the log, or check that this is the log of that run."
    )
    return sentence, far >= HOPELESS
