"""What a fault that passes `check` does to k and c: the three-axle campaign fitted with it and without."""

from __future__ import annotations

import contextlib
import csv
import io
import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from studies.check_faults.campaigns import base
from studies.check_faults.case import FAMILIES, FAULTS, SYMMETRIC, without_telling_names
from studies.check_faults.made import Copy
from studies.faults.campaign_copy import DoesNotApply
from sysid.campaign import read_campaign
from sysid.errors import SysidError

#: The campaign on which effects are measured, fitted in a few seconds, and what may be changed at most.
BASE = "rigid3"
HARMLESS_K, HARMLESS_C = 0.02, 0.05


def passed(records: Sequence[dict[str, Any]]) -> list[int]:
    """Numbers of the faults (places in FAULTS) of which `check` did not say the right thing on one base or another."""
    names = {(r["family"], r["fault"]) for r in records if r["ending"] in ("silent", "other")}
    return [k for k, pair in enumerate(FAULTS) if pair in names]


def fitted(folder: Path) -> dict[str, float] | None:
    """k and c by name from `calibrate.py fit --quick`, None where it refuses."""
    from sysid.cli.main import cli

    with tempfile.TemporaryDirectory() as output:
        silence = io.StringIO()
        with contextlib.redirect_stdout(silence), contextlib.redirect_stderr(silence):
            try:
                cli(["fit", str(folder), "--quick", "--laws", "declared", "--output", output], standalone_mode=False)
            except SystemExit as ending:
                if int(ending.code or 0) not in (0, 4):
                    return None
        table = Path(output) / "parameters.csv"
        if not table.exists():
            return None
        with table.open(encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    return {
        r["name"]: float(r["least_squares_value"])
        for r in rows
        if r["quantity"] in ("stiffness", "damping") and r["least_squares_value"]
    }


def effect(which: int, folder: Path, seed: int, right: Callable[[Path], dict[str, float] | None]) -> dict[str, Any]:
    """Largest relative changes of k and c by one fault in the three-axle campaign.

    Parameters
    ----------
    which
        Place of the fault in FAULTS.
    right
        k and c of the campaign without a fault, by its folder.
    """
    family, fault = FAULTS[which]
    source = base(BASE, folder, seed)
    if not fault.endswith("named files"):
        source = without_telling_names(source, folder / "effects" / BASE)
    record: dict[str, Any] = {"family": family, "fault": fault}
    with tempfile.TemporaryDirectory() as place:
        # Drawn as in the first turn of the cases, which is that of this campaign for a third of the faults.
        copy = Copy(Path(place) / "campaign", np.random.default_rng([seed, which]), BASE in SYMMETRIC)
        shutil.copytree(source, copy.folder)
        try:
            made = FAMILIES[family][fault](copy)
        except DoesNotApply as reason:
            return {**record, "said": str(reason), "ends": "does not apply"}
        record["said"] = made.said
        if _same(source, copy.folder):
            return {**record, "ends": "same readings", "k": 0.0, "c": 0.0}
        without, found = right(source), fitted(copy.folder)
    if found is None or without is None or set(found) != set(without):
        return {**record, "ends": "no fit"}
    change = {name: abs(found[name] / value - 1.0) for name, value in without.items()}
    k, c = (max(v for name, v in change.items() if name.startswith(letter)) for letter in ("k_", "c_"))
    return {**record, "ends": "fitted", "k": k, "c": c}


def _same(one: Path, other: Path) -> bool:
    """Whether both campaigns have the same sensors with the same readings at the same times."""
    try:
        campaigns = [read_campaign(folder) for folder in (one, other)]
    except SysidError:
        return False
    texts = [(folder / "campaign.toml").read_bytes() for folder in (one, other)]
    scans = [(folder / "bump_scan.csv").read_bytes() for folder in (one, other)]
    logs = [[*(r.log for r in c.bump_runs), *(d.log for d in c.plank_drops)] for c in campaigns]
    if texts[0] != texts[1] or scans[0] != scans[1] or len(logs[0]) != len(logs[1]):
        return False
    for first, second in zip(*logs, strict=True):
        if [c.sensor for c in first.channels] != [c.sensor for c in second.channels]:
            return False
        for a, b in zip(first.channels, second.channels, strict=True):
            if not (np.array_equal(a.time_s, b.time_s) and np.array_equal(a.value, b.value, equal_nan=True)):
                return False
    return True
