"""Files of `calibrate.py predict --bridge` as the examples beside it read them: standard library alone."""

from __future__ import annotations

import csv
import tomllib
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Bridge:
    """Spans [m], EI of each [N m2], mass per metre of each [kg/m], damping ratio of all modes, supports by name."""

    spans_m: list[float]
    stiffness_N_m2: list[float]
    mass_kg_m: list[float]
    damping_ratio: float
    supports: list[str]

    @property
    def middles_m(self) -> list[float]:
        """Stations of the middles of the spans."""
        return [sum(self.spans_m[:i]) + 0.5 * span for i, span in enumerate(self.spans_m)]


def read_bridge(path: str | Path) -> Bridge:
    """The bridge of a TOML file with spans."""
    keys = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    spans = keys["spans_m"]

    def of_every_span(value: float | list[float]) -> list[float]:
        return value if isinstance(value, list) else [value] * len(spans)

    return Bridge(
        spans,
        of_every_span(keys["bending_stiffness_N_m2"]),
        of_every_span(keys["mass_kg_m"]),
        keys["damping_ratio"],
        keys.get("supports") or ["pinned"] * (len(spans) + 1),
    )


def read_axles(path: str | Path) -> tuple[list[float], list[float]]:
    """Distances behind axle 1 [m] and static loads [N] of `models/CASE/vehicle.csv`."""
    with Path(path).open(encoding="utf-8", newline="") as file:
        axles = [row for row in csv.DictReader(file) if row["kind"] == "axle"]
    return [float(a["x_m"]) for a in axles], [float(a["static_load_N"]) for a in axles]


def read_forces(path: str | Path) -> tuple[list[float], list[list[float]], list[list[float]]]:
    """Times [s], and per time station of every axle from the first support [m] and its load [N], medians.

    Of `moving_forces/NAME.csv`.
    """
    with Path(path).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    axles = range(1, 1 + sum(name.startswith("station") for name in rows[0]))
    times = [float(row["time_s"]) for row in rows]
    stations = [[float(row[f"station{i}_m"]) for i in axles] for row in rows]
    return times, stations, [[float(row[f"force{i}_N_q50"]) for i in axles] for row in rows]
