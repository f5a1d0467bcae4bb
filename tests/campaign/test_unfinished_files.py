"""Campaign files with values to fill in: refused by the reader, listed by the check, its logs checked all the same."""

from __future__ import annotations

import copy
import re
import shutil
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from sysid.campaign.read import read_campaign
from sysid.campaign.toml.reading import validate
from sysid.campaign.toml.stand_ins import with_stand_ins
from sysid.campaign.toml.todo import find_doubts, find_todos, refuse_todos
from sysid.campaign.toml.vehicle_tables import VehicleReader
from sysid.cli.main import cli
from sysid.errors import CampaignError

DATA = Path(__file__).resolve().parents[2] / "data"


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """Two drops and a run of the shipped campaign."""
    text = (DATA / "campaign.toml").read_text(encoding="utf-8")
    files = ("plank_drops/axle1_drop1.csv", "plank_drops/axle2_drop1.csv", "bump_runs/case1_unloaded_16kmh_run1.csv")
    lists = [line for line in text.splitlines() if "file = " not in line or any(f in line for f in files)]
    lists.insert(lists.index("[scan]") + 1, 'file = "bump_scan.csv"')
    for name in (*files, "bump_scan.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(DATA / name, tmp_path / name)
    (tmp_path / "campaign.toml").write_text("\n".join(lists), encoding="utf-8")
    return tmp_path


def test_values_to_fill_in_are_found_wherever_they_stand() -> None:
    tables = tomllib.loads(
        """
        title = "TODO"
        [load_case.empty]
        axle_loads_kg = ["TODO: front", 3000]
        [[vehicle.axle]]
        name = "rear"
        x_m = "TODO: distance [m]"
        note = "a TODO in the middle is none"
        """
    )
    found = [(t.where, t.what, t.path) for t in find_todos(tables)]
    assert found == [
        ("title", "", ("title",)),
        ("load_case.empty.axle_loads_kg[1]", "front", ("load_case", "empty", "axle_loads_kg", 0)),
        ("vehicle.axle[1] ('rear').x_m", "distance [m]", ("vehicle", "axle", 0, "x_m")),
    ]
    with pytest.raises(CampaignError, match=r"a.toml has 3 values to fill in \(title, load_case.empty"):
        refuse_todos(tables, "a.toml")
    refuse_todos({"a": 1}, "a.toml")


def test_guesses_to_confirm_are_found_with_line_and_place() -> None:
    lines = (
        "[vehicle]",
        'name = "truck"  # TODO confirm: chosen',
        "",
        "[[vehicle.axle]]",
        'name = "rear"',
        "x_m = 4 # TODO confirm: measure",
        "[tests]",
        "bump_run = [",
        '  { case = "a", file = "a.csv" }, # TODO confirm: speed',
        "  # TODO confirm: all of them",
        "]",
        "a = 1 # confirmed",
    )
    (doubt,) = find_doubts('  { file = "run#1.csv" }, # TODO confirm: speed')
    assert (doubt.entry, doubt.what) == ("run#1.csv", "speed")
    text = "\n".join(lines)
    assert [(d.line, d.entry, d.what) for d in find_doubts(text)] == [
        (2, "vehicle 'truck'.name", "chosen"),
        (6, "vehicle.axle 'rear'.x_m", "measure"),
        (9, "a.csv", "speed"),
        (10, "tests", "all of them"),
    ]


def _text(folder: Path) -> str:
    return (folder / "campaign.toml").read_text(encoding="utf-8")


REPLACED = (
    ("axle_loads_kg = [", 'axle_loads_kg = "TODO: loads" # ['),
    ('unit = "mm"', 'unit = "TODO: unit"'),
    ("heading_deg = ", 'heading_deg = "TODO: heading" # '),
)


def _unfinished(folder: Path) -> Path:
    text = _text(folder)
    for old, new in REPLACED:
        assert old in text, old
        text = text.replace(old, new, 1)
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    return folder


def test_an_unfinished_file_is_refused_by_every_stage_but_the_check(campaign: Path) -> None:
    folder = _unfinished(campaign)
    with pytest.raises(CampaignError, match="has 3 values to fill in"):
        read_campaign(folder)
    outcome = CliRunner().invoke(cli, ["drops", str(folder), "--output", str(folder / "out")])
    assert outcome.exit_code == 2
    assert "'check' lists what belongs there" in outcome.output


def test_the_check_lists_what_is_left_and_checks_the_rest(campaign: Path) -> None:
    whole = CliRunner().invoke(cli, ["check", str(campaign), "--output", str(campaign / "out")], env={"COLUMNS": "200"})
    folder = _unfinished(campaign)
    outcome = CliRunner().invoke(cli, ["check", str(folder), "--output", str(folder / "none")], env={"COLUMNS": "200"})
    assert outcome.exit_code == 2, outcome.output
    assert "axle_loads_kg: loads" in outcome.output
    assert "scan.heading_deg: heading" in outcome.output
    assert "3 values to fill in; the logs were checked" in outcome.output
    assert not (folder / "none").exists()
    counted = [line for line in whole.output.splitlines() if "channel records" in line]
    left = [line for line in outcome.output.splitlines() if "channel records" in line]
    # The sensor without a unit is the only thing that the check goes without.
    assert int(left[0].split()[0]) < int(counted[0].split()[0])


@pytest.mark.parametrize(("raised", "code"), [(KeyboardInterrupt, 130), (ValueError, 1)])
def test_a_check_of_an_unfinished_file_can_be_stopped(campaign: Path, monkeypatch, raised, code: int) -> None:
    def fails(*unused, **more):
        raise raised

    monkeypatch.setattr("sysid.campaign.quality.check.check_quality", fails)
    folder = _unfinished(campaign)
    outcome = CliRunner().invoke(cli, ["check", str(folder), "--output", str(folder / "none")])
    assert outcome.exit_code == code
    assert "Traceback" not in outcome.output


def test_stand_ins_leave_no_value_to_fill_in_and_the_input_as_it_was(campaign: Path) -> None:
    text = _text(_unfinished(campaign))
    tables = tomllib.loads(text)
    completed, unknown = with_stand_ins(tables, "campaign.toml")
    assert find_todos(completed) == ()
    assert tables == tomllib.loads(text)
    assert len(unknown) == 1
    read_campaign(campaign, unfinished=True)


def test_one_height_for_all_planks(campaign: Path) -> None:
    text = _text(campaign)
    heights = [d.plank_height_m for d in read_campaign(campaign).plank_drops]
    assert heights
    own = text.replace("[tests]", "[tests]\nplank_height_m = 0.06", 1)
    (campaign / "campaign.toml").write_text(own, encoding="utf-8")
    assert [d.plank_height_m for d in read_campaign(campaign).plank_drops] == heights
    common = own.replace(", plank_height_m = 0.075", "")
    assert common != own
    (campaign / "campaign.toml").write_text(common, encoding="utf-8")
    assert {d.plank_height_m for d in read_campaign(campaign).plank_drops} == {0.06}


def _leaves(value: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    if isinstance(value, dict | list):
        items = value.items() if isinstance(value, dict) else enumerate(value)
        for key, inner in items:
            yield from _leaves(inner, (*path, key))
    elif path != ("schema",):
        yield path


def test_any_one_value_may_be_left_but_the_names_that_others_use(campaign: Path) -> None:
    tables = tomllib.loads(_text(campaign))
    refused = set()
    for path in _leaves(tables):
        unfinished = copy.deepcopy(tables)
        at: Any = unfinished
        for key in path[:-1]:
            at = at[key]
        at[path[-1]] = "TODO: value"
        completed, _ = with_stand_ins(unfinished, "campaign.toml")
        assert find_todos(completed) == ()
        try:
            VehicleReader(validate(completed, "campaign.toml"), "campaign.toml")
        except CampaignError:
            refused.add(path)
    assert refused == {("vehicle", "body", 0, "name"), ("vehicle", "body", 1, "name")}


def test_runs_of_a_load_case_that_is_to_be_filled_in_are_left_out_and_the_rest_is_read(campaign: Path) -> None:
    text = (campaign / "campaign.toml").read_text(encoding="utf-8")
    text = text.replace("[tests]", '[tests]\nload_case = "TODO: load case"', 1)
    (campaign / "campaign.toml").write_text(re.sub(r'(case1.*)load_case = "unloaded", ', r"\1", text), encoding="utf-8")
    found = read_campaign(campaign, unfinished=True)
    assert (len(found.plank_drops), len(found.bump_runs)) == (2, 0)
