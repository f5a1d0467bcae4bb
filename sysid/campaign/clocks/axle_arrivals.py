"""Difference between the clocks of two loggers, from the times at which their axles meet the bump.

Axle i at x_i arrives at t_i = t_0 + x_i s + c L s (x_i / L - (x_i / L)^2) / 2 on the reference, where s = 1 / v is the
slowness and c the change of the speed over the wheelbase L. Axles of the second logger appear earlier by the lag. Least
squares with the priors of speed and change give the lag. It depends on the speed, and is coarse: use other means where
there are any.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sysid.campaign.clocks.motion import Lag
from sysid.campaign.passage.arrivals import find_passage, first_arrival
from sysid.campaign.records import BumpRun, Channel
from sysid.campaign.vehicle_records import Vehicle

#: Axles are found at their place within 0.07 m in 99 of 100 runs (as in `sysid.bookkeeping.places`), 0.2 m beside
#: a gap of 0.1 to 0.3 s.
PLACE_SD_M, BESIDE_GAP_M = 0.027, 0.08


def arrival_lag(first: Sequence[Channel], second: Sequence[Channel], vehicle: Vehicle, run: BumpRun) -> Lag | None:
    """Lag of the second logger's stamps from the arrivals of its axles and those of the first logger.

    Parameters
    ----------
    first, second : channels of both logs, each with its own stamps; axle accelerations count.
    run : for the nominal speed and what is known of it.

    Returns
    -------
    Lag or None
        None where a logger has no axle accelerations that show an arrival.
    """
    seen = [_arrivals(channels, vehicle, run.nominal_speed_m_s) for channels in (first, second)]
    if not all(seen):
        return None
    slowness = 1.0 / run.nominal_speed_m_s
    points = [(vehicle.axles[a].x_m, t, k, sd) for k, found in enumerate(seen) for a, (t, sd) in found.items()]
    x, time, late, place_sd = (np.array(v) for v in zip(*points, strict=True))
    length = max(max(a.x_m for a in vehicle.axles), 1e-3)
    at = float(time[late == 1].mean())
    bent = 0.5 * slowness * x * (1.0 - x / length)
    # Unknowns: start, relative slowness, change of speed, lag.
    design = np.stack([np.ones_like(x), slowness * x, bent, -late.astype(float)], axis=1)
    sd = place_sd * slowness
    rows, target = design / sd[:, None], (time - slowness * x) / sd
    priors = np.zeros((2, 4))
    priors[0, 1], priors[1, 2] = 1.0 / run.speed_sd, 1.0 / max(run.speed_change_sd, 1e-4)
    whole = np.vstack([rows, priors])
    covariance = np.linalg.inv(whole.T @ whole)
    lag = float((covariance @ whole.T @ np.concatenate([target, np.zeros(2)]))[3])
    return Lag(lag, float(np.sqrt(covariance[3, 3])), at)


def _arrivals(channels: Sequence[Channel], vehicle: Vehicle, speed_m_s: float) -> Mapping[int, tuple[float, float]]:
    """Arrivals [s] of the axles whose accelerations a logger has, with the sd of their places [m], by axle."""
    passage = find_passage(channels, vehicle, speed_m_s)
    if passage is not None:
        sd = PLACE_SD_M if passage.whole else BESIDE_GAP_M
        return {axle: (met.time_s, sd) for axle, met in passage.arrivals.items()} if passage.speed_m_s > 0.0 else {}
    alone = [c for c in channels if c.sensor.kind == "axle_acceleration" and c.sensor.axle is not None]
    if len(alone) != 1 or alone[0].sensor.axle is None:
        return {}
    arrival = first_arrival(alone[0])
    return {} if arrival is None else {alone[0].sensor.axle: (arrival.time_s, PLACE_SD_M)}
