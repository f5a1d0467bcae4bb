"""A small campaign of a two-axle truck, written into a temporary folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

CAMPAIGN = """\
schema = 1

[campaign]
title = "small"

[vehicle]
name = "truck"

[[vehicle.body]]
name = "frame"

[[vehicle.axle]]
name = "front"
body = "frame"
x_m = 0
unsprung_mass_kg = 500
tire_stiffness_N_per_m = 1600000
tire_damping_N_s_per_m = 3000
tire_radius_m = 0.5
suspension = "leaf"

[[vehicle.axle]]
name = "rear"
body = "frame"
x_m = 4.0
unsprung_mass_kg = 1000
tire_stiffness_N_per_m = 2900000
tire_damping_N_s_per_m = 3000
tire_radius_m = 0.5
suspension = "air"

[load_case.empty]
axle_loads_kg = [4000, 3500]
sprung_mass_kg = [6000]
pitch_inertia_kg_m2 = [15000]
cg_height_m = [1.0]

[acquisition]
sample_interval_s = 0.01

[sensors.bump_run]
q1_mm = { kind = "suspension_deflection", axle = "front", unit = "mm", range = 150 }
a1_g = { kind = "axle_acceleration", axle = "front", unit = "g", range = 10 }

[scan]
file = "scan.csv"
heading_deg = 90

[tests]
bump_run = [
  { case = "one", file = "run.csv", load_case = "empty", nominal_speed_km_h = 36 },
]
"""

LOG = "time_s,q1_mm,a1_g\n" + "".join(f"{0.01 * i:.3f},{i % 7:.2f},{0.1 * (i % 5):.3f}\n" for i in range(50))


@pytest.fixture
def small(tmp_path: Path) -> Callable[..., Path]:
    """Function that writes the small campaign, with replacements in its TOML and another log, and returns its file."""

    def write(*changes: tuple[str, str], log: str | bytes | None = LOG, toml: str | bytes = CAMPAIGN) -> Path:
        if isinstance(toml, str):
            for old, new in changes:
                assert old in toml, f"nothing to replace: {old}"
                toml = toml.replace(old, new)
            toml = toml.encode()
        (tmp_path / "campaign.toml").write_bytes(toml)
        (tmp_path / "scan.csv").write_text("x_m,y_m,z_m\n0,0,0\n")
        if log is not None:
            (tmp_path / "run.csv").write_bytes(log if isinstance(log, bytes) else log.encode())
        return tmp_path / "campaign.toml"

    return write


@pytest.fixture(scope="session")
def small_text() -> str:
    """Text of the small campaign file."""
    return CAMPAIGN


@pytest.fixture(scope="session")
def linear_truck_folder() -> Path:
    """Folder of the linear truck."""
    return Path(__file__).parents[2] / "examples" / "linear_truck"
