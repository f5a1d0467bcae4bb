"""The study of kills: it sees every difference from the undisturbed folder but times, and counts places."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from studies.kills.__main__ import figures
from studies.kills.case import differences


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    good, found = tmp_path / "good", tmp_path / "found"
    (good / "stages").mkdir(parents=True)
    (good / "stages" / "fit.npz").write_bytes(b"numbers")
    (good / "result.json").write_text(json.dumps({"timings": {"fit": 1.0}, "seed": 0}), encoding="utf-8")
    shutil.copytree(good, found)
    return found, good


def test_times_are_no_difference(folders: tuple[Path, Path]) -> None:
    found, good = folders
    (found / "result.json").write_text(json.dumps({"timings": {"fit": 2.0}, "seed": 0}), encoding="utf-8")
    assert differences(found, good) == []


def test_numbers_files_and_halves_are_differences(folders: tuple[Path, Path]) -> None:
    found, good = folders
    (found / "stages" / "fit.npz").write_bytes(b"other")
    (found / ".writing-x.csv").write_bytes(b"half")
    (found / "result.json").write_text(json.dumps({"timings": {}, "seed": 1}), encoding="utf-8")
    assert differences(found, good) == [
        ".writing-x.csv is missing or too much",
        "stages/fit.npz differs",
        "result.json differs",
    ]


def test_kills_are_counted_by_place() -> None:
    records = [{"killed": ["fit", "fit", "drops"], "wrong": []}, {"killed": ["fit"], "wrong": ["x"]}]
    shown = figures(records, 3)
    assert "4 kills in 2 folders, seed 3; 1 of the folders ended as the undisturbed one." in shown
    assert "fit 3, drops 1" in shown
