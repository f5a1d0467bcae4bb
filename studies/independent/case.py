"""One campaign: a truck by independent equations, `calibrate.py run` with its default options, and what held."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm

from studies.coverage.shards import Record

ROOT = Path(__file__).resolve().parents[2]
SEED = 20261125
LIMIT_S = 3600.0
#: Three-axle trucks that come before each lowboy: one of those takes about as long as three of these.
THREE_AXLE_TRUCKS = 3
#: Kinds of `tests/support/independent_physics.py`, in turn for each vehicle.
KINDS = (
    "linear",
    "2 % friction",
    "7 % friction",
    "10 % friction",
    "saturating dampers",
    "asymmetric dampers",
    "progressive air springs",
    "worn",
    "full rocker",
    "half a rocker that rubs",
    "short travels",
    "frame bends at 7 Hz",
    "frame bends at 12 Hz",
    "bends and rubs",
    "axle loads 1 % off",
    "speed falls by 5 %",
    "rough road",
    "flat tire law",
    "steep tire law",
    "2 % outliers",
)
#: Quantities of parameters by the part of a suspension law that they belong to.
LAWS = {
    "friction": "friction",
    "damper_asymmetry": "damper",
    "damper_knee": "damper",
    "progressivity": "gas spring",
    "stop_stiffness": "stops",
}


def draw(number: int) -> tuple[str, str]:
    """Vehicle and physics of a case."""
    turn, place = divmod(number, THREE_AXLE_TRUCKS + 1)
    if place == THREE_AXLE_TRUCKS:
        # Begun elsewhere than the three-axle trucks, so that few cases hold many kinds.
        return "lowboy", KINDS[(7 * turn + 7) % len(KINDS)]
    return "three axles", KINDS[(turn * THREE_AXLE_TRUCKS + place) % len(KINDS)]


def replicate(number: int, seed: int = SEED) -> Record:
    """Intervals of k, c and peak load ratios of one campaign beside their truth, and what the first screen says."""
    vehicle, kind = draw(number)
    with tempfile.TemporaryDirectory() as place:
        folder, output = Path(place) / "campaign", Path(place) / "output"
        simulate = [sys.executable, "-m", "tests.support.independent_physics", "--vehicle", vehicle, "--physics", kind]
        simulate += ["--seed", str(1000 * seed + number), "--output", str(folder)]
        subprocess.run(simulate, cwd=ROOT, check=True, capture_output=True)
        code, seconds, said = _run(folder, output)
        record = {"number": number, "vehicle": vehicle, "physics": kind, "code": code, "seconds": round(seconds, 1)}
        truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
        if code != 0:
            return {**record, "linear": truth["linear"], "failed": said[-2000:], "entries": []}
        result = json.loads((output / "result.json").read_text(encoding="utf-8"))
    return {
        **record,
        "linear": truth["linear"],
        "failed": None,
        "trust": result["verdict"]["trust"],
        "reasons": result["verdict"]["reasons"],
        "laws": sorted({LAWS[p["quantity"]] for p in result["parameters"] if p["quantity"] in LAWS}),
        "parts": len(result["rockers"]) + sum(p["quantity"] == "bending_frequency" for p in result["parameters"]),
        "entries": _parameters(result, truth) + _peaks(result, truth),
    }


def _run(folder: Path, output: Path) -> tuple[int, float, str]:
    command = [sys.executable, "calibrate.py", "run", str(folder), "--output", str(output)]
    start = time.monotonic()
    try:
        done = subprocess.run(
            command, cwd=ROOT, capture_output=True, text=True, timeout=LIMIT_S, env={**os.environ, "COLUMNS": "200"}
        )
    except subprocess.TimeoutExpired:
        return -1, LIMIT_S, f"not done within {LIMIT_S:.0f} s"
    # Progress comes first, so that what a record keeps of it ends with the status.
    return done.returncode, time.monotonic() - start, done.stderr + done.stdout


def _parameters(result: dict[str, Any], truth: dict[str, Any]) -> list[Record]:
    entries = []
    for p in result["parameters"]:
        if p["quantity"] not in ("stiffness", "damping"):
            continue
        if p["quantity"] == "stiffness":
            case = p["load_case"] or next(iter(truth["stiffness"]))
            true = truth["stiffness"][case][p["axle"] - 1]
        else:
            true = truth["damping"][p["axle"] - 1]
        normal = _normal(**p["least_squares"])
        entries.append({**_entry(p["quantity"], true, p["posterior"]), "normal": normal})
    return entries


def _normal(value: float, sd: float) -> list[float]:
    """5, 50 and 95 % of the lognormal with the optimum as median and its standard deviation."""
    return [float(value * np.exp(z * sd / value)) for z in norm.ppf([0.05, 0.5, 0.95])]


def _peaks(result: dict[str, Any], truth: dict[str, Any]) -> list[Record]:
    order = list(dict.fromkeys((p["load_case"], p["speed_km_h"]) for p in result["predictions"]))
    return [
        _entry(
            "peak",
            truth["peaks"][order.index((p["load_case"], p["speed_km_h"]))][p["axle"] - 1],
            p["peak_dynamic_load_ratio"],
        )
        for p in result["predictions"]
    ]


def _entry(kind: str, true: float, interval: dict[str, float]) -> Record:
    return {"kind": kind, "truth": true, "reported": [interval["q05"], interval["q50"], interval["q95"]]}
