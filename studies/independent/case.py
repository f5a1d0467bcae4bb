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
#: Three-axle trucks that come before each lowboy: one of those takes about as long as two of these.
THREE_AXLE_TRUCKS = 4
#: Trucks of each kind in a whole table.
EACH = 5
#: Kinds of trucks, each with the physics of `tests/support/independent_physics.py` that it takes in turn.
KINDS = {
    "linear": ("linear",),
    "friction": ("2 % friction", "7 % friction", "10 % friction"),
    "air springs and dampers": ("saturating dampers", "asymmetric dampers", "progressive air springs"),
    "worn": ("worn",),
    "rockers": ("full rocker", "half a rocker that rubs"),
    "short travels": ("short travels",),
    "frames that bend": ("frame bends at 7 Hz", "frame bends at 12 Hz", "bends and rubs"),
    "axle loads 1 % off": ("axle loads 1 % off",),
    "speed falls by 5 %": ("speed falls by 5 %",),
    "rough road": ("rough road",),
    "other tires": ("flat tire law", "steep tire law"),
    "outliers": ("2 % outliers",),
}
#: Quantities of parameters by the part of a suspension law that they belong to.
LAWS = {
    "friction": "friction",
    "damper_asymmetry": "damper",
    "damper_knee": "damper",
    "progressivity": "gas spring",
    "stop_stiffness": "stops",
}


def draw(number: int) -> tuple[str, str]:
    """Vehicle and physics of a case: all kinds come equally often, and so do the physics of a kind."""
    turn, place = divmod(number, THREE_AXLE_TRUCKS + 1)
    if place == THREE_AXLE_TRUCKS:
        # Begun elsewhere than the three-axle trucks, so that few cases hold many kinds and physics.
        return "lowboy", _physics(7 * turn + 7, turn // len(KINDS) + 1)
    count = turn * THREE_AXLE_TRUCKS + place
    return "three axles", _physics(count, count // len(KINDS))


def scale_error(number: int, seed: int) -> float:
    """Common error of a case's scale, in its standard deviations: the trucks of a kind cover all equally likely parts.

    Most of the error of k and c is this one, so that a campaign mostly holds all of its values or hardly any.  A few
    random errors would decide the row of a kind.  One from each of :data:`EACH` parts of the same probability, in
    random order (M. D. McKay, R. J. Beckman, W. J. Conover, Technometrics 21, 1979,
    doi:10.1080/00401706.1979.10489755), leave the mean share of intervals that hold as it is, and reduce its scatter.
    """
    table, place = divmod(number, EACH * len(KINDS))
    kind = kind_of(draw(number)[1])
    before = range(number - place, number)
    turn = sum(kind_of(draw(n)[1]) == kind for n in before)
    rng = np.random.default_rng([seed, table, list(KINDS).index(kind)])
    parts, within = rng.permutation(EACH), rng.uniform(size=EACH)
    return float(norm.ppf((parts[turn] + within[turn]) / EACH))


def _physics(kind: int, turn: int) -> str:
    every = KINDS[list(KINDS)[kind % len(KINDS)]]
    return every[turn % len(every)]


def kind_of(physics: str) -> str:
    """The kind of trucks that has this physics."""
    return next(kind for kind, every in KINDS.items() if physics in every)


def replicate(number: int, seed: int = SEED) -> Record:
    """Intervals of k, c and peak load ratios of one campaign beside their truth, and what the first screen says."""
    vehicle, kind = draw(number)
    with tempfile.TemporaryDirectory() as place:
        folder, output = Path(place) / "campaign", Path(place) / "output"
        simulate = [sys.executable, "-m", "tests.support.independent_physics", "--vehicle", vehicle, "--physics", kind]
        simulate += ["--seed", str(1000 * seed + number), f"--scale-error={scale_error(number, seed)!r}"]
        simulate += ["--output", str(folder)]
        subprocess.run(simulate, cwd=ROOT, check=True, capture_output=True)
        code, seconds, said = _run(folder, output)
        record = {"number": number, "vehicle": vehicle, "physics": kind, "code": code, "seconds": round(seconds, 1)}
        truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
        if code != 0:
            return {**record, "linear": truth["linear"], "failed": said[-2000:], "entries": []}
        result = json.loads((output / "result.json").read_text(encoding="utf-8"))
        normal = _normal_peaks(folder, output)
    return {
        **record,
        "linear": truth["linear"],
        "failed": None,
        "trust": result["verdict"]["trust"],
        "reasons": result["verdict"]["reasons"],
        "laws": sorted({LAWS[p["quantity"]] for p in result["parameters"] if p["quantity"] in LAWS}),
        "parts": len(result["rockers"]) + sum(p["quantity"] == "bending_frequency" for p in result["parameters"]),
        "entries": _parameters(result, truth) + _peaks(result, truth, normal),
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


def _normal_peaks(folder: Path, output: Path) -> list[list[list[float]]]:
    command = [sys.executable, "-m", "studies.independent.normal_peaks", str(folder), str(output)]
    done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    quantiles: list[list[list[float]]] = json.loads(done.stdout)
    return quantiles


def _peaks(result: dict[str, Any], truth: dict[str, Any], normal: list[list[list[float]]]) -> list[Record]:
    order = list(dict.fromkeys((p["load_case"], p["speed_km_h"]) for p in result["predictions"]))
    entries = []
    for p in result["predictions"]:
        number, axle = order.index((p["load_case"], p["speed_km_h"])), p["axle"] - 1
        entry = _entry("peak", truth["peaks"][number][axle], p["peak_dynamic_load_ratio"])
        entries.append({**entry, "normal": normal[number][axle]})
    return entries


def _entry(kind: str, true: float, interval: dict[str, float]) -> Record:
    return {"kind": kind, "truth": true, "reported": [interval["q05"], interval["q50"], interval["q95"]]}
