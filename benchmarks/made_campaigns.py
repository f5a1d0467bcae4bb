"""Campaigns that are made for the benchmark, by the package's own model as the truck: see tests/support."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: Length of a record, and the latest moment at which axle 1 reaches the bump [s].
RECORD_S, START_S = 60.0, 5.0


def three_axles(folder: Path) -> Path:
    """A three-axle truck: 6 runs at 200 Hz."""
    return _made(folder / "three-axles", "--vehicle", "rigid3")


def long_records(folder: Path) -> Path:
    """A truck with eight axles: 20 runs of 60 s at 1 kHz, 24 channels."""
    options = ["--vehicle", "veqmon2d", "--sample-interval-s", "0.001", "--repeats", "4", "--drops-per-axle", "2"]
    options += ["--speeds-km-h", "8", "12", "16", "20", "24", "--start-s", "1", str(START_S)]
    return _made(folder / "long", *options, "--record-s", str(RECORD_S))


def _made(place: Path, *options: str) -> Path:
    if not (place / "truth.toml").exists():
        shutil.rmtree(place, ignore_errors=True)
        command = [sys.executable, "-m", "tests.support.synthetic_campaign", "--output", str(place), *options]
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    return place
