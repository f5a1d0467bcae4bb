"""The vehicle, load cases and histories of the verification passes under `tests/data/verification`."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sysid.campaign.vehicle_records import Axle, Body, LoadCase, Vehicle

DATA = Path(__file__).resolve().parents[1] / "data" / "verification"
CASE = tomllib.loads((DATA / "case.toml").read_text(encoding="utf-8"))
WHEEL_HEIGHT_M = 0.5


def vehicle_and_loads(heights: bool) -> tuple[Vehicle, dict[str, LoadCase]]:
    """The six-axle vehicle, all centres of gravity and the hinge at wheel height unless `heights`."""
    table = CASE["vehicle"]
    bodies = (Body("tractor"), Body("trailer", table["body"][1]["hitch_x_m"], 1.20 if heights else WHEEL_HEIGHT_M))
    axles = tuple(
        Axle(
            name=a["name"],
            body=[b.name for b in bodies].index(a["body"]),
            x_m=float(a["x_m"]),
            unsprung_mass_kg=float(a["unsprung_mass_kg"]),
            tire_stiffness_N_per_m=float(a["tire_stiffness_N_per_m"]),
            tire_damping_N_s_per_m=float(a["tire_damping_N_s_per_m"]),
            tire_radius_m=WHEEL_HEIGHT_M,
            suspension=a["suspension"],
        )
        for a in table["axle"]
    )
    trailer_cg = {"unloaded": 1.10, "loaded": 1.58}
    loads = {
        name: LoadCase(
            name,
            tuple(map(float, c["axle_loads_kg"])),
            tuple(map(float, c["sprung_mass_kg"])),
            tuple(map(float, c["pitch_inertia_kg_m2"])),
            (1.05, trailer_cg[name]) if heights else (WHEEL_HEIGHT_M, WHEEL_HEIGHT_M),
        )
        for name, c in CASE["load_case"].items()
    }
    return Vehicle(table["name"], bodies, axles, table["gravity_m_s2"]), loads


def per_axle(key: str) -> np.ndarray:
    """One number of every axle, (axles,)."""
    return np.array([a[key] for a in CASE["vehicle"]["axle"]], float)


@dataclass(frozen=True)
class VerificationPass:
    """One recorded pass: `values` (n, columns) every 2 ms."""

    name: str
    heights: bool
    profile: str
    load_case: str
    speed_m_s: float
    columns: tuple[str, ...]
    values: np.ndarray

    def channels(self, quantity: str) -> np.ndarray:
        """The six histories of one quantity, (n, 6)."""
        picked = [next(c for c in self.columns if c.startswith(f"{quantity}{i}_")) for i in range(1, 7)]
        return self.values[:, [self.columns.index(c) for c in picked]].astype(float)


def passes() -> list[VerificationPass]:
    """All recorded passes, those with real heights last."""
    found = []
    for heights, folder in ((False, "histories"), (True, "histories_with_heights")):
        for entry in CASE["pass"]:
            path = DATA / folder / (Path(entry["file"]).stem + ".npz")
            if not path.exists():
                continue
            with np.load(path, allow_pickle=False) as data:
                columns, values = tuple(str(c) for c in data["columns"]), data["values"]
            found.append(
                VerificationPass(
                    path.stem,
                    heights,
                    entry["profile"],
                    entry["load_case"],
                    float(entry["speed_m_s"]),
                    columns,
                    values,
                )
            )
    return found


def profile(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Stations and heights [m] of one of the profiles."""
    table = np.loadtxt(DATA / name, delimiter=",", skiprows=1)
    return table[:, 0], table[:, 1]
