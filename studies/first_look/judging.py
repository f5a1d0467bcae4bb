"""What `init` guessed of a folder against what is true: right, marked, wrong and not marked."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from click.testing import CliRunner

from studies.first_look.variants import Written
from sysid.campaign.toml.todo import find_doubts, find_todos
from sysid.cli.main import cli
from sysid.first_look import SensorGuess, campaign_text, first_look

#: |ln| between a guessed and the listed speed that counts as right.
_SPEED = 0.06


@dataclass
class Score:
    """Counts of one folder: columns and tests that are right, marked to confirm (right or not), wrong and not marked
    (by name), and what is left for a person."""

    columns: int = 0
    right: int = 0
    marked: int = 0
    silent: list[str] = field(default_factory=list)
    tests: int = 0
    tests_right: int = 0
    tests_silent: list[str] = field(default_factory=list)
    vehicle: str = ""
    to_fill: int = 0
    to_confirm: int = 0
    edits: int = 0
    check: int | None = None


def judged(written: Written, vehicle: str | None, check: bool = True) -> Score:
    """Look at a folder and compare; with `check` fill in what is left from the truth, and let that stage judge it."""
    look = first_look(written.folder, vehicle)
    text = campaign_text(look, written.folder.name, "campaign.toml")
    score = Score(vehicle=look.template.name if look.template else "none")
    score.to_fill = len(find_todos(tomllib.loads(text)))
    score.to_confirm = len(find_doubts(text))
    for kind, sensors in (("bump_run", look.run_sensors), ("plank_drop", look.drop_sensors)):
        guesses = {s.column: s for s in sensors}
        for new, old in written.column[kind].items():
            _column(score, guesses.get(new), written, kind, new, old)
    axles = [a["name"] for a in sorted(written.tables["vehicle"]["axle"], key=lambda a: a["x_m"])]
    for entry in look.tests:
        kind, true = _entry(written.tables, written.file.get(entry.file))
        right = entry.kind == kind
        if kind == "plank_drop":
            right = right and entry.axle is not None and axles[entry.axle] == true["axle"]
        else:
            speed = entry.speed_km_h
            right = right and speed is not None and abs(np.log(speed / true["nominal_speed_km_h"])) < _SPEED
        # A load case that is left open is asked for, once for all of them.
        first = next(iter(written.tables["load_case"]))
        right = right and (entry.load_case is None or _same_case(entry.load_case, true.get("load_case", first)))
        score.tests += 1
        score.tests_right += right
        if entry.sure and not right:
            score.tests_silent.append(entry.file)
    if not check:
        return score
    (score.edits, filled) = _filled(text, written)
    path = written.folder / "campaign.toml"
    path.write_text(filled, encoding="utf-8")
    outcome = CliRunner().invoke(cli, ["check", str(path), "--output", str(written.folder / "output")])
    score.check = outcome.exit_code
    return score


def _column(score: Score, guess: SensorGuess | None, written: Written, kind: str, new: str, old: str) -> None:
    listed = written.tables["sensors"][kind][old]
    axle = _axle_number(written.tables, listed) if kind == "bump_run" else None
    true = {"kind": listed["kind"], "unit": listed["unit"], "sign": 1, "axle": axle, **written.changed.get(new, {})}
    score.columns += 1
    number = None if guess is None or guess.axle is None else guess.axle + 1
    right = guess is not None and (guess.kind, guess.unit, guess.sign, number) == tuple(true.values())
    score.right += right
    sure = guess is not None and guess.sure
    score.marked += not sure
    # What contradicts its name must be marked even where the guess is right.
    if sure and (not right or new in written.changed):
        score.silent.append(new)


def _axle_number(tables: Mapping[str, Any], listed: Mapping[str, Any]) -> int:
    """Number of the axle at or above which a sensor sits, 1 is the first."""
    axles = sorted(tables["vehicle"]["axle"], key=lambda a: a["x_m"])
    at = listed["x_m"] if "x_m" in listed else next(a["x_m"] for a in axles if a["name"] == listed["axle"])
    return int(np.argmin([abs(a["x_m"] - at) for a in axles])) + 1


def _entry(tables: Mapping[str, Any], file: str | None) -> tuple[str, Mapping[str, Any]]:
    for kind in ("bump_run", "plank_drop"):
        for entry in tables["tests"].get(kind, []):
            if entry["file"] == file:
                return kind, entry
    raise LookupError(f"{file} stands in no list of tests")


def _same_case(name: str, true: str) -> bool:
    return name == true or {name, true} <= {"as_tested", true}


def _filled(text: str, written: Written) -> tuple[int, str]:
    """The file with every value that is left from the truth, and the number of values put in."""
    tables = tomllib.loads(text)
    todos = find_todos(tables)
    for todo in todos:
        value = tables
        for key in todo.path:
            value = value[key]  # type: ignore[index]
        quoted = '"' + str(value).replace("\\", "\\\\").replace('"', '\\"') + '"'
        true = _truth(tables, todo.path, written)
        if true is None:
            start = text.index(quoted)
            first = text.rfind("\n", 0, start)
            text = text[:first] + text[text.index("\n", start) :]
        else:
            text = text.replace(quoted, true, 1)
    return len(todos), text


def _truth(tables: Any, path: tuple[str | int, ...], written: Written) -> str | None:
    """What a person would put in at a place, None to delete the line."""
    true = written.tables
    if path[0] == "load_case":
        case = next((c for c in true["load_case"] if c == path[1]), next(iter(true["load_case"])))
        return str(true["load_case"][case][path[2]])
    if path[0] == "vehicle":
        # No template has that many axles: all axles are taken to carry one body, and the check fails on their sums.
        axles = sorted(true["vehicle"]["axle"], key=lambda a: a["x_m"])
        value = true["vehicle"]["name"] if path[1] == "name" else axles[int(path[2])].get(str(path[3]))
        return f'"{value}"' if isinstance(value, str) else str(value)
    if path[:2] == ("acquisition", "filter"):
        low_pass = true["acquisition"].get("filter")
        return None if low_pass is None else _inline(low_pass)
    if path == ("scan", "heading_deg"):
        return str(true["scan"]["heading_deg"])
    if path == ("tests", "plank_height_m"):
        return str(true["tests"]["plank_drop"][0]["plank_height_m"])
    if path == ("tests", "load_case"):
        return f'"{next(iter(true["load_case"]))}"'
    if path[0] == "sensors":
        listed = true["sensors"][path[1]][written.column[str(path[1])][str(path[2])]]
        value = listed.get(str(path[3]))
        if path[3] == "axle" and path[1] == "bump_run":
            axles = sorted(true["vehicle"]["axle"], key=lambda a: a["x_m"])
            value = _axle_of(tables, true, axles[_axle_number(true, listed) - 1]["name"])
        return f'"{value}"' if isinstance(value, str) else None if value is None else str(value)
    if path[0] == "tests":
        entry = tables["tests"][path[1]][path[2]]
        # A drop that was taken for a run has no speed over a bump.
        value = _entry(true, written.file[entry["file"]])[1].get(str(path[3]), 10)
        return f'"{_axle_of(tables, true, value)}"' if path[3] == "axle" else str(value)
    raise LookupError(f"nothing is known of {path}")


def _axle_of(tables: Any, true: Mapping[str, Any], name: str) -> str:
    """Name that the file has for an axle of the truth, its last one where it has fewer axles."""
    names = [a["name"] for a in sorted(true["vehicle"]["axle"], key=lambda a: a["x_m"])]
    own = tables["vehicle"]["axle"]
    return str(own[min(names.index(name), len(own) - 1)]["name"])


def _inline(table: Mapping[str, Any]) -> str:
    return "{ " + ", ".join(f'{k} = "{v}"' if isinstance(v, str) else f"{k} = {v}" for k, v in table.items()) + " }"
