"""What is not known about left and right: how the truck rolls, and how its sides differ.

All of it is integrated out beside masses and departures. Only sensors on one side alone show it: a mean of both sides
is free of what is linear in roll. Where nothing is declared, values are usual ones, and their standard deviations
assumptions.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from sysid.campaign.records import Campaign, Sensor
from sysid.campaign.vehicle_records import Vehicle
from sysid.campaign.wheel_places import across_axle
from sysid.estimation.residuals.run_data import ChannelLayout, channel_layout
from sysid.vehicle_model.passes import EffectiveRoads

#: Kinds: turn of the bump [rad]; logarithms of factors on roll inertia of bodies and of axles, on stiffness and damping
#: of suspensions in roll, on the stiffness of tires in roll, on their cornering
#: stiffness, on the lever of a sensor; how much of the stiffness,
#: damping and tire stiffness of an axle is on the left beyond on the right, over their sum; place of a body's centre of
#: gravity to the left [m].
SKEW, BODY_INERTIA, AXLE_INERTIA = "bump_skew", "roll_inertia_factor", "axle_roll_inertia_factor"
ROLL_STIFFNESS, ROLL_DAMPING, TIRE_ROLL = "roll_stiffness_factor", "roll_damping_factor", "tire_roll_factor"
LEVER, CORNERING = "sensor_lever_factor", "cornering_stiffness_factor"
SPRING_SIDE, DAMPER_SIDE, TIRE_SIDE, CG_SIDE = "spring_side", "damper_side", "tire_side", "cg_side"
KINDS = (
    SKEW,
    BODY_INERTIA,
    AXLE_INERTIA,
    ROLL_STIFFNESS,
    ROLL_DAMPING,
    TIRE_ROLL,
    LEVER,
    CORNERING,
    SPRING_SIDE,
    DAMPER_SIDE,
    TIRE_SIDE,
    CG_SIDE,
)
_SD = {
    BODY_INERTIA: 0.3,
    AXLE_INERTIA: 0.25,
    ROLL_STIFFNESS: 0.5,
    ROLL_DAMPING: 0.4,
    TIRE_ROLL: 0.1,
    CORNERING: 0.4,
    SPRING_SIDE: 0.06,
    DAMPER_SIDE: 0.1,
    TIRE_SIDE: 0.04,
    CG_SIDE: 0.05,
}
_WORDS = {
    AXLE_INERTIA: "roll inertia",
    ROLL_STIFFNESS: "roll stiffness of the suspension",
    ROLL_DAMPING: "roll damping of the suspension",
    TIRE_ROLL: "stiffness of the tires in roll",
    SPRING_SIDE: "left spring beyond the right one",
    DAMPER_SIDE: "left damper beyond the right one",
    TIRE_SIDE: "left tires beyond the right ones",
}
#: Half of a normal distribution's 90 % lies within so many standard deviations.
_WITHIN = 1.645
#: Places of sensors on the frame [m] and standard deviations of the logarithm of a sensor's place, declared or not.
_RAIL_M = 0.43
_LEVER_SD = {True: 0.03, False: 0.15}


@dataclass(frozen=True)
class SideUnknown:
    """One unknown of left and right, normal about zero.

    `place`: index of its axle or body; `of`: bump, or column of a sensor, and `load_case`, where it belongs to one.
    """

    kind: str
    place: int
    sd: float
    name: str
    words: str
    of: str | None = None
    load_case: str | None = None
    axle: int | None = None


def lever_m(sensor: Sensor, vehicle: Vehicle) -> float:
    """Distance of a sensor from the middle of the truck [m], positive to the left; 0 for one that shows the mean."""
    if sensor.side is None or sensor.kind == "pitch_rate":
        return 0.0
    if sensor.y_m is not None:
        return sensor.y_m
    sign = 1.0 if sensor.side == "left" else -1.0
    if sensor.axle is None or sensor.kind == "body_acceleration":
        return sign * _RAIL_M
    across = across_axle(vehicle.axles[sensor.axle])
    return sign * 0.5 * (across.spring_track_m if sensor.kind == "axle_acceleration" else across.damper_track_m)


def levers_m(layout: ChannelLayout, vehicle: Vehicle) -> np.ndarray:
    """Distances (C,) of the sensors of all channels from the middle [m], positive to the left; 0 for means."""
    return np.array([lever_m(s, vehicle) for s in layout.sensors])


def show_roll(layout: ChannelLayout, felt: EffectiveRoads, bumps: Collection[str]) -> bool:
    """Whether roll is in the readings: some sensor is on one side, and the sides of every bump are known."""
    profiles = [felt.profiles.get(bump) for bump in bumps]
    return bool(np.any(levers_m(layout, felt.vehicle))) and all(p is not None and p.sides is not None for p in profiles)


def side_unknowns(campaign: Campaign, felt: EffectiveRoads) -> tuple[SideUnknown, ...]:
    """The unknowns of left and right of a campaign; none if none of its channels shows roll.

    Parameters
    ----------
    felt : what the wheels feel of the bumps.
    """
    layout, vehicle = channel_layout(campaign.bump_runs), felt.vehicle
    bumps, cases = (
        tuple(dict.fromkeys(values))
        for values in ([r.bump for r in campaign.bump_runs], [r.load_case for r in campaign.bump_runs])
    )
    if not show_roll(layout, felt, bumps):
        return ()
    found = []
    for bump in bumps:
        sd = campaign.scans[bump].heading_within_rad / _WITHIN if bump in campaign.scans else 0.0
        found.append(SideUnknown(SKEW, 0, sd, f"bump_skew[{bump}]", f"turn of the bump '{bump}'", of=bump))
    found.append(SideUnknown(CORNERING, 0, _SD[CORNERING], "cornering_stiffness", "cornering stiffness of the tires"))
    for b, body in enumerate(vehicle.bodies):
        for case in cases:
            where = f"of '{body.name}' in load case '{case}'"
            for kind, key, words in (
                (BODY_INERTIA, "roll_inertia", "roll inertia"),
                (CG_SIDE, "cg_side", "place to the left of the centre of gravity"),
            ):
                name = f"{key}[{body.name}, {case}]"
                found.append(SideUnknown(kind, b, _SD[kind], name, f"{words} {where}", load_case=case))
    for i, axle in enumerate(vehicle.axles):
        for kind, words in _WORDS.items():
            name = f"{kind.removesuffix('_factor')}_{i + 1}"
            found.append(SideUnknown(kind, i, _SD[kind], name, f"{words} of axle {i + 1} ({axle.name})", axle=i))
    for sensor, lever in zip(layout.sensors, levers_m(layout, vehicle), strict=True):
        if lever:
            sd = _LEVER_SD[sensor.y_m is not None]
            words, column = f"distance of '{sensor.column}' from the middle", sensor.column
            found.append(SideUnknown(LEVER, 0, sd, f"sensor_lever[{column}]", words, of=column))
    return tuple(u for u in found if u.sd > 0.0)
