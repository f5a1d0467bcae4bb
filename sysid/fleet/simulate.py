"""A fleet with known truth: trucks about a type, campaigns about their trucks, simulated by the product's own model.

The logs hold what the sensors of a planned campaign would show; masses err within their tolerances.  For planning (what
would so many trucks teach?), examples and tests; errors of the model are not in it.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid.campaign.read import read_campaign
from sysid.campaign.records import AUXILIARY_KINDS, BumpRun, Campaign
from sysid.campaign.toml.reading import parse_toml
from sysid.campaign.toml.text import quoted, toml_key, value_text
from sysid.errors import CampaignError
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.parameters.map_tires import map_tires
from sysid.estimation.parameters.parameter_set import ParameterSet
from sysid.estimation.uncertainty.uncertain_masses import uncertain_masses
from sysid.files import write_text
from sysid.fleet.folders import CAMPAIGN_FILE
from sysid.fleet.read import FLEET_FILE
from sysid.progress import Progress, unwatched
from sysid.road.point_cloud import read_point_cloud
from sysid.road.profile_files import bump_from_file
from sysid.road.road_profile import RoadProfile
from sysid.road.scan import analyse_scan
from sysid.runtime import configure
from sysid.selftest.readings import Instruments, ordinary_instruments, planned_campaign, simulated_campaign
from sysid.selftest.world import World
from sysid.vehicle_model.passes import EffectiveRoads

TRUTH_FILE = "fleet_truth.json"
#: Relative standard deviations between trucks of a type, and between campaigns of one truck (assumptions).
SPREAD: Mapping[str, float] = {"stiffness": 0.08, "damping": 0.12}
SCATTER: Mapping[str, float] = {"stiffness": 0.01, "damping": 0.02}


@dataclass(frozen=True)
class SimulatedFleet:
    """Where the fleet was written, and its true k and c: of the type, and by truck and parameter name."""

    file: Path
    mean: Mapping[str, float]
    trucks: Mapping[str, Mapping[str, float]]


def simulate_fleet(
    campaign: str | Path,
    folder: Path,
    *,
    trucks: int = 8,
    campaigns: int = 2,
    runs: int = 2,
    seed: int = 0,
    spread: Mapping[str, float] = SPREAD,
    scatter: Mapping[str, float] = SCATTER,
    broken: Mapping[str, Mapping[str, float]] | None = None,
    progress: Progress | None = None,
) -> SimulatedFleet:
    """Write campaigns of trucks of one type, and a ``fleet.toml``, into a folder.

    Parameters
    ----------
    campaign : planned or driven campaign whose vehicle, sensors and scans are taken, and `runs` of its bump runs, from
        the first to the last; the medians of its priors are the mean of the type.
    trucks, campaigns : how many, and how many campaigns of each.
    spread, scatter : relative standard deviations by quantity.
    broken : factors by truck and parameter, ``{"T3": {"c_2": 0.5}}``.

    Raises
    ------
    CampaignError
        If the campaign has fewer runs or logs other than one CSV file per run, or `broken` names a truck or parameter
        that there is not.
    """
    configure()
    report, broken = progress or unwatched, broken or {}
    file = Path(campaign) / CAMPAIGN_FILE if Path(campaign).is_dir() else Path(campaign)
    read = read_campaign(file, point_cloud_reader=read_point_cloud, profile_reader=bump_from_file, planned=True)
    if len(read.bump_runs) < runs:
        raise CampaignError(f"{file.name} has {len(read.bump_runs)} bump runs, {runs} are to be simulated.")
    _check_logs(file)
    profiles = {name: analyse_scan(scan).profile for name, scan in read.scans.items()}
    chosen = tuple(read.bump_runs[i] for i in np.linspace(0, len(read.bump_runs) - 1, runs).astype(int))
    planned = planned_campaign(replace(read, plank_drops=(), bump_runs=chosen), profiles)
    parameters = campaign_parameters(planned, None)
    names = [f"T{t + 1}" for t in range(trucks)]
    _check(broken, names, parameters)
    mean = np.log([p.prior_median for p in parameters.parameters])
    true: dict[str, dict[str, float]] = {}
    instruments = ordinary_instruments(planned)
    for t, name in enumerate(names):
        random = np.random.default_rng([seed, t])
        truck = mean + _offsets(parameters, spread, random) + np.log(_factors(parameters, broken.get(name, {})))
        true[name] = _named(parameters, truck)
        for c in range(campaigns):
            report(f"{name}, campaign {c + 1}", (t * campaigns + c) / (trucks * campaigns))
            random = np.random.default_rng([seed, t, c])
            values = truck + _offsets(parameters, scatter, random)
            readings = _driven(planned, parameters, values, profiles, instruments, random)
            _write(readings.bump_runs, file, folder / name / f"{c + 1}", f"{name}, campaign {c + 1}")
    fleet = _fleet_file(file, folder, names, campaigns)
    simulated = SimulatedFleet(fleet, _named(parameters, mean), true)
    write_text(folder / TRUTH_FILE, json.dumps({"seed": seed, "mean": simulated.mean, "trucks": true}, indent=1) + "\n")
    return simulated


def _check(broken: Mapping[str, Mapping[str, float]], names: list[str], parameters: ParameterSet) -> None:
    for truck, factors in broken.items():
        if truck not in names or not set(factors) <= set(parameters.names):
            raise CampaignError(
                f"'broken' names truck {truck} and {', '.join(factors)}, which are not all in the fleet."
            )


def _check_logs(file: Path) -> None:
    """Refuse a campaign whose logs are not one text table per run: no other is written."""
    entries = parse_toml(file.read_bytes(), file.name)["tests"]["bump_run"]
    if not all(str(entry.get("file", "")).lower().endswith((".csv", ".txt")) for entry in entries):
        raise CampaignError(
            f"{file.name} has runs of several files or of another format than CSV, which are not simulated; plan the "
            "fleet with one CSV file per run."
        )


def _offsets(parameters: ParameterSet, sd: Mapping[str, float], random: np.random.Generator) -> np.ndarray:
    """Offsets of the logarithms, one per axle and quantity: the load cases of an air spring stay together."""
    drawn: dict[tuple[str, int | None], float] = {}
    return np.array(
        [
            sd.get(p.quantity, 0.0) * drawn.setdefault((p.quantity, p.axle), float(random.standard_normal()))
            for p in parameters.parameters
        ]
    )


def _factors(parameters: ParameterSet, factors: Mapping[str, float]) -> np.ndarray:
    return np.array([factors.get(name, 1.0) for name in parameters.names])


def _named(parameters: ParameterSet, values: np.ndarray) -> dict[str, float]:
    chosen = [(p.name, v) for p, v in zip(parameters.parameters, values, strict=True) if p.quantity in SPREAD]
    return {name: float(np.exp(value)) for name, value in chosen}


def _driven(
    planned: Campaign,
    parameters: ParameterSet,
    values: np.ndarray,
    profiles: Mapping[str, RoadProfile],
    instruments: Instruments,
    random: np.random.Generator,
) -> Campaign:
    masses = uncertain_masses(planned)
    vehicle, load_cases = masses.applied(masses.sd * random.standard_normal(masses.sd.size))
    true = replace(planned, vehicle=vehicle, load_cases=load_cases)
    roads = EffectiveRoads(vehicle, load_cases, profiles, tires=map_tires(parameters, values))
    return simulated_campaign(planned, World(true, parameters, values, roads), profiles, instruments, random)


def _write(runs: tuple[BumpRun, ...], source: Path, folder: Path, title: str) -> None:
    """The campaign's folder: logs, scans as they are, and a campaign file of these runs."""
    tables = parse_toml(source.read_bytes(), source.name)
    tables["campaign"] = {**tables.get("campaign", {}), "title": f"Simulated: {title}", "synthetic": True}
    tests: dict[str, Any] = tables["tests"]
    tests.pop("plank_drop", None)
    files = [run.log.file for run in runs]
    speeds = {run.log.file: 3.6 * run.nominal_speed_m_s for run in runs}
    tests["bump_run"] = [
        {"nominal_speed_km_h": speeds[entry["file"]]} | entry for entry in tests["bump_run"] if entry["file"] in files
    ]
    for sensor in tables.get("sensors", {}).get("bump_run", {}).values():
        if sensor.get("kind") in AUXILIARY_KINDS:
            sensor.setdefault("unused", "not simulated")
    tables.get("sensors", {}).pop("plank_drop", None)
    lines = [
        f"{toml_key(k)} = {value_text(v)}" for k, v in sorted(tables.items(), key=lambda item: item[0] != "schema")
    ]
    write_text(folder / source.name, "\n".join(lines) + "\n")
    for name in _scan_files(tables):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source.parent / name, folder / name)
    for run in runs:
        write_text(folder / run.log.file, _log_text(run))


