"""The tractor-trailer of the misfit campaigns: the shipped campaign file, nominal suspensions, and other physics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sysid.campaign.read import read_campaign
from sysid.campaign.records import Campaign
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
from sysid.vehicle_model.lanes import EffectiveRoads, MapTires

ROOT = Path(__file__).resolve().parents[2]
#: Nominal k [N/m] and c [N s/m] per axle of a tractor with a lowboy trailer.
NOMINAL_STIFFNESS = (4.2e5, 3.5e5, 3.5e5, 1.1e6, 1.1e6, 1.1e6)
NOMINAL_DAMPING = (1.0e4, 1.0e4, 1.0e4, 1.2e4, 1.2e4, 1.2e4)
NO_ELEMENTS: frozenset[str] = frozenset()
FRICTION = frozenset({"friction"})


@dataclass(frozen=True)
class Physics:
    """How the true vehicle differs from the model: `cams` share of the cams' contact in that of radial springs.

    `spokes` is added to the exponent of the radial springs that goes with the tire's load law; `friction_share` of the
    load that leaf springs carry is Coulomb friction.
    """

    name: str
    cams: float = 0.0
    spokes: float = 0.0
    friction_share: float = 0.0


class MixedRoads(EffectiveRoads):
    """Contact between radial springs and tandem cams."""

    def __init__(self, vehicle, load_cases, profiles, tires: MapTires, physics: Physics):
        super().__init__(vehicle, load_cases, profiles, tires=tires)
        self._physics = physics

    def _make_maps(self, load_case: str, bump: str) -> tuple[FootprintMap, ...]:
        springs = super()._make_maps(load_case, bump)
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


def nominal_drops(campaign: Campaign) -> DropSummary:
    """Drops that tell the nominal suspensions: medians of the priors behind truth and fit alike."""
    case, nan = next(iter(campaign.load_cases)), float("nan")
    pairs = zip(NOMINAL_STIFFNESS, NOMINAL_DAMPING, strict=True)
    estimates = tuple(
        DropEstimate(i, case, None, "model", k, 0.0, c, 0.0, nan, nan, True) for i, (k, c) in enumerate(pairs)
    )
    return DropSummary((), estimates)


@dataclass(frozen=True)
class Plan:
    """The planned campaign, the parameters of its fit and its road profiles."""

    campaign: Campaign
    parameters: ParameterSet
    profiles: Mapping[str, RoadProfile]


def tractor_trailer(repeats: int = 1) -> Plan:
    """The shipped campaign with blank records and at most `repeats` runs per case."""
    read = read_campaign(ROOT / "data" / "campaign.toml", point_cloud_reader=read_point_cloud)
    profiles = {name: analyse_scan(s).profile for name, s in read.scans.items()}
    runs = tuple(r for r in read.bump_runs if r.repeat <= repeats)
    campaign = planned_campaign(replace(read, bump_runs=runs, plank_drops=()), profiles)
    return Plan(campaign, campaign_parameters(campaign, nominal_drops(campaign)), profiles)


def misfit_world(plan: Plan, physics: Physics, random: np.random.Generator) -> World:
    """A vehicle from the priors with other physics than the model's, masses within their tolerances."""
    masses = uncertain_masses(plan.campaign)
    vehicle, load_cases = masses.applied(masses.sd * random.standard_normal(masses.sd.size))
    truth = dict(zip(plan.parameters.names, draw_parameters(plan.parameters, random), strict=True))
    axles = tuple(
        replace(a, tire_stiffness_N_per_m=float(np.exp(truth[f"kt_{i + 1}"]))) for i, a in enumerate(vehicle.axles)
    )
    vehicle = replace(vehicle, axles=axles)
    true = replace(plan.campaign, vehicle=vehicle, load_cases=load_cases)
    rubbing = physics.friction_share > 0.0
    laws = [FRICTION if rubbing and a.suspension == "leaf" else NO_ELEMENTS for a in axles]
    parameters = campaign_parameters(true, nominal_drops(true), laws)
    first = next(iter(load_cases.values()))
    for p in parameters.parameters:
        if p.quantity == "friction" and p.axle is not None:
            carried = (first.axle_loads_kg[p.axle] - axles[p.axle].unsprung_mass_kg) * vehicle.gravity_m_s2
            truth[p.name] = np.log(physics.friction_share * carried) + 0.3 * random.standard_normal()
        truth.setdefault(p.name, np.log(p.prior_median))
    values = np.array([truth[n] for n in parameters.names])
    tires = map_tires(parameters, values)
    tires = replace(tires, spoke_exponent=tires.spoke_exponent + physics.spokes)
    return World(true, parameters, values, MixedRoads(vehicle, load_cases, plan.profiles, tires, physics))
