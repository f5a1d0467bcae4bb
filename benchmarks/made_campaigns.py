"""Campaigns that are made for the benchmark, by the package's own model as the truck: see tests/support."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
#: What the simulation goes on for behind the last axle so that a record lasts a minute [s], and the latest start.
RECORD_S, START_S = 60.0, 5.0
NOISE_G = 0.015


def three_axles(folder: Path) -> Path:
    """A three-axle truck: 6 runs at 200 Hz."""
    return _made(folder / "three-axles", "--vehicle", "rigid3")


def long_records(folder: Path) -> Path:
    """A truck with six axles: 20 runs of 60 s at 1 kHz, and a second accelerometer above every axle: 24 channels."""
    place = folder / "long"
    options = ["--vehicle", "veqmon2d", "--sample-interval-s", "0.001", "--repeats", "4", "--drops-per-axle", "2"]
    options += ["--speeds-km-h", "8", "12", "16", "20", "24", "--start-s", "1", str(START_S)]
    if not (place / "truth.toml").exists() or "second1_accel_g" not in (place / "campaign.toml").read_text("utf-8"):
        _made(place, *options, "--record-s", str(RECORD_S))
        _second_accelerometers(place)
    return place


def _made(place: Path, *options: str) -> Path:
    if not (place / "truth.toml").exists():
        shutil.rmtree(place, ignore_errors=True)
        command = [sys.executable, "-m", "tests.support.synthetic_campaign", "--output", str(place), *options]
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    return place


def _second_accelerometers(place: Path) -> None:
    """Columns beside those of the frame, with noise of their own."""
    random = np.random.default_rng(11)
    for log in sorted((place / "bump_runs").glob("*.csv")):
        first, *rows = log.read_text(encoding="utf-8").splitlines()
        names = first.split(",")
        frame = [k for k, name in enumerate(names) if name.startswith("frame")]
        values = np.array([[float(row.split(",")[k]) for k in frame] for row in rows])
        values += NOISE_G * random.standard_normal(values.shape)
        more = [",".join(f"{v:.3f}" for v in row) for row in values]
        head = ",".join([*names, *(f"second{k + 1}_accel_g" for k in range(len(frame)))])
        log.write_text("\n".join([head, *(f"{a},{b}" for a, b in zip(rows, more, strict=True))]) + "\n", "utf-8")
    file = place / "campaign.toml"
    text = file.read_text(encoding="utf-8")
    sensors = re.findall(r"^frame(\d+)_accel_g( *= *\{.*\})$", text, flags=re.MULTILINE)
    last = list(re.finditer(r"^frame\d+_accel_g *= *\{.*\}$", text, flags=re.MULTILINE))[-1].end()
    lines = "".join(f"\nsecond{number}_accel_g{rest}" for number, rest in sensors)
    file.write_text(text[:last] + lines + text[last:], encoding="utf-8")
