"""Where tires, springs and dampers sit across the truck: as declared, or as usual for the kind of axle.

Distances from the middle of the truck are positive to the left. Usual values are those of the trucks in Fancher, Ervin,
Winkler and Gillespie, A factbook of the mechanical properties of the components for single-unit and articulated heavy
trucks, UMTRI-86-12 (1986): steer axles carry single tires at 80 in and springs at 32 in, axles with twin tires have
72 in, 38 in, and 13 in between the twins; dampers stand near the springs.
"""

from __future__ import annotations

from typing import NamedTuple

from sysid.campaign.vehicle_records import Axle, Vehicle


class AcrossAxle(NamedTuple):
    """Distances [m] from left to right: of the middles of the wheels, of springs and of dampers, and between twins."""

    track_m: float
    spring_track_m: float
    damper_track_m: float
    dual_spacing_m: float

    @property
    def tires_m(self) -> tuple[float, ...]:
        """Distances [m] of the tires of one side from the middle of the truck."""
        half, apart = 0.5 * self.track_m, 0.5 * self.dual_spacing_m
        return (half - apart, half + apart) if apart else (half,)


_SINGLE = AcrossAxle(2.03, 0.82, 0.90, 0.0)
_TWIN = AcrossAxle(1.83, 0.97, 0.90, 0.33)
#: Two tires of a truck are not stiffer than this together, four of them are [N/m].
_STIFFEST_PAIR = 2.3e6


def across_axle(axle: Axle) -> AcrossAxle:
    """The distances across an axle, usual ones where the campaign declares none."""
    twin = axle.tire_stiffness_N_per_m > _STIFFEST_PAIR if axle.dual_spacing_m is None else axle.dual_spacing_m > 0.0
    declared = (getattr(axle, name) for name in AcrossAxle._fields)
    usual = _TWIN if twin else _SINGLE
    return AcrossAxle(*(u if d is None else d for u, d in zip(usual, declared, strict=True)))


def tires_across(vehicle: Vehicle) -> tuple[float, ...]:
    """Distances [m] of the tires of one side of the truck from its middle, every axle with the same weight.

    An axle with one tire per side has it twice.
    """
    return tuple(y for axle in vehicle.axles for y in (across_axle(axle).tires_m * 2)[:2])
