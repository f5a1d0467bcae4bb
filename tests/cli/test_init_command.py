"""The command `init`: what it writes and says, what it refuses, and exit codes."""

from __future__ import annotations

import shlex
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from sysid import limits
from sysid.campaign.toml.todo import find_doubts, find_todos
from sysid.cli.main import cli

DATA = Path(__file__).resolve().parents[2] / "data"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two runs and a drop of the shipped campaign."""
    target = tmp_path / "logs"
    for name in (
        "bump_runs/case1_unloaded_16kmh_run1.csv",
        "bump_runs/case4_loaded_8kmh_run1.csv",
        "plank_drops/axle2_drop1.csv",
        "bump_scan.csv",
    ):
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(DATA / name, target / name)
    return target


def run(*arguments: object):
    return CliRunner().invoke(cli, ["init", *map(str, arguments)], env={"COLUMNS": "200"})


def test_the_command_in_the_file_can_be_pasted(folder: Path) -> None:
    spaced = folder.rename(folder.with_name("my truck"))
    assert run(spaced).exit_code == 0
    (line,) = (
        line for line in (spaced / "campaign.toml").read_text(encoding="utf-8").splitlines() if " check " in line
    )
    assert shlex.split(line.removeprefix("#"))[-2:] == ["check", str(spaced / "campaign.toml")]


def test_a_campaign_file_is_begun_and_told(folder: Path) -> None:
    found = run(folder)
    assert found.exit_code == 0, found.output
    text = (folder / "campaign.toml").read_text(encoding="utf-8")
    tables = tomllib.loads(text)
    assert [d["file"] for d in tables["tests"]["plank_drop"]] == ["plank_drops/axle2_drop1.csv"]
    assert [r["nominal_speed_km_h"] for r in tables["tests"]["bump_run"]] == [16, 8]
    assert list(tables["load_case"]) == ["unloaded", "loaded"]
    todos, doubts = find_todos(tables), find_doubts(text)
    assert f"{len(todos)} values to fill in, {len(doubts)} guesses to confirm" in found.output
    assert "1 drops and 2 runs, 21 columns of sensors, vehicle lowboy6" in found.output
    assert "bump_scan.csv" in found.output


def test_an_existing_file_is_kept_without_force(folder: Path) -> None:
    (folder / "campaign.toml").write_text("mine", encoding="utf-8")
    found = run(folder)
    assert found.exit_code == 2
    assert "campaign.toml exists; give --force to write over it" in found.output
    assert (folder / "campaign.toml").read_text(encoding="utf-8") == "mine"
    assert run(folder, "--force").exit_code == 0
    assert (folder / "campaign.toml").read_text(encoding="utf-8") != "mine"


def test_the_file_may_stand_above_the_logs_but_nowhere_else(folder: Path, tmp_path: Path) -> None:
    found = run(folder, "--output", tmp_path / "truck.toml", "--vehicle", "lowboy6")
    assert found.exit_code == 0, found.output
    tables = tomllib.loads((tmp_path / "truck.toml").read_text(encoding="utf-8"))
    assert tables["tests"]["plank_drop"][0]["file"] == "logs/plank_drops/axle2_drop1.csv"
    (tmp_path / "other").mkdir()
    found = run(folder, "--output", tmp_path / "other" / "truck.toml")
    assert found.exit_code == 2
    assert "is neither in the folder of the logs nor above it" in found.output


def test_folders_without_logs_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    assert "holds no files that could be logs" in run(empty).output
    (empty / "notes.txt").write_text("no numbers here\n", encoding="utf-8")
    found = run(empty)
    assert found.exit_code == 2
    assert "holds no logs; give the folder into which the logger wrote" in found.output
    found = run(empty / "notes.txt")
    assert found.exit_code == 2
    assert "is a file" in found.output
    found = run(tmp_path / "none")
    assert found.exit_code == 2
    assert "does not exist" in found.output
    (empty / "log.mf4").write_bytes(b"MDF     4.10    broken")
    found = run(empty)
    assert found.exit_code == 3
    assert "holds no log that can be read" in found.output
    monkeypatch.setattr(limits, "FIRST_LOOK_FILES", 20)
    for i in range(25):
        (empty / f"{i}.csv").write_text("", encoding="utf-8")
    found = run(empty)
    assert found.exit_code == 2
    assert "holds more than 20 files" in found.output
    assert not (empty / "campaign.toml").exists()


def test_a_link_out_of_the_folder_is_left_out_and_named(folder: Path, tmp_path: Path) -> None:
    outside = tmp_path / "outside.csv"
    outside.write_text("time_s,a\n0,1\n1,2\n", encoding="utf-8")
    (folder / "link.csv").symlink_to(outside)
    found = run(folder)
    assert found.exit_code == 0
    assert "link.csv is a link that leads out of the folder; it is left out." in found.output


def test_a_vehicle_that_there_is_not_is_refused(folder: Path) -> None:
    found = run(folder, "--vehicle", "rigid33")
    assert found.exit_code == 2
    assert "There is no vehicle 'rigid33'; did you mean 'rigid3'?" in found.output


def test_units_of_counters_are_none_of_sensors(folder: Path) -> None:
    """A data logger counts its records in a column of the unit RN."""
    path = folder / "plank_drops/axle2_drop1.csv"
    names, *rows = path.read_text(encoding="utf-8").splitlines()
    units = ",".join(name.rpartition("_")[2] for name in names.split(","))
    rows = [f"{row},{i}" for i, row in enumerate(rows)]
    path.write_text("\n".join([f"{names},RECORD", f"{units},RN", *rows]) + "\n", encoding="utf-8")
    found = run(folder)
    assert found.exit_code == 0, found.output
    assert "RN" not in found.output
    assert "a counter" in found.output


def test_a_drive_over_a_road_is_no_bump_run_and_a_long_bump_run_is_none(folder: Path) -> None:
    """The columns of a run with random motion for 30 s, and the run itself with a quiet minute behind it."""
    head, *rows = (folder / "bump_runs/case1_unloaded_16kmh_run1.csv").read_text(encoding="utf-8").splitlines()
    readings = np.genfromtxt(rows, delimiter=",")
    step, rng = readings[1, 0] - readings[0, 0], np.random.default_rng(5)
    spread = np.nanstd(readings, axis=0)
    # Of about the frequencies of a truck: white readings that are averaged over 0.1 s.
    shaken = [np.convolve(rng.normal(size=6000), np.full(20, 0.2), "same") for _ in spread[1:]]
    drive = np.column_stack([step * np.arange(6000), spread[1:] * np.transpose(shaken)])
    quiet = np.nanmean(readings[:50], axis=0) + 0.002 * spread * rng.normal(size=(12_000, spread.size))
    quiet[:, 0] = readings[-1, 0] + step * (1.0 + np.arange(len(quiet)))
    for name, values in (("on_road_60kmh.csv", drive), ("long_24kmh.csv", np.concatenate([readings, quiet]))):
        np.savetxt(folder / name, values, fmt="%.5f", delimiter=",", header=head, comments="")
    found = run(folder)
    assert found.exit_code == 0, found.output
    tests = tomllib.loads((folder / "campaign.toml").read_text(encoding="utf-8"))["tests"]
    assert [(d["file"], d["nominal_speed_km_h"]) for d in tests["road_drive"]] == [("on_road_60kmh.csv", 60)]
    assert "long_24kmh.csv" in [r["file"] for r in tests["bump_run"]]
    assert "1 drops, 3 runs and 1 road drive" in found.output
    assert "road drive, load case ?, 60 km/h" in found.output
