"""One case: a campaign, one or two faults in it, and what the command ends in."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from studies.coverage.shards import Record
from studies.faults.bases import BASES, ROOT, base
from studies.faults.bookkeeping import BOOKKEEPING, Fault
from studies.faults.campaign_copy import CampaignCopy, DoesNotApply
from studies.faults.measuring import MEASURING

SEED = 2026
LIMIT_S = 1200.0
FAULTS: dict[str, Fault] = {**BOOKKEEPING, **MEASURING}
_TWO_FAULTS = 0.2


def draw(number: int, seed: int = SEED) -> tuple[str, list[str], np.random.Generator]:
    """Base and names of the faults of a case; the first faults take turns."""
    rng = np.random.default_rng([seed, number])
    names = list(FAULTS)
    order = np.random.default_rng([seed, number // len(names), 1]).permutation(len(names))
    faults = [names[order[number % len(names)]]]
    if rng.random() < _TWO_FAULTS:
        faults.append(names[int(rng.integers(len(names)))])
    weights = np.array([weight for weight, _ in BASES.values()])
    return list(BASES)[int(rng.choice(weights.size, p=weights / weights.sum()))], faults, rng


def replicate(number: int, command: tuple[str, ...], bases: Path, seed: int = SEED) -> Record:
    """What `calibrate.py` with `command` says of one case: exit code, time, output, warnings."""
    name, faults, rng = draw(number, seed)
    with tempfile.TemporaryDirectory() as place:
        folder, output = Path(place) / "campaign", Path(place) / "output"
        shutil.copytree(base(name, bases), folder)
        done = [_made(fault, CampaignCopy(folder, rng)) for fault in faults]
        code, seconds, said = _ended(command, folder, output)
        broken = (output / "error.log").read_text(encoding="utf-8") if (output / "error.log").exists() else ""
        return {
            "number": number,
            "base": name,
            "faults": faults,
            "done": done,
            "code": code,
            "seconds": round(seconds, 1),
            "traceback": broken or ("Traceback" in said and said) or "",
            "said": said.replace(place, "")[-6000:],
            "warnings": _warnings(output / "result.json"),
            "errors": _errors(output / "result.json", folder / "truth.toml"),
        }


def _made(fault: str, copy: CampaignCopy) -> str:
    try:
        return FAULTS[fault](copy)
    except DoesNotApply as error:
        return f"{fault}: does not apply ({error})"


def _ended(command: tuple[str, ...], folder: Path, output: Path) -> tuple[int, float, str]:
    """Exit code (-1: not within the limit), seconds and everything said."""
    arguments = [sys.executable, "calibrate.py", command[0], str(folder), *command[1:], "--output", str(output)]
    began = time.monotonic()
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    run = partial(subprocess.run, arguments, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=LIMIT_S)
    try:
        done = run()
    except subprocess.TimeoutExpired:
        return -1, time.monotonic() - began, f"not done within {LIMIT_S:g} s"
    lines = [x for x in done.stderr.splitlines() if not x.rstrip().endswith("...")]
    return done.returncode, time.monotonic() - began, "\n".join([done.stdout, *lines])


def _warnings(path: Path) -> list[str]:
    return list(json.loads(path.read_text(encoding="utf-8")).get("warnings") or []) if path.exists() else []


def _errors(path: Path, truth: Path) -> dict[str, float]:
    """Relative error of the stiffnesses and dampings of a simulated vehicle."""
    import tomllib

    if not (path.exists() and truth.exists()):
        return {}
    true: dict[str, Any] = tomllib.loads(truth.read_text(encoding="utf-8")).get("parameters", {})
    found = json.loads(path.read_text(encoding="utf-8")).get("parameters") or []
    return {
        p["name"]: round(p["least_squares"]["value"] / true[p["name"]] - 1.0, 4)
        for p in found
        if p["quantity"] in ("stiffness", "damping") and p["name"] in true and p.get("least_squares")
    }
