"""Declared mass properties with small errors: factors on them, shared by all runs, each with a Gaussian prior.

A factor multiplies an unsprung mass, a body's pitch inertia, the height of its centre of gravity or of its hitch, the
load that a scale showed for an axle, or all masses of the truck with all loads that the scale showed. If an axle load
increases, the mass of its body increases by the same amount. If an unsprung mass increases, the sprung mass of its body
decreases by the same amount. Statics then give the new centre of gravity. The logarithm of a factor is normal about
zero with the tolerance that the campaign file gives.

No motion shows the factor of the scale: a truck of which all masses and loads, stiffnesses and dampings are larger by
the same share moves in the same way. The factors on unsprung masses and inertias are relative to it, so guesses of
these say nothing about the scale.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from sysid.campaign.records import Campaign
from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.estimation.residuals.bump_model import SideKey
from sysid.estimation.residuals.side_unknowns import KINDS, SideUnknown, side_unknowns
from sysid.estimation.uncertainty.frame_shapes import FRAME_SD, frame_factors, with_frame_mass, with_known_ends
from sysid.estimation.uncertainty.mass_factor import MassFactor
from sysid.vehicle_model.passes import EffectiveRoads

T = TypeVar("T")

#: What holds the speed of a truck that is driven by its wheels: an engine in a low gear, a driver's foot; within a
#: factor of two (an assumption).
HOLD, HOLD_SD = "hold_factor", 0.7

UNSPRUNG, INERTIA, CG_HEIGHT, HITCH_HEIGHT, AXLE_LOAD, SCALE = (
    "unsprung_mass_factor",
    "pitch_inertia_factor",
    "cg_height_factor",
    "hitch_height_factor",
    "axle_load_factor",
    "axle_load_scale_factor",
)
#: Quantities that no campaign file declares.
UNDECLARED = frozenset({*FRAME_SD, HOLD})
#: The simulation uses no factor further from one than this many tolerances. 99.99 % of normal draws are inside, so a
#: factor comes near this limit only if the data require it.
REACH_SD = 4.0


@dataclass(frozen=True)
class UncertainMasses:
    """The declared vehicle and load cases, and the factors on their mass properties."""

    vehicle: Vehicle
    load_cases: Mapping[str, LoadCase]
    factors: tuple[MassFactor, ...]

    @property
    def sd(self) -> np.ndarray:
        """Prior standard deviations (m,) of the logarithms of the factors."""
        return np.array([f.sd for f in self.factors])

    @property
    def readings(self) -> np.ndarray:
        """Which factors (m,) belong to single readings of a scale."""
        return np.array([f.quantity == AXLE_LOAD for f in self.factors], bool)

    @property
    def scales(self) -> np.ndarray:
        """Which factors (m,) are shared by all readings of a scale."""
        return np.array([f.quantity == SCALE for f in self.factors], bool)

    @property
    def sides(self) -> np.ndarray:
        """Which of them (m,) are unknowns of left and right, which no planar motion shows."""
        return np.array([f.quantity in KINDS for f in self.factors], bool)

    @property
    def side_unknowns(self) -> tuple[SideUnknown, ...]:
        """The unknowns of left and right, in their order among the factors."""
        return tuple(
            SideUnknown(f.quantity, f.place, f.sd, f.name, f.words, f.of, f.load_case, f.axle)
            for f in self.factors
            if f.quantity in KINDS
        )

    def side_amounts(self, amounts: np.ndarray) -> tuple[tuple[SideKey, float], ...]:
        """What the unknowns of left and right among the amounts (m,) are, for the model."""
        pairs = zip(self.factors, amounts, strict=True)
        return tuple(((f.quantity, f.place, f.load_case, f.of), float(a)) for f, a in pairs if f.quantity in KINDS)

    @property
    def undeclared(self) -> np.ndarray:
        """Which factors (m,) are on what nobody declares: shapes of frames that bend, the time that holds the speed."""
        return np.array([f.quantity in UNDECLARED for f in self.factors], bool)

    def load_changes(self, log_factors: np.ndarray, load_cases: Sequence[str]) -> np.ndarray:
        """Logarithms (n, axles) of axle loads over the declared ones in `load_cases`, for factors (m,)."""
        change = np.zeros((len(load_cases), len(self.vehicle.axles)))
        limit = REACH_SD * self.sd
        for factor, value in zip(self.factors, np.clip(log_factors, -limit, limit), strict=True):
            if factor.quantity in (AXLE_LOAD, SCALE):
                rows = np.array([case in factor.load_cases for case in load_cases])
                change[rows, slice(None) if factor.quantity == SCALE else factor.place] += value
        return change

    def applied(self, log_factors: np.ndarray) -> tuple[Vehicle, dict[str, LoadCase]]:
        """Vehicle and load cases with the factors exp(`log_factors`), (m,), at most four tolerances from one."""
        limit = REACH_SD * self.sd
        vehicle, cases, declared_kg = self.vehicle, dict(self.load_cases), _unsprung_by_body(self.vehicle)
        for factor, amount in zip(self.factors, np.clip(log_factors, -limit, limit), strict=True):
            if factor.quantity in KINDS:
                continue
            if factor.quantity in FRAME_SD:
                cases = with_frame_mass(cases, len(vehicle.bodies), factor, float(amount))
            else:
                vehicle, cases = _apply(vehicle, cases, factor, float(np.exp(amount)), declared_kg)
        lost = _unsprung_by_body(vehicle) - declared_kg
        for name, case in cases.items():
            cases[name] = replace(case, sprung_mass_kg=tuple(np.array(case.sprung_mass_kg) - lost))
        return vehicle, cases


def uncertain_masses(campaign: Campaign) -> UncertainMasses:
    """Factors on the mass properties of a campaign's vehicle in the load cases of its runs and predictions.

    A property with the same declared value in several load cases is one property: its factor is shared.
    """
    vehicle, tolerances = campaign.vehicle, campaign.vehicle.tolerances
    used = campaign.load_cases_in_use
    factors = []
    for i, axle in enumerate(vehicle.axles):
        if axle.unsprung_mass_kg > 0.0:
            words = f"unsprung mass of axle {i + 1} ({axle.name})"
            name = f"unsprung_mass_{i + 1}"
            factors.append(MassFactor(name, UNSPRUNG, words, i, tolerances.unsprung_mass, tuple(used), axle=i))
    for i, group in enumerate(vehicle.groups):
        if group.mass_kg > 0.0:
            words, name = f"mass of the beam '{group.name}'", f"beam_mass[{group.name}]"
            factors.append(MassFactor(name, UNSPRUNG, words, i, tolerances.unsprung_mass, tuple(used)))
    for quantity, key, words, sd in (
        (INERTIA, "pitch_inertia", "pitch inertia", tolerances.pitch_inertia),
        (CG_HEIGHT, "cg_height", "height of the centre of gravity", tolerances.cg_height),
    ):
        for b, body in enumerate(vehicle.bodies):
            declared = {name: _declared(campaign.load_cases[name], quantity)[b] for name in used}
            for value in dict.fromkeys(v for v in declared.values() if v > 0.0):
                cases = tuple(name for name in used if declared[name] == value)
                shared = cases == tuple(used)
                label = body.name if shared else f"{body.name}, {cases[0]}"
                where = f"{words} of '{body.name}'" + ("" if shared else f" in load case '{cases[0]}'")
                case = None if shared else cases[0]
                factors.append(MassFactor(f"{key}[{label}]", quantity, where, b, sd, cases, load_case=case))
    for b, body in enumerate(vehicle.bodies):
        if body.hitch_height_m:
            words, name = f"hitch height of '{body.name}'", f"hitch_height[{body.name}]"
            factors.append(MassFactor(name, HITCH_HEIGHT, words, b, tolerances.hitch_height, tuple(used)))
    factors += [f for b in range(len(vehicle.bodies)) for f in frame_factors(vehicle, b, used)]
    if vehicle.driven_at == "road" and vehicle.hold_s is not None:
        factors.append(MassFactor("hold_time", HOLD, "time that holds the speed", 0, HOLD_SD, tuple(used)))
    factors += _axle_load_factors(vehicle, used)
    known = with_known_ends(vehicle, campaign.load_cases, used)
    return UncertainMasses(vehicle, known, tuple(f for f in factors if f.sd > 0.0))


def with_sides_of(masses: UncertainMasses, campaign: Campaign, felt: EffectiveRoads) -> UncertainMasses:
    """The masses, and after them what is not known about left and right, where sensors on one side show roll."""
    used = tuple(campaign.load_cases_in_use)
    sides = tuple(
        MassFactor(u.name, u.kind, u.words, u.place, u.sd, used, axle=u.axle, load_case=u.load_case, of=u.of)
        for u in side_unknowns(campaign, felt)
    )
    return replace(masses, factors=(*masses.factors, *sides))


def _axle_load_factors(vehicle: Vehicle, used: Sequence[str]) -> list[MassFactor]:
    """Factors on every reading of the scale, and on the scale itself."""
    tolerances = vehicle.tolerances
    factors = [
        MassFactor(
            f"axle_load_{i + 1}[{name}]",
            AXLE_LOAD,
            f"load of axle {i + 1} ({axle.name}) in load case '{name}'",
            i,
            tolerances.axle_load,
            (name,),
            axle=i,
            load_case=name,
        )
        for name in used
        for i, axle in enumerate(vehicle.axles)
    ]
    words = "scale that weighed all axles"
    return [*factors, MassFactor("axle_load_scale", SCALE, words, 0, tolerances.axle_load_scale, tuple(used))]


def _declared(case: LoadCase, quantity: str) -> tuple[float, ...]:
    return case.pitch_inertia_kg_m2 if quantity == INERTIA else case.cg_height_m


def _apply(
    vehicle: Vehicle, cases: dict[str, LoadCase], factor: MassFactor, value: float, declared_kg: np.ndarray
) -> tuple[Vehicle, dict[str, LoadCase]]:
    """Vehicle and load cases with one factor; `declared_kg` (bodies,) the unsprung masses before any factor."""
    at = factor.place
    if factor.quantity == HOLD:
        return replace(vehicle, hold_factor=vehicle.hold_factor * value), cases
    if factor.quantity == UNSPRUNG and factor.axle is not None:
        axle = vehicle.axles[at]
        axle = replace(axle, unsprung_mass_kg=axle.unsprung_mass_kg * value)
        return replace(vehicle, axles=_with(vehicle.axles, at, axle)), cases
    if factor.quantity == UNSPRUNG:
        # The inertia of a heavier beam of the same shape grows in proportion.
        beam = vehicle.groups[at]
        beam = replace(beam, mass_kg=beam.mass_kg * value, pitch_inertia_kg_m2=beam.pitch_inertia_kg_m2 * value)
        return replace(vehicle, groups=_with(vehicle.groups, at, beam)), cases
    if factor.quantity == HITCH_HEIGHT:
        body = vehicle.bodies[at]
        body = replace(body, hitch_height_m=(body.hitch_height_m or 0.0) * value)
        return replace(vehicle, bodies=_with(vehicle.bodies, at, body)), cases
    changed = dict(cases)
    if factor.quantity == SCALE:
        axles = tuple(replace(a, unsprung_mass_kg=a.unsprung_mass_kg * value) for a in vehicle.axles)
        groups = tuple(
            replace(g, mass_kg=g.mass_kg * value, pitch_inertia_kg_m2=g.pitch_inertia_kg_m2 * value)
            for g in vehicle.groups
        )
        vehicle = replace(vehicle, axles=axles, groups=groups)
    for name in factor.load_cases:
        case = changed[name]
        if factor.quantity == SCALE:
            changed[name] = _heavier(declared_kg, case, value)
            continue
        if factor.quantity == AXLE_LOAD:
            changed[name] = _weighed(vehicle, case, at, value)
            continue
        values = _with(_declared(case, factor.quantity), at, _declared(case, factor.quantity)[at] * value)
        if factor.quantity == INERTIA:
            changed[name] = replace(case, pitch_inertia_kg_m2=values)
        else:
            changed[name] = replace(case, cg_height_m=values)
    return vehicle, changed


def _weighed(vehicle: Vehicle, case: LoadCase, axle: int, value: float) -> LoadCase:
    """The load case with the load of one axle times `value`; its body carries the difference."""
    body, load = vehicle.axles[axle].body, case.axle_loads_kg[axle]
    sprung = case.sprung_mass_kg[body] + (value - 1.0) * load
    return replace(
        case,
        axle_loads_kg=_with(case.axle_loads_kg, axle, value * load),
        sprung_mass_kg=_with(case.sprung_mass_kg, body, sprung),
    )


def _heavier(declared_kg: np.ndarray, case: LoadCase, value: float) -> LoadCase:
    """The load case with all loads, masses and inertias times `value`.

    Changes of the unsprung masses from the declared ones (bodies,) [kg] are taken from the bodies afterwards.
    """
    # What the axles weigh more is taken from the bodies with those changes.
    sprung = value * np.array(case.sprung_mass_kg) + (value - 1.0) * declared_kg
    loads = value * np.array(case.axle_loads_kg)
    inertia = value * np.array(case.pitch_inertia_kg_m2)
    return replace(
        case,
        axle_loads_kg=tuple(loads.tolist()),
        sprung_mass_kg=tuple(sprung.tolist()),
        pitch_inertia_kg_m2=tuple(inertia.tolist()),
    )


def _with(values: Sequence[T], at: int, value: T) -> tuple[T, ...]:
    return (*values[:at], value, *values[at + 1 :])


def _unsprung_by_body(vehicle: Vehicle) -> np.ndarray:
    """Unsprung mass (bodies,) under every body, beams included [kg]."""
    total = np.zeros(len(vehicle.bodies))
    np.add.at(total, [a.body for a in vehicle.axles], vehicle.unsprung_mass_kg)
    return total
