"""Campaigns of the study: three that faults are put into, and many healthy ones that must not be accused."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from studies.faults.bases import ROOT

#: Bases of the faults; the three-axle truck is simulated.
BASES = ("data", "linear_truck", "rigid3")


def base(name: str, folder: Path, seed: int) -> Path:
    """Folder of a base campaign; the simulated truck is made below `folder` if it is not there."""
    if name == "data":
        return ROOT / "data"
    if name == "linear_truck":
        return ROOT / "examples" / name
    return _simulated(folder / f"{name}_{seed}", ["--vehicle", name, "--seed", str(seed)])


def healthy(number: int, folder: Path, seed: int, trucks: Sequence[str] = ()) -> Path:
    """Folder of one healthy campaign, made if it is not there: what it is follows from seed, number and trucks."""
    return _simulated(folder / f"healthy_{seed}_{number:03d}", healthy_options(number, seed, trucks))


def healthy_options(number: int, seed: int, trucks: Sequence[str] = ()) -> list[str]:
    """Vehicle, rates, bump, speeds and suspension of a healthy campaign, as options of the simulator.

    Vehicles are taken from `trucks` in turn; without any, most are three-axle trucks, others semitrailers.
    """
    rng = np.random.default_rng([seed, number, 7])

    def one(*values: str) -> str:
        return values[int(rng.integers(len(values)))]

    vehicle = "semitrailer5" if rng.random() < 0.12 else "rigid3"
    vehicle = trucks[number % len(trucks)] if trucks else vehicle
    speeds = one("9 16 24", "8 16", "12 20 30", "16 24", "6 10 14")
    return [
        *("--vehicle", vehicle, "--seed", str(1000 * seed + number)),
        *("--sample-interval-s", one("0.005", "0.005", "0.004", "0.0025", "0.002")),
        *("--bump-shape", one("cosine", "parabola", "table")),
        *("--bump-height-m", f"{rng.uniform(0.05, 0.09):.3f}", "--bump-length-m", f"{rng.uniform(0.5, 1.8):.2f}"),
        *("--speeds-km-h", *speeds.split(), "--repeats", one("1", "1", "2")),
        *("--suspension-law", one("", "friction", "asymmetric_damper"), "--element-spread", "0.2"),
        *("--parameter-spread", "0.15", "--unsprung-spread", "0.03", "--inertia-spread", "0.05"),
    ]


def _simulated(made: Path, options: list[str]) -> Path:
    if not (made / "truth.toml").exists():
        shutil.rmtree(made, ignore_errors=True)
        command = [sys.executable, "-m", "tests.support.synthetic_campaign", "--output", str(made)]
        subprocess.run([*command, *options], cwd=ROOT, check=True, capture_output=True)
    return made
