"""What is not known of the shape of a frame that bends: where the mass lies along it.

Mass, centre of gravity and pitch inertia of a body leave open where its mass lies.  Its bending mode depends on that in
each load case through the mean rise and mean slope that are taken out of the shape, and through the modal mass:

    phi = psi - (h + a) - (p + b / l) (x - x_cg),    modal mass M exp(c),

with h, p and M those of the mass assumed (:mod:`sysid.vehicle_model.bending`), l half the frame's length, and a, b, c
normal about zero.  They stand among the masses that may be a little wrong, with larger standard deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from sysid.campaign.vehicle_records import FrameMass, LoadCase, Vehicle
from sysid.estimation.uncertainty.mass_factor import MassFactor

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
    """What is not known of the shape of a body's frame in the load cases `used`; nothing for a rigid one."""
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


def with_frame_mass(cases: dict[str, LoadCase], bodies: int, factor: MassFactor, amount: float) -> dict[str, LoadCase]:
    """Load cases of a vehicle of so many bodies with the shape of a frame moved by `amount` of one factor."""
    changed = dict(cases)
    for name in factor.load_cases:
        masses = list(changed[name].frame_masses or (FrameMass(),) * bodies)
        here, kind = masses[factor.place], factor.quantity
        masses[factor.place] = FrameMass(
            here.heave + amount * (kind == HEAVE),
            here.pitch + amount * (kind == PITCH),
            here.log_modal_mass + amount * (kind == MODAL_MASS),
        )
        changed[name] = replace(changed[name], frame_masses=tuple(masses))
    return changed
