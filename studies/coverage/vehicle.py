"""The vehicles of the misfit campaigns: the linear truck and a three-axle truck, with other physics."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sysid.campaign.read import read_campaign
from sysid.campaign.records import Campaign
from sysid.campaign.vehicle_records import Axle, Equaliser, FrameBending, LoadCase, Vehicle
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.parameters.map_tires import map_tires
from sysid.estimation.parameters.parameter_set import ParameterSet
from sysid.estimation.uncertainty.uncertain_masses import uncertain_masses
from sysid.road.contact_laws import cam_map
from sysid.road.enveloping import FootprintMap
from sysid.road.point_cloud import read_point_cloud
from sysid.road.road_profile import RoadProfile
from sysid.road.scan import analyse_scan
from sysid.sdof.drop_results import DropEstimate, DropSummary
from sysid.selftest.readings import planned_campaign
from sysid.selftest.world import World, draw_parameters
from sysid.vehicle_model.passes import EffectiveRoads, MapTires

ROOT = Path(__file__).resolve().parents[2]
#: Nominal k [N/m] and c [N s/m] per axle of a tractor with a lowboy trailer, and of a three-axle truck.
NOMINAL = {
    "tractor-trailer": ((4.2e5, 3.5e5, 3.5e5, 1.1e6, 1.1e6, 1.1e6), (1.0e4, 1.0e4, 1.0e4, 1.2e4, 1.2e4, 1.2e4)),
    "three-axle truck": ((4.3e5, 3.3e5, 3.0e5), (1.05e4, 1.4e4, 1.25e4)),
}
#: Travels [m] before stops in vehicles whose campaign file does not declare any.
JOUNCE_M, REBOUND_M = 0.075, 0.085
#: Way that is rough before and behind a bump [m].
ROUGH_WAY_M = (32.0, 30.0)
#: Damping ratio of frames that bend.
BENDING_RATIO = 0.025


@dataclass(frozen=True)
class Physics:
    """How the true vehicle differs from linear suspensions on radial springs with masses as declared.

    `cams` share of the cams' contact in that of radial springs; `spokes` is added to the exponent of the radial springs
    that goes with the tire's load law; `friction` of the load that leaf springs carry is Coulomb friction; `elements`
    further elements of the suspensions; `rocker` load share of a rocker between the rear axles of the first body;
    `stops` at undeclared travels; `scales` standard deviation of the error of each axle load; `bending_hz` frequency at
    which the frame of the last body bends by itself, 0 for a rigid one; `speed_change` relative change of speed in
    every run, None for the usual ones; `roughness_m3` of the road at 0.1 cycles per metre; `outliers` share of readings
    that are far off.
    """

    name: str
    cams: float = 0.0
    spokes: float = 0.0
    friction: float = 0.0
    elements: tuple[str, ...] = ()
    rocker: float = 0.0
    stops: bool = False
    scales: float = 0.0
    bending_hz: float = 0.0
    speed_change: float | None = None
    roughness_m3: float = 0.0
    outliers: float = 0.0

    @property
    def linear(self) -> bool:
        """Whether the suspensions are linear, so that any other law is a false one."""
        return not (self.friction or self.elements or self.stops)

    def laws(self, vehicle: Vehicle) -> tuple[frozenset[str], ...]:
        """Elements of every axle; gas springs are air springs only, friction is that of leaves."""

        def of(axle: Axle) -> frozenset[str]:
            law = set(self.elements) - (set() if axle.suspension == "air" else {"gas_spring"})
            if self.friction and axle.suspension == "leaf":
                law.add("friction")
            return frozenset(law | ({"bump_stops"} if self.stops else set()))

        return tuple(of(axle) for axle in vehicle.axles)


class MixedRoads(EffectiveRoads):
    """Contact between radial springs and tandem cams."""

    def __init__(self, vehicle, load_cases, profiles, tires: MapTires, physics: Physics):
        super().__init__(vehicle, load_cases, profiles, tires=tires)
        self._physics = physics

    def _make_maps(self, load_case: str, bump: str, run: str) -> tuple[FootprintMap, ...]:
        springs = super()._make_maps(load_case, bump, run)
        if self._physics.cams == 0.0:
            return springs
        case, gravity = self.load_cases[load_case], self.vehicle.gravity_m_s2
        found = []
        for i, axle in enumerate(self.vehicle.axles):
            deflection = case.axle_loads_kg[i] * gravity / self.tires.stiffness_N_per_m[i]
            cams = cam_map(self.profiles[bump], axle.tire_radius_m, deflection)
            found.append(_mixed(springs[i], cams, self._physics.cams))
        return tuple(found)


def _mixed(springs: FootprintMap, cams: FootprintMap, share: float) -> FootprintMap:
    """(1 - share) springs + share cams on the stations of both."""
    step = float(springs.station_m[1] - springs.station_m[0])
    first = min(round(m.station_m[0] / step) for m in (springs, cams))
    last = max(round(m.station_m[-1] / step) for m in (springs, cams))

    def part(m: FootprintMap, values: np.ndarray) -> np.ndarray:
        before = round(m.station_m[0] / step) - first
        after = last - first + 1 - before - m.station_m.size
        return np.pad(values, [(0, 0)] * (values.ndim - 1) + [(before, after)])

    def mixed(name: str) -> np.ndarray:
        return (1.0 - share) * part(springs, getattr(springs, name)) + share * part(cams, getattr(cams, name))

    return FootprintMap(
        np.arange(first, last + 1) * step,
        mixed("rise_m"),
        mixed("stretch"),
        mixed("drag"),
        part(springs, springs.lift_m),
        springs.misfit_m,
    )


def nominal_drops(campaign: Campaign, kind: str) -> DropSummary:
    """Drops that tell the nominal suspensions: medians of the priors behind truth and fit alike."""
    case, nan = next(iter(campaign.load_cases)), float("nan")
    estimates = tuple(
        DropEstimate(i, case, None, "model", k, 0.0, c, 0.0, nan, nan, True)
        for i, (k, c) in enumerate(zip(*NOMINAL[kind], strict=True))
    )
    return DropSummary((), estimates)


@dataclass(frozen=True)
class Plan:
    """The planned campaign of one `kind` of vehicle, what its drops say, its linear parameters and its roads."""

    kind: str
    campaign: Campaign
    drops: DropSummary
    parameters: ParameterSet
    profiles: Mapping[str, RoadProfile]


def tractor_trailer(repeats: int = 1) -> Plan:
    """The linear truck with blank records and at most `repeats` runs per case."""
    return _plan("tractor-trailer", ROOT / "examples" / "linear_truck" / "campaign.toml", repeats)


def three_axle_truck(folder: Path) -> Plan:
    """A rigid truck with an air-sprung tandem over a bump, empty and laden; its campaign is written to `folder`."""
    if not (folder / "campaign.toml").exists():
        command = [sys.executable, "-m", "tests.support.synthetic_campaign", "--vehicle", "rigid3", "--seed", "5"]
        subprocess.run([*command, "--output", str(folder)], cwd=ROOT, check=True, capture_output=True)
    return _plan("three-axle truck", folder / "campaign.toml", 1)


def _plan(kind: str, file: Path, repeats: int) -> Plan:
    read = read_campaign(file, point_cloud_reader=read_point_cloud)
    profiles = {name: analyse_scan(s).profile for name, s in read.scans.items()}
    runs = tuple(r for r in read.bump_runs if r.repeat <= repeats)
    undeclared = tuple(replace(a, suspension_law=None) for a in read.vehicle.axles)
    vehicle = replace(read.vehicle, axles=undeclared)
    campaign = planned_campaign(replace(read, vehicle=vehicle, bump_runs=runs, plank_drops=()), profiles)
    drops = nominal_drops(campaign, kind)
    return Plan(kind, campaign, drops, campaign_parameters(campaign, drops), profiles)


def misfit_world(plan: Plan, physics: Physics, random: np.random.Generator) -> World:
    """A vehicle from the priors with other physics than the model's, masses within their tolerances."""
    masses = uncertain_masses(plan.campaign)
    vehicle, load_cases = masses.applied(masses.sd * random.standard_normal(masses.sd.size))
    truth = dict(zip(plan.parameters.names, draw_parameters(plan.parameters, random), strict=True))
    load_cases = _weighed_wrongly(vehicle, load_cases, physics.scales * random.standard_normal(len(vehicle.axles)))
    axles = tuple(
        replace(
            a,
            tire_stiffness_N_per_m=float(np.exp(truth[f"kt_{i + 1}"])),
            jounce_travel_m=JOUNCE_M if physics.stops else a.jounce_travel_m,
            rebound_travel_m=REBOUND_M if physics.stops else a.rebound_travel_m,
        )
        for i, a in enumerate(vehicle.axles)
    )
    vehicle = replace(vehicle, axles=axles)
    if physics.rocker:
        tandem = tuple(i for i, a in enumerate(axles) if a.body == axles[0].body)[-2:]
        vehicle = replace(vehicle, equalisers=(Equaliser("rocker", tandem, physics.rocker),))
    if physics.bending_hz:
        bent = replace(vehicle.bodies[-1], bending=FrameBending(physics.bending_hz, BENDING_RATIO))
        vehicle = replace(vehicle, bodies=(*vehicle.bodies[:-1], bent))
    true = replace(plan.campaign, vehicle=vehicle, load_cases=load_cases)
    parameters = campaign_parameters(true, plan.drops, list(physics.laws(vehicle)))
    first = next(iter(load_cases.values()))
    for p in parameters.parameters:
        if p.quantity == "friction" and p.axle is not None and axles[p.axle].suspension == "leaf":
            carried = (first.axle_loads_kg[p.axle] - axles[p.axle].unsprung_mass_kg) * vehicle.gravity_m_s2
            share = physics.friction or 0.05
            truth[p.name] = np.log(share * carried) + 0.3 * random.standard_normal()
        elif p.quantity == "bending_frequency":
            truth[p.name] = np.log(p.prior_median)
        elif p.name not in truth:
            truth[p.name] = np.log(p.prior_median) + 0.2 * random.standard_normal()
    values = np.array([truth[n] for n in parameters.names])
    tires = map_tires(parameters, values)
    tires = replace(tires, spoke_exponent=tires.spoke_exponent + physics.spokes)
    profiles = plan.profiles
    if physics.roughness_m3:
        profiles = {name: rough_profile(p, physics.roughness_m3, random) for name, p in profiles.items()}
    return World(true, parameters, values, MixedRoads(vehicle, load_cases, profiles, tires, physics))