def _scan_files(tables: Mapping[str, Any]) -> list[str]:
    scan = tables.get("scan", {})
    tables_of_scans = [scan] if "file" in scan else [s for s in scan.values() if isinstance(s, dict)]
    return [s["file"] for s in tables_of_scans if "file" in s]


def _log_text(run: BumpRun) -> str:
    channels = run.log.channels
    head = ",".join(["time_s", *(c.sensor.column for c in channels)])
    factors = [c.sensor.unit_in_si * c.sensor.scale * c.sensor.sign for c in channels]
    rows = np.column_stack([channels[0].time_s, *(c.value / f for c, f in zip(channels, factors, strict=True))])
    return "\n".join([head, *(",".join(f"{v:.6g}" for v in row) for row in rows)]) + "\n"


def _fleet_file(source: Path, folder: Path, names: list[str], campaigns: int) -> Path:
    kind = parse_toml(source.read_bytes(), source.name)["vehicle"].get("name", "truck")
    lines = ["# Simulated fleet with known truth: for planning and tests, no truck was driven.", "schema = 1", ""]
    lines += ["[fleet]", 'title = "Simulated fleet"']
    for name in names:
        lines += ["", "[[truck]]", f"name = {quoted(name)}", f"type = {quoted(kind)}", "campaign = ["]
        lines += [f"  {{ folder = {quoted(f'{name}/{c + 1}')} }}," for c in range(campaigns)]
        lines.append("]")
    write_text(folder / FLEET_FILE, "\n".join(lines) + "\n")
    return folder / FLEET_FILE
