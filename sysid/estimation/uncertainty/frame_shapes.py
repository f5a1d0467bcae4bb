"""Unknown shape of a frame that bends: the distribution of mass along it.

Mass, centre of gravity and pitch inertia of a body do not determine the distribution of its mass. The bending mode
depends on this distribution in each load case, through the mean rise and mean slope that are removed from the shape,
and through the modal mass:

    phi = psi - (h + a) - (p + b / l) (x - x_cg),    modal mass M exp(c),

where h, p and M belong to the assumed mass (:mod:`sysid.vehicle_model.bending`), l is half the frame's length, and a,
b, c are normal about zero. They are treated like the uncertain masses, with larger standard deviations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from sysid.campaign.vehicle_records import FrameMass, LoadCase, Vehicle
from sysid.estimation.uncertainty.mass_factor import MassFactor
from sysid.vehicle_model.bending import ends_carry_mass

HEAVE, PITCH, MODAL_MASS = "frame_heave", "frame_pitch", "frame_modal_mass_factor"
#: Prior standard deviations of a, b and c (assumptions).  On two simulated trucks, whose frames reached beyond their
#: axles by a tenth of the wheelbase and carried 30 % of the mass along them and the rest in two lumps, a and b were up
#: to 0.14 and c down to -1.3.
FRAME_SD = {HEAVE: 0.3, PITCH: 0.3, MODAL_MASS: 0.5}
_WORDS = {
    HEAVE: "mean rise of the bent frame",
    PITCH: "mean slope of the bent frame",
    MODAL_MASS: "modal mass of the frame",
}


def frame_factors(vehicle: Vehicle, body: int, used: Sequence[str]) -> list[MassFactor]:
    """Factors of the unknown shape of a body's frame in the load cases `used`; none for a rigid body."""
    bending, name = vehicle.bodies[body].bending, vehicle.bodies[body].name
    if bending is None:
        return []
    return [
        MassFactor(
            f"{quantity}[{name}, {case}]",
            quantity,
            f"{_WORDS[quantity]} of '{name}' in load case '{case}'",
            body,
            FRAME_SD[quantity],
            (case,),
            load_case=case,
        )
        for case in used
        for quantity in (HEAVE, PITCH, MODAL_MASS)
    ]


def with_known_ends(vehicle: Vehicle, cases: Mapping[str, LoadCase], used: Sequence[str]) -> dict[str, LoadCase]:
    """The load cases, each of those `used` saying whether the mass along its frames has parts at their ends.

    So moved masses keep the kind of distribution that the declared ones have.
    """
    known = dict(cases)
    if all(body.bending is None for body in vehicle.bodies):
        return known
    for name in used:
        case = known[name]
        masses = case.frame_masses or (FrameMass(),) * len(vehicle.bodies)
        known[name] = replace(
            case,
            frame_masses=tuple(
                mass if body.bending is None else replace(mass, at_ends=ends_carry_mass(vehicle, b, case))
                for b, (body, mass) in enumerate(zip(vehicle.bodies, masses, strict=True))
            ),
        )
    return known


def with_frame_mass(cases: dict[str, LoadCase], bodies: int, factor: MassFactor, amount: float) -> dict[str, LoadCase]:
    """Load cases of a vehicle of so many bodies with the shape of a frame moved by `amount` of one factor."""
    changed = dict(cases)
    for name in factor.load_cases:
        masses = list(changed[name].frame_masses or (FrameMass(),) * bodies)
        here, kind = masses[factor.place], factor.quantity
        masses[factor.place] = replace(
            here,
            heave=here.heave + amount * (kind == HEAVE),
            pitch=here.pitch + amount * (kind == PITCH),
            log_modal_mass=here.log_modal_mass + amount * (kind == MODAL_MASS),
        )
        changed[name] = replace(changed[name], frame_masses=tuple(masses))
    return changed
