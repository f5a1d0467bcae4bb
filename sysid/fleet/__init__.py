"""Fleets: many campaigns calibrated side by side, and what they say of the trucks and of the population."""

from __future__ import annotations

import importlib
from typing import Any

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
    "run_fleet",
    "simulate_fleet",
]


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used."""
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
