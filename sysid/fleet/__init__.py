"""Fleets: many campaigns calibrated side by side, and what they say of the trucks and of the population."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sysid.lazy_names import lazy_names

if TYPE_CHECKING:
    from sysid.fleet.outcome import Outcome
    from sysid.fleet.population import TypePopulation
    from sysid.fleet.read import read_fleet
    from sysid.fleet.records import Fleet, FleetCampaign, SharedError, Truck
    from sysid.fleet.results import compute
    from sysid.fleet.running import Row, RunOptions, recalibrate, run_fleet
    from sysid.fleet.simulate import SimulatedFleet, simulate_fleet

_HOMES = {
    "Fleet": "sysid.fleet.records",
    "FleetCampaign": "sysid.fleet.records",
    "Outcome": "sysid.fleet.outcome",
    "Row": "sysid.fleet.running",
    "RunOptions": "sysid.fleet.running",
    "SharedError": "sysid.fleet.records",
    "Truck": "sysid.fleet.records",
    "SimulatedFleet": "sysid.fleet.simulate",
    "TypePopulation": "sysid.fleet.population",
    "compute": "sysid.fleet.results",
    "read_fleet": "sysid.fleet.read",
    "recalibrate": "sysid.fleet.running",
    "run_fleet": "sysid.fleet.running",
    "simulate_fleet": "sysid.fleet.simulate",
}

__all__ = [
    "Fleet",
    "FleetCampaign",
    "Outcome",
    "Row",
    "RunOptions",
    "SharedError",
    "SimulatedFleet",
    "Truck",
    "TypePopulation",
    "compute",
    "read_fleet",
    "recalibrate",
    "run_fleet",
    "simulate_fleet",
]

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
