"""The speed at which the axles of a run meet the bump, against the one that is listed."""

from __future__ import annotations

import numpy as np

from sysid.campaign.passage.arrivals import Passage, find_passage
from sysid.campaign.records import BumpRun, Channel
from sysid.campaign.vehicle_records import Vehicle

#: Logarithms of listed over measured speed: arrivals are read to some three per cent, the least squares find a speed
#: that is a fifth off, and none that is off by half.
DOUBTFUL, HOPELESS = 0.12, 0.3
#: An axle that is further off, as a share of the distance between the first and the last one, meets another bump.
_AGREEMENT = 0.1
#: Share of the axles with sensors that must be seen to arrive.
_SEEN = 0.75
#: km/h in units that a speed may have been noted in by mistake.
_UNITS = {"m/s": 3.6, "mph": 1.609344}


def passage_speed(channels: tuple[Channel, ...], vehicle: Vehicle, listed_m_s: float) -> float | None:
    """Speed [m/s] from the arrivals of the axle accelerations, None where they do not agree on one.

    Parameters
    ----------
    channels : of one run, without rejected ones.
    listed_m_s : speed around which is searched [m/s].
    """
    passage = find_passage(channels, vehicle, listed_m_s)
    return believed_speed(passage, vehicle)


def believed_speed(passage: Passage | None, vehicle: Vehicle) -> float | None:
    """The speed of a passage [m/s], None where an axle contradicts it or the axles come from the rear."""
    if passage is None or passage.speed_m_s <= 0.0 or len(passage.arrivals) < max(2.0, _SEEN * passage.sensors):
        return None
    places = [vehicle.axles[a].x_m for a in passage.arrivals]
    off = passage.furthest_off_m(vehicle)
    return passage.speed_m_s if off <= _AGREEMENT * (max(places) - min(places)) else None


def speed_complaint(run: BumpRun, vehicle: Vehicle) -> tuple[str, bool] | None:
    """A sentence where the axles of a run contradict its listed speed, and whether no search finds it; else None."""
    speed = passage_speed(run.log.channels, vehicle, run.nominal_speed_m_s)
    if speed is None:
        return None
    ratio = speed / run.nominal_speed_m_s
    far = abs(float(np.log(ratio)))
    if far < (DOUBTFUL if len(vehicle.axles) > 2 else HOPELESS):
        return None
    unit = next((u for u, factor in _UNITS.items() if abs(np.log(ratio / factor)) < 0.05), None)
    likely = f", which looks like {unit}" if unit else ""
    ending = "the run is left out" if far >= HOPELESS else "the run is used, and its speed is searched for"
    sentence = (
        f"{run.log.file}: its axles meet the bump one after the other as at {3.6 * speed:.3g} km/h, but "
        f"{3.6 * run.nominal_speed_m_s:.3g} km/h are {'listed' if run.speed_listed else 'logged'}{likely}; {ending}. "
        f"Correct {'nominal_speed_km_h' if run.speed_listed else 'unit or scale of the speed sensor'}, or the axle "
        "positions x_m or the clock of the log, or check that this is the log of that run."
    )
    return sentence, far >= HOPELESS
