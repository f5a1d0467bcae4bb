"""What follows from declared springs, dampers, priors, tolerances and the share of a body on its hitch."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping

import numpy as np

from sysid.bookkeeping.elimination import Declared, Derived
from sysid.campaign.records import Campaign
from sysid.campaign.statics import carried_by_suspensions, static_equilibrium
from sysid.campaign.vehicle_records import Axle, Vehicle
from sysid.errors import CampaignError
from sysid.wording import shorten

#: Bounce on the suspension alone [Hz], under the mass that it carries: air springs from 0.9, empty leaves up to 4.
BOUNCE_HZ = (0.45, 7.0)
#: Damping as a share of critical at 2 Hz, c / (2 m 2 pi 2).
DAMPING = (0.015, 2.0)
_AT_HZ = 2.0
#: Ends of tables: extension [mm], force over the weight carried, and rate [m/s].
EXTENSION_MM, FORCE, RATE_M_S = (15.0, 400.0), (0.2, 20.0), (0.08, 5.0)
#: Standard deviations of priors: one tells something, and leaves something to be found.
LOG_SD = (0.01, 4.0)
#: Coulomb friction over the weight carried.
FRICTION = (0.002, 0.4)
#: Lash between a leaf and its hanger [mm].
LASH_MM = (0.3, 40.0)
#: Relative tolerances: of masses, inertias and heights, and of scales, which read to 2 % at worst.
TOLERANCE, SCALE = (1e-3, 0.35), (2e-4, 0.04)
#: 1 + load on the hitch over the weight of the body behind it: drawbars carry nothing, semitrailers half of it.
ON_HITCH = (0.85, 1.62)
_SCALES = ("axle_load", "axle_load_scale")
_NAMED = re.compile(r"(k|c|kt|ct|F)_(\d+)(?:\[.*\])?")
_QUANTITY = {"k": "stiffness", "c": "damping", "kt": "tire_stiffness", "ct": "tire_damping", "F": "friction"}


def suspension_values(campaign: Campaign) -> Iterator[Derived]:
    """Values of tables, priors, tolerances and hitches."""
    vehicle = campaign.vehicle
    carried = _carried_kg(campaign)
    for i, axle in enumerate(vehicle.axles):
        of = f"'{shorten(axle.name)}'"
        if i in carried:
            yield from _tables(axle, of, *carried[i])
            for quantity, prior in axle.priors.items():
                unit = "N_per_m" if "stiffness" in quantity else "N_s_per_m"
                number = Declared(f"median of priors.{quantity}_{unit}", of, prior.median)
                yield from _prior(quantity, number, axle, carried[i], f"priors.{quantity}_{unit} of {of}")
        if axle.hanger_lash_m is not None:
            number = Declared("hanger_lash_m", of, axle.hanger_lash_m)
            yield Derived(f"the lash of {of} is", 1e3 * number.value, *LASH_MM, "mm", {number: 1.0})
    for name, own in campaign.priors.items():
        shown = f"priors.{shorten(name)}"
        sd = Declared(f"{shown}.log_sd", "", own.log_sd)
        yield Derived(f"the prior of {shorten(name)} has a log_sd of", own.log_sd, *LOG_SD, "", {sd: 1.0})
        match = _NAMED.fullmatch(name)
        at = int(match[2]) - 1 if match else -1
        if match and at in carried:
            unit = "" if own.unit == "1" else f"_{own.unit.replace('/', '_per_').replace(' ', '_')}"
            number = Declared(f"{shown}.median{unit}", "", own.median)
            yield from _prior(_QUANTITY[match[1]], number, vehicle.axles[at], carried[at], shown)
    for key, value in vars(vehicle.tolerances).items():
        if value > 0.0:
            number = Declared(f"tolerances.{key}", "", value)
            usual = SCALE if key in _SCALES else TOLERANCE
            yield Derived(f"the {key.replace('_', ' ')} has a tolerance of", value, *usual, "", {number: 1.0})
    yield from _on_hitches(campaign)


def _carried_kg(campaign: Campaign) -> Mapping[int, tuple[float, float]]:
    """The least and the largest mass that each suspension carries in the load cases, by axle."""
    unsprung, together = np.array(campaign.vehicle.unsprung_mass_kg), carried_by_suspensions(campaign.vehicle)
    masses = np.array([together @ (np.array(c.axle_loads_kg) - unsprung) for c in campaign.load_cases.values()])
    if not masses.size:
        return {}
    return {i: (float(m.min()), float(m.max())) for i, m in enumerate(masses.T) if m.min() > 0.0}


def _tables(axle: Axle, of: str, least_kg: float, most_kg: float) -> Iterator[Derived]:
    """Springs and dampers given as curves; their tangent at rest, and their ends."""
    gravity = 9.81
    if axle.spring_table is not None:
        x, force = np.array(axle.spring_table.position), np.array(axle.spring_table.force_N)
        reach, end = (
            Declared("spring_table.extension_m", of, np.ptp(x)),
            Declared("spring_table.force_N", of, np.ptp(force)),
        )
        tangent = (np.interp(0.05 * reach.value, x, force) - np.interp(-0.05 * reach.value, x, force)) / (
            0.1 * reach.value
        )
        if tangent > 0.0:
            yield _bounce(f"on its spring_table, {of} bounces at", tangent, least_kg, most_kg, {end: 0.5, reach: -0.5})
        yield Derived(f"the spring_table of {of} reaches over", 1e3 * reach.value, *EXTENSION_MM, "mm", {reach: 1.0})
        share = end.value / (gravity * most_kg)
        yield Derived(
            f"the forces in the spring_table of {of}, over the weight carried, reach over",
            share,
            *FORCE,
            "",
            {end: 1.0},
        )
    if axle.damper_table is not None:
        rate, force = np.array(axle.damper_table.position), np.array(axle.damper_table.force_N)
        fast, end = (
            Declared("damper_table.rate_m_s", of, np.ptp(rate)),
            Declared("damper_table.force_N", of, np.ptp(force)),
        )
        yield Derived(f"the damper_table of {of} reaches over", fast.value, *RATE_M_S, "m/s", {fast: 1.0})
        if end.value > 0.0:
            what = f"the damping of {of} by its damper_table, as a share of critical at {_AT_HZ:g} Hz, is"
            yield _damped(what, end.value / fast.value, least_kg, most_kg, {end: 1.0, fast: -1.0})


def _bounce(what: str, stiffness: float, least_kg: float, most_kg: float, powers: Mapping[Declared, float]) -> Derived:
    """The frequency under the middle of the masses carried, with a range that holds for all of them."""
    middle = math.sqrt(least_kg * most_kg)
    hz = math.sqrt(stiffness / middle) / (2.0 * math.pi)
    wide = (most_kg / least_kg) ** 0.25
    return Derived(what, hz, BOUNCE_HZ[0] / wide, BOUNCE_HZ[1], "Hz", powers)


def _damped(what: str, damping: float, least_kg: float, most_kg: float, powers: Mapping[Declared, float]) -> Derived:
    share = damping / (2.0 * math.sqrt(least_kg * most_kg) * 2.0 * math.pi * _AT_HZ)
    return Derived(what, share, *DAMPING, "", powers)


def _prior(
    quantity: str, number: Declared, axle: Axle, carried_kg: tuple[float, float], shown: str
) -> Iterator[Derived]:
    """The median of a prior against the mass carried, or against what else is declared of the same thing."""
    if quantity == "stiffness":
        yield _bounce(f"with the median of {shown}, the axle bounces at", number.value, *carried_kg, {number: 0.5})
    elif quantity == "damping":
        what = f"with the median of {shown}, the share of critical damping at {_AT_HZ:g} Hz is"
        yield _damped(what, number.value, *carried_kg, {number: 1.0})
    elif quantity == "friction":
        share = number.value / (9.81 * carried_kg[1])
        yield Derived(f"the median of {shown}, over the weight carried, is", share, *FRICTION, "", {number: 1.0})
    elif quantity == "tire_stiffness":
        ratio = number.value / axle.tire_stiffness_N_per_m
        yield Derived(
            f"the median of {shown}, over the declared tire stiffness, is", ratio, 0.5, 2.0, "", {number: 1.0}
        )
    elif quantity == "tire_damping" and axle.tire_damping_N_s_per_m > 0.0:
        ratio = number.value / axle.tire_damping_N_s_per_m
        yield Derived(f"the median of {shown}, over the declared tire damping, is", ratio, 0.1, 10.0, "", {number: 1.0})


def hitch_shares(campaign: Campaign) -> dict[int, float]:
    """Largest load on the hitch of each coupled body over the body's weight."""
    vehicle: Vehicle = campaign.vehicle
    shares: dict[int, float] = {}
    for case in campaign.load_cases.values():
        try:
            statics = static_equilibrium(vehicle, case)
        except CampaignError:
            continue
        for b, body in enumerate(vehicle.bodies):
            if body.hitch_x_m is not None:
                share = float(statics.hitch_load_N[b]) / (vehicle.gravity_m_s2 * case.sprung_mass_kg[b])
                shares[b] = max(share, shares.get(b, 0.0), key=abs)
    return shares


def _on_hitches(campaign: Campaign) -> Iterator[Derived]:
    """Shares of weights, which no factor on all masses changes: they are told by sprung masses over axle loads."""
    vehicle = campaign.vehicle
    case = next(iter(campaign.load_cases.values()), None)
    for b, share in hitch_shares(campaign).items():
        last = max((i for i, axle in enumerate(vehicle.axles) if axle.body == b), default=None)
        if case is None or last is None:
            continue
        name, where = f"'{shorten(vehicle.bodies[b].name)}'", f"in load case '{shorten(case.name)}'"
        powers = {
            Declared("sprung_mass_kg", f"{name} {where}", case.sprung_mass_kg[b]): -1.0,
            Declared("axle_loads_kg", f"'{shorten(vehicle.axles[last].name)}' {where}", case.axle_loads_kg[last]): 1.0,
        }
        what = f"one and the load on the hitch of {name}, over its weight, is"
        yield Derived(what, max(1.0 + share, 1e-3), *ON_HITCH, "", powers)
