"""Bump stops: which axles have them in the model, and which law would give an axle some."""

from __future__ import annotations

from collections.abc import Sequence

from sysid.campaign.records import Axle, Vehicle
from sysid.estimation.parameters.suspension_elements import law_elements, law_name

#: The element of a suspension law that stops the motion at the declared travel.
BUMP_STOPS = "bump_stops"


def knows_travel(axle: Axle) -> bool:
    """Whether the campaign file declares how far an axle moves to its stops, both ways."""
    return axle.jounce_travel_m is not None and axle.rebound_travel_m is not None


def has_bump_stops(axle: Axle) -> bool:
    """Whether the model stops an axle at the end of its travel: wherever one is declared."""
    return axle.has_stops


def law_with_stops(vehicle: Vehicle, laws: Sequence[str], axle: int) -> str:
    """The law of an axle (index) with bump stops added, as written in the campaign file.

    Parameters
    ----------
    laws : those of a fit's suspensions, front to rear.
    """
    own = sorted(set(vehicle.suspension_axle))
    return law_name(law_elements(laws[own.index(vehicle.suspension_axle[axle])]) | {BUMP_STOPS})
