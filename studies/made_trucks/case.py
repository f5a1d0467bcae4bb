"""One campaign of a made truck through `calibrate.py run`: what is true beside what was found."""

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

from studies.coverage.shards import Record
from studies.made_trucks.draw import Campaign, ordinary
from studies.made_trucks.kinds import OPEN
from studies.made_trucks.measure import make
from studies.made_trucks.withheld import WITHHELD

EACH = 5
GROUPS = {"open": OPEN, "withheld": WITHHELD}
SEED = 60417
LIMIT_S = 3600.0
_ROOT = Path(__file__).resolve().parents[2]
_HALF = 1.6448536269514722  # half-width of a 90 % interval in standard deviations


def draw(group: str, number: int) -> tuple[str, str, Campaign, np.random.Generator]:
    """Kind, vehicle, campaign and generator of a number: of every five, the last is a tractor with a lowboy."""
    kinds = GROUPS[group]
    kind = list(kinds)[number // EACH % len(kinds)]
    lowboy = number % EACH == EACH - 1
    rng = np.random.default_rng([SEED, list(GROUPS).index(group), number])
    campaign = kinds[kind](ordinary(rng, lowboy), rng)
    return kind, "lowboy" if lowboy else "three axles", campaign, rng


def replicate(number: int, group: str, keep: Path | None = None) -> Record:
    """Make and calibrate a campaign; in `keep`, folder and results stay."""
    kind, vehicle, campaign, rng = draw(group, number)
    with tempfile.TemporaryDirectory() as place:
        folder, output = Path(place) / "campaign", Path(place) / "output"
        if keep is not None:
            folder, output = (keep / f"{group}_{number:04d}" / name for name in ("campaign", "output"))
        make(campaign, folder, rng)
        code, seconds, processor_s, said = _run(folder, output)
        truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
        found = output / "result.json"
        result = json.loads(found.read_text(encoding="utf-8")) if code in (0, 4) and found.exists() else None
    record = {
        "number": number,
        "group": group,
        "kind": kind,
        "vehicle": vehicle,
        "linear": not np.any(campaign.truck.friction_share) and kind == "ordinary",
        "code": code,
        "seconds": round(seconds, 1),
        "processor_s": round(processor_s, 1),
        "said": said[-1500:] if code else "",
        "verdict": None if result is None else {k: result["verdict"][k] for k in ("trust", "kinds", "reasons")},
        "status": None if result is None else result["status"],
        "entries": [] if result is None else entries(result, truth),
    }
    return record


def _run(folder: Path, output: Path) -> tuple[int, float, float, str]:
    command = [sys.executable, "calibrate.py", "run", str(folder), "--output", str(output)]
    start, before = time.monotonic(), os.times()
    try:
        done = subprocess.run(command, cwd=_ROOT, capture_output=True, text=True, timeout=LIMIT_S)
        code, said = done.returncode, done.stderr
    except subprocess.TimeoutExpired:
        code, said = -1, f"not done within {LIMIT_S:.0f} s"
    after = os.times()
    used = after.children_user + after.children_system - before.children_user - before.children_system
    return code, time.monotonic() - start, used, said


def entries(result: dict[str, Any], truth: dict[str, Any]) -> list[Record]:
    """Quantity, axle, load case, true value and 90 % interval of everything that has a true value.

    k of a parameter without load case is that of the first one, as k and kt are defined at rest there.
    """
    found = []
    names = {"stiffness": "k", "damping": "c", "tire_stiffness": "kt", "tire_damping": "ct", "friction": "friction"}
    first = next(iter(truth["stiffness"]))
    for p in result["parameters"]:
        if p["quantity"] not in names or p["axle"] is None:
            continue
        case = p["load_case"]
        if p["quantity"] != "stiffness" and case not in (None, first):
            continue
        true = truth[p["quantity"]]
        true = (true[case or first] if p["quantity"] == "stiffness" else true)[p["axle"] - 1]
        posterior = p["posterior"]
        if posterior is None:
            value, half = p["least_squares"]["value"], _HALF * p["least_squares"]["sd"]
            posterior = {"q05": value - half, "q50": value, "q95": value + half}
        found.append(_entry(names[p["quantity"]], p["axle"], case, true, posterior))
    passes = list(dict.fromkeys((p["load_case"], p["speed_km_h"]) for p in result["predictions"]))
    for p in result["predictions"]:
        true = truth["peaks"][passes.index((p["load_case"], p["speed_km_h"]))][p["axle"] - 1]
        found.append(_entry("peak", p["axle"], p["load_case"], true, p["peak_dynamic_load_ratio"]))
    for d in result["drops"]:
        if d["file"] is not None or not d["usable"]:
            continue
        for name, value, sd, true in (
            ("drop k", d["stiffness"], d["stiffness_sd"], truth["stiffness"][first]),
            ("drop c", d["damping"], d["damping_sd"], truth["damping"]),
        ):
            if value is not None and sd is not None:
                interval = {"q05": value - _HALF * sd, "q50": value, "q95": value + _HALF * sd}
                found.append(_entry(name, d["axle"], d["method"], true[d["axle"] - 1], interval))
    return found


def _entry(quantity: str, axle: int, case: str | None, true: float, interval: dict[str, float]) -> Record:
    return {
        "quantity": quantity,
        "axle": axle,
        "case": case,
        "true": true,
        "interval": [interval[q] for q in ("q05", "q50", "q95")],
    }
