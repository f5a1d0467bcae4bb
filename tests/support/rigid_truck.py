"""The rigid truck of `tests/data/vehicles` with exact masses, a bump, and campaigns made with the model itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from vehicles import example_vehicle

from sysid.campaign.records import (
    Acquisition,
    AntiAliasFilter,
    BumpRun,
    Campaign,
    Channel,
    Log,
    PredictionRequest,
    Sensor,
)
from sysid.campaign.vehicle_records import EXACT_MASSES, LoadCase, Vehicle
from sysid.road.road_profile import RoadProfile

_EXAMPLE = example_vehicle("rigid3")
VEHICLE = replace(_EXAMPLE.vehicle, tolerances=EXACT_MASSES)
AXLES = VEHICLE.axles
EMPTY, LADEN = _EXAMPLE.load_cases["empty"], _EXAMPLE.load_cases["laden"]
FILTER = AntiAliasFilter("butterworth", 4, 60.0)

#: Suspensions behind every synthetic run.
STIFFNESS = np.array([4.3e5, 3.9e5, 3.5e5])
DAMPING = np.array([1.05e4, 1.2e4, 0.9e4])
EXPONENT = 1.25

SENSORS = (
    *(Sensor(f"axle{i + 1}_lvdt", "suspension_deflection", "mm", axle=i) for i in range(3)),
    *(Sensor(f"axle{i + 1}_accel", "axle_acceleration", "g", axle=i) for i in range(3)),
    *(Sensor(f"frame{i + 1}_accel", "body_acceleration", "g", body=0, x_m=x) for i, x in enumerate((0.0, 5.0))),
)


def bump(height_m: float = 0.06, length_m: float = 0.7, name: str = "bump") -> RoadProfile:
    """A raised-cosine bump with flat road before and behind."""
    s = np.round(np.arange(0.0, length_m + 0.4001, 0.005), 6)
    inside = (s > 0.2) & (s < 0.2 + length_m)
    z = np.where(inside, 0.5 * height_m * (1 - np.cos(2 * np.pi * (s - 0.2) / length_m)), 0.0)
    above = np.flatnonzero(z > 1e-3)
    return RoadProfile(name, s, z, 0.0 * z, float(s[above[0]]), float(s[above[-1]] - s[above[0]]))


def empty_run(
    file: str,
    speed_m_s: float,
    *,
    load_case: str = "empty",
    samples: int = 300,
    interval_s: float = 0.005,
    sensors: Sequence[Sensor] = SENSORS,
) -> BumpRun:
    """A run whose channels hold zeros, to be filled by :func:`filled`."""
    time = np.arange(samples) * interval_s
    channels = tuple(Channel(s, time, np.zeros(samples), np.zeros(samples, np.int8)) for s in sensors)
    return BumpRun(file, load_case, speed_m_s, 1, Log(file, interval_s, channels))


def campaign(
    runs: Sequence[BumpRun],
    *,
    load_cases: Sequence[LoadCase] = (EMPTY,),
    vehicle: Vehicle = VEHICLE,
    antialias: AntiAliasFilter | None = FILTER,
    predictions: Sequence[PredictionRequest] = (),
) -> Campaign:
    """A campaign of bump runs."""
    return Campaign(
        title="synthetic truck",
        notes="",
        folder=Path(),
        file=Path("campaign.toml"),
        vehicle=vehicle,
        load_cases={c.name: c for c in load_cases},
        acquisition=Acquisition(runs[0].log.sample_interval_s if runs else 0.005, antialias),
        plank_drops=(),
        bump_runs=tuple(runs),
        scans={},
        predictions=tuple(predictions),
        input_sha256={},
    )


def with_values(run: BumpRun, values: np.ndarray) -> BumpRun:
    """The run with other readings, `values` (samples, channels)."""
    channels = tuple(replace(c, value=values[:, k]) for k, c in enumerate(run.log.channels))
    return replace(run, log=replace(run.log, channels=channels))


def true_log_parameters(names: Sequence[str]) -> np.ndarray:
    """Log parameters behind the synthetic runs, in the order of the names."""
    truth = {"tire_exponent": EXPONENT}
    for i, axle in enumerate(AXLES):
        truth |= {
            f"c_{i + 1}": DAMPING[i],
            f"kt_{i + 1}": axle.tire_stiffness_N_per_m,
            f"ct_{i + 1}": axle.tire_damping_N_s_per_m,
        }
    return np.log([truth[n] if n in truth else STIFFNESS[int(n[2]) - 1] for n in names])
