"""The planned campaigns of `examples/vehicles`: as their script writes them, and readable without logs."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from sysid.campaign.read import read_campaign
from sysid.road.point_cloud import read_point_cloud
from sysid.road.scan import analyse_scan

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "vehicles"


def _script():
    specification = importlib.util.spec_from_file_location("make_examples", FOLDER / "make_examples.py")
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.mark.parametrize(("number", "name"), [(0, "rigid3"), (1, "semitrailer5")])
def test_a_planned_campaign_is_what_its_script_writes(number: int, name: str) -> None:
    script = _script()
    assert script.NAMES[number] == name
    assert (FOLDER / name / "campaign.toml").read_text(encoding="utf-8") == script.campaign(name)
    assert (FOLDER / name / "bump_scan.csv").read_text(encoding="utf-8") == script.scan(number)


@pytest.mark.parametrize("name", ["rigid3", "semitrailer5"])
def test_a_planned_campaign_can_be_read_without_logs(name: str) -> None:
    read = read_campaign(FOLDER / name, point_cloud_reader=read_point_cloud, planned=True)
    assert len(read.bump_runs) == 12
    assert {r.load_case for r in read.bump_runs} == {"empty", "laden"}
    (scan,) = read.scans.values()
    profile = analyse_scan(scan).profile
    # The bump of the script: 75 mm high, 0.9 m long; scan noise of 1.5 mm.
    assert np.max(profile.height_m) == pytest.approx(0.075, abs=0.003)
    assert profile.length_m == pytest.approx(0.9, abs=0.1)
