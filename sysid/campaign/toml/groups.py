"""What axle groups must fulfil to be one rigid beam with one suspension, and rockers to join neighbouring springs."""

from __future__ import annotations

from sysid.campaign.vehicle_records import AxleGroup, Equaliser, Vehicle
from sysid.errors import CampaignError
from sysid.wording import shorten

_SUSPENSION_KEYS = (
    "suspension",
    "suspension_law",
    "spring_table",
    "damper_table",
    "hanger_lash_m",
    "load_dependent",
    "jounce_travel_m",
    "rebound_travel_m",
    "leaf",
)


def check_groups(vehicle: Vehicle, label: str) -> None:
    """Check the axle groups of a vehicle, and that every axle has something to be accelerated.

    The axles of a group are neighbours under one body and stand in no other group.  A beam's one suspension is
    described at its first axle, so that the other axles agree with it or say nothing.  An axle without unsprung mass
    of its own shares that of its beam, and beam and axles together have pitch inertia.  A rocker leaves every axle its
    own suspension.

    Parameters
    ----------
    label : name of the campaign file, for the error.

    Raises
    ------
    CampaignError
        If one of these does not hold.
    """
    owner: dict[int, AxleGroup | Equaliser] = {}
    groups: list[AxleGroup | Equaliser] = [*vehicle.groups, *vehicle.equalisers]
    for group in groups:
        for i in group.axles:
            if i in owner:
                raise CampaignError(
                    f"{label}: the axle '{shorten(vehicle.axles[i].name)}' stands in two groups of [[vehicle.group]], "
                    f"'{shorten(owner[i].name)}' and '{shorten(group.name)}'; leave it in one."
                )
            owner[i] = group
        what = f"{label}: the axle group '{shorten(group.name)}'"
        _check_neighbours(vehicle, group.axles, what)
        if isinstance(group, AxleGroup):
            _check_beam(vehicle, group, what)
    for axle, mass in zip(vehicle.axles, vehicle.unsprung_mass_kg, strict=True):
        if not mass > 0.0:
            raise CampaignError(
                f"{label}: the axle '{shorten(axle.name)}' has unsprung_mass_kg = 0; only an axle in a "
                "[[vehicle.group]] with a mass of its own may have none."
            )


def _check_neighbours(vehicle: Vehicle, members: tuple[int, ...], what: str) -> None:
    if len({vehicle.axles[i].body for i in members}) > 1:
        raise CampaignError(f"{what} has axles under two bodies; a group carries one body, so split it.")
    if members[-1] - members[0] != len(members) - 1:
        between = next(i for i in range(members[0], members[-1]) if i not in members)
        raise CampaignError(
            f"{what} leaves out the axle '{shorten(vehicle.axles[between].name)}' between its axles; a group holds "
            "neighbouring axles."
        )


def _check_beam(vehicle: Vehicle, group: AxleGroup, what: str) -> None:
    axles = [vehicle.axles[i] for i in group.axles]
    first = axles[0]
    for other in axles[1:]:
        for key in _SUSPENSION_KEYS:
            given = getattr(other, key)
            if given is not None and given != getattr(first, key):
                raise CampaignError(
                    f"{what} has one suspension, described at its first axle '{shorten(first.name)}', but the axle "
                    f"'{shorten(other.name)}' has another {key}; give both the same."
                )
        if {"stiffness", "damping"} & set(other.priors):
            raise CampaignError(
                f"{what} has one suspension: give its priors of stiffness and damping at its first axle "
                f"'{shorten(first.name)}' and not at '{shorten(other.name)}'."
            )
    middle = sum(a.x_m for a in axles) / len(axles)
    inertia = group.pitch_inertia_kg_m2 + sum(a.unsprung_mass_kg * (a.x_m - middle) ** 2 for a in axles)
    if len(axles) > 1 and not inertia > 0.0:
        raise CampaignError(f"{what} has no pitch inertia; give pitch_inertia_kg_m2, or unsprung_mass_kg of its axles.")
