"""What is not known of the shape of a frame that bends: where the mass lies along it, and how far it reaches.

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

HEAVE, PITCH, MODAL_MASS, OVERHANG = "frame_heave", "frame_pitch", "frame_modal_mass_factor", "frame_overhang"
#: Prior standard deviations of a, b, c and of the overhang.  On two simulated trucks, 30 % of whose mass lay along the
#: frame and the rest in two lumps instead of as assumed, a and b were up to 0.14 and c down to -1.3; frames reach
#: beyond their axles by a tenth of the wheelbase (assumptions).
FRAME_SD = {HEAVE: 0.3, PITCH: 0.3, MODAL_MASS: 0.5, OVERHANG: 0.1}
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
    factors = [
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
    # Rise, slope and modal mass tell any shape at three points already.
    if not bending.x_m and len(_points(vehicle, body)) > 3:
        words = f"length of the frame of '{name}'"
        factors.append(MassFactor(f"{OVERHANG}[{name}]", OVERHANG, words, body, FRAME_SD[OVERHANG], tuple(used)))
    return factors


def _points(vehicle: Vehicle, body: int) -> set[float]:
    """Where springs and hinges act on a body [m]."""
    springs = {x for x, a in zip(vehicle.suspension_x_m, vehicle.axles, strict=True) if a.body == body}
    return springs | {b.hitch_x_m for b in vehicle.bodies[body : body + 2] if b.hitch_x_m is not None}


def with_frame_shape(
    vehicle: Vehicle, cases: dict[str, LoadCase], factor: MassFactor, amount: float
) -> tuple[Vehicle, dict[str, LoadCase]]:
    """Vehicle and load cases with the shape of a frame moved by `amount` of one factor."""
    at = factor.place
    if factor.quantity == OVERHANG:
        bodies = list(vehicle.bodies)
        bending = bodies[at].bending
        assert bending is not None
        bodies[at] = replace(bodies[at], bending=replace(bending, overhang=bending.overhang + amount))
        return replace(vehicle, bodies=tuple(bodies)), cases
    changed = dict(cases)
    for name in factor.load_cases:
        masses = list(changed[name].frame_masses or (FrameMass(),) * len(vehicle.bodies))
        more = (amount if factor.quantity == q else 0.0 for q in (HEAVE, PITCH, MODAL_MASS))
        masses[at] = FrameMass(*(here + other for here, other in zip(masses[at], more, strict=True)))
        changed[name] = replace(changed[name], frame_masses=tuple(masses))
    return vehicle, changed
