"""What follows from the declared numbers of a vehicle alone, with the ranges in which road vehicles are.

Ranges hold for single axles of vans to heavy haulers, empty and laden; they are wider than those of the priors, which
say what is likely. Where none is cited they are general knowledge of the field.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import combinations, pairwise

from sysid.bookkeeping.elimination import Declared, Derived
from sysid.bookkeeping.usual_suspensions import LOG_SD, hitch_shares, suspension_values
from sysid.campaign.records import Campaign
from sysid.campaign.vehicle_records import Axle, LoadCase, Vehicle
from sysid.wording import shorten

#: Masses change together only: their sums are right.
MASSES = (
    "all masses (axle_loads_kg, sprung_mass_kg, unsprung_mass_kg)",
    ("axle_loads_kg", "unsprung_mass_kg", "sprung_mass_kg", "mass_kg"),
)
#: Load of an axle [kg]: of an empty light trailer, and of a heavy hauler.
LOAD_KG = (250.0, 25e3)
#: Static deflection of tires [mm]: 9 to 24 on trucks, 45 under 13 t, less under empty dollies.
TIRE_MM = (2.5, 80.0)
#: Hop of the unsprung mass on the tires alone [Hz].
HOP_HZ = (5.0, 20.0)
#: Share of critical damping by the tires alone.
TIRE_DAMPING = (0.0, 0.2)
#: Keys that enter the balance of the frames and no other comparison.
BALANCED = frozenset({"pitch_inertia_kg_m2", "hitch_x_m"})
#: Pressures of tires [kPa].
TIRE_KPA = (150.0, 1400.0)
#: The largest tires on roads, 16.00 R 20, have a radius of 0.67 m; the smallest of trucks a diameter of 0.71 m.
RADIUS_M = (0.3, 0.7)
#: Radius of gyration in pitch over the distance of the outermost supports.
GYRATION = (0.07, 0.75)
#: Heights above ground [m]: of centres of gravity, and of hitches.
HEIGHT_M, HITCH_M = (0.35, 2.8), (0.3, 1.7)
#: Place of a hitch over the distance of the outer axles of the body in front: fifth wheels, and drawbars behind.
HITCH_PLACE = (0.3, 2.0)
#: A hitch that carries more than this share of the weight behind it is a fifth wheel: above the tires, at this height
#: [m] at least, and at most at this place on a tractor.
LOADED, FIFTH_WHEEL_M, BETWEEN = 0.15, 0.7, 1.15
#: Sprung mass over the distance of the outermost supports [kg/m]: empty vans and trailers, and heavy haulers.
KG_PER_M = (60.0, 20e3)
#: Distance of neighbouring axles over the sum of the radii of their tires.
APART = (0.9, math.inf)
#: Travels of neighbours within this distance [m].
NEIGHBOURS_M, ALIKE = 2.0, (0.6, 1.0 / 0.6)
TRAVEL_MM = (10.0, 220.0)
PLANK_MM = (22.0, 250.0)
#: Bending modes of frames: frequency [Hz] and share of critical damping.
BENDING_HZ, BENDING_DAMPING = (2.0, 35.0), (0.002, 0.3)
#: Speeds over bumps [km/h]: crawling trucks, and more than anybody drives over one.
SPEED_KM_H = (0.1, 100.0)
#: Speeds to predict [km/h]: below, a bump is a static load.
PREDICTED_KM_H = (3.0, 100.0)
#: Inertia of a body in a load case over that in a lighter one, of the same sprung mass and of a larger one.
SAME_MASS, SAME = 0.01, (0.8, 1.25)
HEAVIER = (0.9, 12.0)


def declared_values(campaign: Campaign) -> list[Derived]:
    """Everything that follows from the vehicle, its load cases and the list of tests."""
    vehicle = campaign.vehicle
    return [
        *(d for axle in vehicle.axles for d in _of_axle(axle)),
        *(d for i in range(len(vehicle.axles)) for d in _tires(vehicle, i, campaign)),
        *(d for case in campaign.load_cases.values() for d in _of_load_case(vehicle, case)),
        *_between_load_cases(campaign),
        *_frames(vehicle, hitch_shares(campaign)),
        *_hitches(vehicle, hitch_shares(campaign)),
        *_alike(vehicle),
        *_distances(vehicle),
        *_beams(vehicle),
        *_of_tests(campaign),
        *suspension_values(campaign),
    ]


def of_axle(key: str, axle: Axle, value: float) -> Declared:
    """A number of an axle."""
    return Declared(key, f"'{shorten(axle.name)}'", value)


def of_tire(axle: Axle, power: float) -> dict[Declared, float]:
    """Powers of what declares the stiffness of tires: its value, and the pressures between which it is carried over."""
    powers = {of_axle("tire_stiffness_N_per_m", axle, axle.tire_stiffness_N_per_m): power}
    pressures = _pressures(axle)
    return {**powers, pressures[0]: power, pressures[1]: -power} if len(pressures) == 2 else powers


def _pressures(axle: Axle) -> list[Declared]:
    """Pressures of the tests and of the declared stiffness, as far as they are declared."""
    return [
        of_axle(key, axle, 1e-3 * value)
        for key, value in (
            ("inflation_pressure_kPa", axle.inflation_pressure_Pa),
            ("tire_stiffness_pressure_kPa", axle.tire_stiffness_pressure_Pa),
        )
        if value is not None
    ]


def _alone(number: Declared, what: str, usual: tuple[float, float], unit: str, scale: float = 1.0) -> Derived:
    """A number that is judged by itself."""
    return Derived(what, number.value * scale, *usual, unit, {number: 1.0})


def _of_axle(axle: Axle) -> Iterator[Derived]:
    name = shorten(axle.name)
    yield _alone(
        of_axle("tire_radius_m", axle, axle.tire_radius_m), f"the tires of '{name}' have a radius of", RADIUS_M, "m"
    )
    for key, value in (("jounce_travel_m", axle.jounce_travel_m), ("rebound_travel_m", axle.rebound_travel_m)):
        if value is not None:
            yield _alone(of_axle(key, axle, value), f"the suspension of '{name}' is free over", TRAVEL_MM, "mm", 1e3)
    for pressure in _pressures(axle):
        yield _alone(
            pressure, f"the {pressure.key.removesuffix('_kPa').replace('_', ' ')} of '{name}' is", TIRE_KPA, "kPa"
        )
    for quantity, prior in axle.priors.items():
        number = of_axle(f"priors.{quantity}.log_sd", axle, prior.log_sd)
        yield _alone(number, f"the prior of the {quantity.replace('_', ' ')} of '{name}' has a log_sd of", LOG_SD, "")
    if axle.leaf is not None:
        for key, value, usual in (
            ("width_m", axle.leaf.width_m, (35.0, 160.0)),
            ("thickness_m", axle.leaf.thickness_m, (4.0, 70.0)),
            ("length_m", axle.leaf.length_m, (400.0, 2500.0)),
        ):
            what = f"the leaves of '{name}' have a {key.removesuffix('_m')} of"
            yield _alone(of_axle(f"leaf.{key}", axle, value), what, usual, "mm", 1e3)


def _tires(vehicle: Vehicle, i: int, campaign: Campaign) -> Iterator[Derived]:
    axle, name = vehicle.axles[i], shorten(vehicle.axles[i].name)
    stiffness = axle.tire_stiffness_N_per_m
    unsprung = of_axle("unsprung_mass_kg", axle, vehicle.unsprung_mass_kg[i])
    for case in campaign.load_cases.values():
        load = Declared("axle_loads_kg", f"'{name}' in load case '{shorten(case.name)}'", case.axle_loads_kg[i])
        yield _alone(load, f"the axle load of {load.of} is", LOAD_KG, "kg")
        sag_mm = 1e3 * load.value * vehicle.gravity_m_s2 / stiffness
        what = f"the tires of '{name}' are compressed in load case '{shorten(case.name)}' by"
        yield Derived(what, sag_mm, *TIRE_MM, "mm", {**of_tire(axle, -1.0), load: 1.0})
    hop_hz = math.sqrt(stiffness / unsprung.value) / (2.0 * math.pi)
    yield Derived(
        f"the axle '{name}' hops on its tires at", hop_hz, *HOP_HZ, "Hz", {**of_tire(axle, 0.5), unsprung: -0.5}
    )
    if axle.tire_damping_N_s_per_m > 0.0:
        damping = of_axle("tire_damping_N_s_per_m", axle, axle.tire_damping_N_s_per_m)
        ratio = damping.value / (2.0 * math.sqrt(stiffness * unsprung.value))
        powers = {damping: 1.0, **of_tire(axle, -0.5), unsprung: -0.5}
        yield Derived(f"the damping ratio of the tires of '{name}' is", ratio, *TIRE_DAMPING, "", powers)


def of_drop(file: str, height_m: float) -> Declared:
    """The height of a plank."""
    return Declared("plank_height_m", f"the drop {shorten(file, 100)}", height_m)


def in_case(key: str, vehicle: Vehicle, body: int, case: LoadCase, value: float) -> Declared:
    """A number of a body in a load case."""
    return Declared(key, f"'{shorten(vehicle.bodies[body].name)}' in load case '{shorten(case.name)}'", value)


def span_m(vehicle: Vehicle, body: int) -> float:
    """Distance of the outermost supports of a body [m]."""
    places = [a.x_m for a in vehicle.axles if a.body == body]
    places += [b.hitch_x_m for k, b in enumerate(vehicle.bodies) if b.hitch_x_m is not None and k in (body, body + 1)]
    return max(places) - min(places) if places else 0.0


def _of_load_case(vehicle: Vehicle, case: LoadCase) -> Iterator[Derived]:
    for b, body in enumerate(vehicle.bodies):
        where = f"of '{shorten(body.name)}' in load case '{shorten(case.name)}'"
        inertia = in_case("pitch_inertia_kg_m2", vehicle, b, case, case.pitch_inertia_kg_m2[b])
        mass = in_case("sprung_mass_kg", vehicle, b, case, case.sprung_mass_kg[b])
        span = span_m(vehicle, b)
        if span > 0.0:
            gyration = math.sqrt(inertia.value / mass.value) / span
            what = f"the radius of gyration {where}, over the distance of its outermost supports, is"
            yield Derived(what, gyration, *GYRATION, "", {inertia: 0.5, mass: -0.5})
            what = f"the sprung mass {where}, over the distance of its outermost supports, is"
            yield Derived(what, mass.value / span, *KG_PER_M, "kg/m", {mass: 1.0})
        height = in_case("cg_height_m", vehicle, b, case, case.cg_height_m[b])
        yield _alone(height, f"the centre of gravity {where} is above ground by", HEIGHT_M, "m")


def _between_load_cases(campaign: Campaign) -> Iterator[Derived]:
    """Bodies of the same mass have the same inertia; cargo adds inertia."""
    vehicle, cases = campaign.vehicle, list(campaign.load_cases.values())
    for b, body in enumerate(vehicle.bodies):
        order = sorted(cases, key=lambda c: c.sprung_mass_kg[b])
        for light, heavy in pairwise(order):
            added = heavy.sprung_mass_kg[b] - light.sprung_mass_kg[b]
            same = added < SAME_MASS * light.sprung_mass_kg[b]
            names = f"load case '{shorten(heavy.name)}' over that in '{shorten(light.name)}'"
            for key, what in (
                ("pitch_inertia_kg_m2", "pitch inertia"),
                ("cg_height_m", "height of the centre of gravity"),
            ):
                one, other = getattr(light, key)[b], getattr(heavy, key)[b]
                powers = {in_case(key, vehicle, b, heavy, other): 1.0, in_case(key, vehicle, b, light, one): -1.0}
                ratio = other / one if one > 0.0 else 0.0
                if same and one > 0.0:
                    what = f"the {what} of '{shorten(body.name)}', which is as heavy in both, in {names} is"
                    yield Derived(what, ratio, *SAME, "", powers)
                elif key == "pitch_inertia_kg_m2":
                    yield Derived(f"the {what} of '{shorten(body.name)}' in {names} is", ratio, *HEAVIER, "", powers)


def _frames(vehicle: Vehicle, on_hitch: Mapping[int, float]) -> Iterator[Derived]:
    for b, body in enumerate(vehicle.bodies):
        of = f"'{shorten(body.name)}'"
        if body.bending is not None:
            number = Declared("bending.frequency_hz", of, body.bending.frequency_hz)
            yield _alone(number, f"the frame {of} bends at", BENDING_HZ, "Hz")
            number = Declared("bending.damping_ratio", of, body.bending.damping_ratio)
            yield _alone(number, f"the damping ratio of the bending frame {of} is", BENDING_DAMPING, "")
        if body.hitch_height_m is not None:
            number = Declared("hitch_height_m", f"'{shorten(body.name)}'", body.hitch_height_m)
            low = FIFTH_WHEEL_M if on_hitch.get(b, 0.0) > LOADED else HITCH_M[0]
            what = f"the hitch of '{shorten(body.name)}' is above ground by"
            yield _alone(number, what, (low, HITCH_M[1]), "m")


def _hitches(vehicle: Vehicle, on_hitch: Mapping[int, float]) -> Iterator[Derived]:
    """Hinges lie between the axles of the body in front or behind them, and in front of the axles of their own body."""
    for b, body in enumerate(vehicle.bodies):
        front = [a.x_m for a in vehicle.axles if a.body == b - 1]
        if body.hitch_x_m is None or len(front) < 2:
            continue
        number = Declared("hitch_x_m", f"'{shorten(body.name)}'", body.hitch_x_m)
        share = (body.hitch_x_m - min(front)) / (max(front) - min(front))
        name = f"'{shorten(vehicle.bodies[b - 1].name)}'"
        what = f"the place of the hitch of {number.of}, over the distance of the outer axles of {name}, is"
        # A tractor carries its load between its axles; the first trailer of two may carry it behind them.
        furthest = BETWEEN if b == 1 and on_hitch.get(b, 0.0) > LOADED else HITCH_PLACE[1]
        yield Derived(what, max(share, 1e-9), HITCH_PLACE[0], furthest, "", {number: 1.0})


def _alike(vehicle: Vehicle) -> Iterator[Derived]:
    """Neighbours with one kind of suspension under one body have the same travels."""
    for i, j in combinations(range(len(vehicle.axles)), 2):
        one, other = vehicle.axles[i], vehicle.axles[j]
        if (one.body, one.suspension) != (other.body, other.suspension) or other.x_m - one.x_m > NEIGHBOURS_M * (j - i):
            continue
        for key in ("jounce_travel_m", "rebound_travel_m"):
            first, second = getattr(one, key), getattr(other, key)
            if first is not None and second is not None:
                travel = key.removesuffix("_m").replace("_", " ")
                what = f"the {travel} of '{shorten(one.name)}' over that of '{shorten(other.name)}' beside it is"
                powers = {of_axle(key, one, first): 1.0, of_axle(key, other, second): -1.0}
                yield Derived(what, first / second, *ALIKE, "", powers)


def _distances(vehicle: Vehicle) -> Iterator[Derived]:
    """Wheels of neighbouring axles do not touch."""
    for one, other in pairwise(vehicle.axles):
        share = (other.x_m - one.x_m) / (one.tire_radius_m + other.tire_radius_m)
        # Axles that are listed from the rear are told by the order in which they meet the bump.
        if share <= 0.0:
            continue
        powers = {of_axle("x_m", other, other.x_m): 1.0}
        powers |= {of_axle("tire_radius_m", axle, axle.tire_radius_m): -1.0 for axle in (one, other)}
        what = f"the distance of '{shorten(one.name)}' and '{shorten(other.name)}' over the sum of their tire radii is"
        yield Derived(what, share, *APART, "", powers)


def _beams(vehicle: Vehicle) -> Iterator[Derived]:
    for group in vehicle.groups:
        places = [vehicle.axles[i].x_m for i in group.axles]
        if group.mass_kg > 0.0 and group.pitch_inertia_kg_m2 > 0.0 and len(places) > 1:
            of = f"'{shorten(group.name)}'"
            inertia = Declared("pitch_inertia_kg_m2", of, group.pitch_inertia_kg_m2)
            ratio = math.sqrt(group.pitch_inertia_kg_m2 / group.mass_kg) / (max(places) - min(places))
            powers = {inertia: 0.5, Declared("mass_kg", of, group.mass_kg): -0.5}
            what = f"the radius of gyration of the beam {of}, over the distance of its outer axles, is"
            yield Derived(what, ratio, 0.05, 2.0, "", powers)


def _of_tests(campaign: Campaign) -> Iterator[Derived]:
    heights = dict.fromkeys(
        (d.plank_height_m, d.log.file) for d in campaign.plank_drops if d.plank_height_m is not None
    )
    for height, file in heights:
        yield _alone(of_drop(file, height), f"the plank of {shorten(file, 100)} is high", PLANK_MM, "mm", 1e3)
    for run in campaign.bump_runs:
        number = Declared("nominal_speed_km_h", shorten(run.log.file, 100), 3.6 * run.nominal_speed_m_s)
        yield _alone(number, "a truck passes the bump at", SPEED_KM_H, "km/h")
    low_pass = campaign.acquisition.filter
    if low_pass is not None:
        number = Declared("cutoff_hz", "acquisition.filter", low_pass.cutoff_hz)
        yield _alone(number, "the anti-alias filter cuts off at", (4.0, math.inf), "Hz")
    for i, request in enumerate(campaign.predictions):
        number = Declared("speed_km_h", f"tests.prediction[{i + 1}]", 3.6 * request.speed_m_s)
        yield _alone(number, "a truck passes the bump at", PREDICTED_KM_H, "km/h")
        if request.shape is not None and request.shape.height_m is not None:
            number = Declared("shape.height_m", f"tests.prediction[{i + 1}]", request.shape.height_m)
            yield _alone(number, "the bump to predict is high", (5.0, 300.0), "mm", 1e3)