def rough_profile(profile: RoadProfile, roughness_m3: float, random: np.random.Generator) -> RoadProfile:
    """A bump on a rough road: elevation of power spectral density G(n) = G0 (n / 0.1)^-2 (ISO 8608), n in cycles per
    metre, as a sum of waves of random phase.
    """
    step = float(profile.station_m[1] - profile.station_m[0])
    count = [round(way / step) for way in ROUGH_WAY_M]
    station = profile.station_m[0] + step * np.arange(-count[0], profile.station_m.size + count[1])
    n = np.arange(0.05, 5.0, 0.02)
    size = np.sqrt(2.0 * roughness_m3 * (n / 0.1) ** -2 * 0.02)
    phase = 2.0 * np.pi * random.uniform(size=n.size)
    rough = np.sum(size[:, None] * np.cos(2.0 * np.pi * n[:, None] * station + phase[:, None]), axis=0)
    inside = np.clip(np.minimum(station - station[0], station[-1] - station), 0.0, 1.0)
    height = np.pad(profile.height_m, count) + rough * inside
    return replace(profile, station_m=station, height_m=height, height_sd_m=np.pad(profile.height_sd_m, count))


def _weighed_wrongly(vehicle: Vehicle, cases: Mapping[str, LoadCase], error: np.ndarray) -> dict[str, LoadCase]:
    """Load cases whose true axle loads are `error` (axles,) off the declared ones; the bodies carry the difference."""
    found = {}
    for name, case in cases.items():
        declared = np.array(case.axle_loads_kg)
        sprung = np.array(case.sprung_mass_kg)
        np.add.at(sprung, [a.body for a in vehicle.axles], error * declared)
        found[name] = replace(case, axle_loads_kg=tuple(declared * (1.0 + error)), sprung_mass_kg=tuple(sprung))
    return found
