"""The vehicles of `tests/data/vehicles`: tables of a campaign file, and what stands behind their synthetic logs.

Those of which only the truth stands there have the tables of the template of the same name.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid.campaign.toml import schema
from sysid.campaign.toml.vehicle_tables import VehicleReader
from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.first_look.templates import template_text

FOLDER = Path(__file__).resolve().parents[1] / "data" / "vehicles"
NAMES = tuple(sorted(p.stem for p in FOLDER.glob("*.toml")))


@dataclass(frozen=True)
class Behind:
    """True values per axle: `stiffness` by load case, `damping`, `tire_stiffness` and `tire_damping`, all SI."""

    stiffness: dict[str, np.ndarray]
    damping: np.ndarray
    tire_stiffness: np.ndarray
    tire_damping: np.ndarray


@dataclass(frozen=True)
class ExampleVehicle:
    """`text` of the vehicle's tables as they stand in a campaign file, its records, and the truth behind its logs."""

    text: str
    vehicle: Vehicle
    load_cases: dict[str, LoadCase]
    behind: Behind


def example_vehicle(name: str) -> ExampleVehicle:
    """A vehicle of `tests/data/vehicles`, read by the package's own reader."""
    text = (FOLDER / f"{name}.toml").read_text(encoding="utf-8")
    if "\n[vehicle]\n" not in text:
        text = f"{template_text(name)}\n{text}"
    tables: dict[str, Any] = tomllib.loads(text)
    behind = tables.pop("behind")
    rest = {"schema": 1, "campaign": {"title": name}, "acquisition": {"sample_interval_s": 0.005}, "sensors": {}}
    reader = VehicleReader(schema.CampaignFile.model_validate(rest | tables), f"{name}.toml")
    truth = Behind(
        stiffness={case: np.array(values, float) for case, values in behind["stiffness_N_per_m"].items()},
        damping=np.array(behind["damping_N_s_per_m"], float),
        tire_stiffness=np.array(behind["tire_stiffness_N_per_m"], float),
        tire_damping=np.array(behind["tire_damping_N_s_per_m"], float),
    )
    return ExampleVehicle(
        text[text.index("[vehicle]\n") : text.index("\n[behind]") + 1], reader.vehicle, reader.load_cases, truth
    )
