"""The campaign so far: the tests of the campaign file whose logs are there, and those that only their names tell."""

from __future__ import annotations

import copy
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from sysid.campaign.inputs.paths import relative_name
from sysid.campaign.toml.text import todo
from sysid.campaign.toml.todo import find_todos, is_todo
from sysid.first_look import EntryGuess, FirstLook
from sysid.watch.records import PlannedTest, TestKind
from sysid.wording import shorten

_KINDS: tuple[TestKind, ...] = ("plank_drop", "bump_run", "road_drive")


@dataclass(frozen=True)
class Listing:
    """Tables of a campaign of what is there.

    - `planned`: all tests of the campaign file, those that are there and those to come;
    - `guessed`: sentences about logs that no test names, by file; those in `taken` were given a test by their names and
      readings;
    - `open_values`: places of values that are still to be filled in; `waits_for` says which files have to come.
    """

    tables: dict[str, Any]
    planned: tuple[PlannedTest, ...]
    guessed: Mapping[str, str] = field(default_factory=dict)
    taken: frozenset[str] = frozenset()
    open_values: tuple[str, ...] = ()
    waits_for: tuple[str, ...] = ()

    @property
    def unfinished(self) -> bool:
        """Whether values or files are missing that the stages need."""
        return bool(self.open_values or self.waits_for)

    def of(self, file: str) -> PlannedTest | None:
        """The test whose log a file is."""
        return next((test for test in self.planned if file in test.files), None)


def listing(tables: Mapping[str, Any], there: Collection[str], unusable: Collection[str] = ()) -> Listing:
    """What of a campaign file is there.

    Parameters
    ----------
    tables : as parsed; they are not changed.
    there : names of the files that are there; unusable : those of logs that cannot be read.
    """
    kept: dict[str, Any] = copy.deepcopy(dict(tables))
    planned = planned_tests(kept, there)
    tests = _table(kept, "tests")
    usable = set(there) - set(unusable)
    for kind in _KINDS:
        if isinstance(tests.get(kind), list):
            tests[kind] = [e for e in tests[kind] if isinstance(e, dict) and set(log_names(e)) <= usable]
    # Passes over bridges and roads name files of their own, and no estimate needs them.
    kept.pop("bridge", None)
    if isinstance(tests.get("prediction"), list):
        over_bumps = [
            e for e in tests["prediction"] if isinstance(e, dict) and not {"road", "bridge", "shape"} & set(e)
        ]
        tests["prediction"] = over_bumps
    waits = []
    for scan in bump_tables(kept):
        for key in ("file", "profile"):
            name = scan.get(key)
            if isinstance(name, str) and not name.startswith("TODO") and relative_name(name) not in there:
                waits.append(f"{shorten(name, 100)}, the bump")
                scan.pop(key)
                scan["file"] = todo("the scan is not there yet")
                scan.setdefault("heading_deg", 0.0)
    open_values = tuple(t.where for t in find_todos(tables))
    return Listing(kept, planned, open_values=open_values, waits_for=tuple(waits))


def with_guesses(known: Listing, look: FirstLook, there: Collection[str]) -> Listing:
    """Add the logs that no test names and whose test a first look tells: kind, axle or speed, and load case.

    What is added has the names of axles and load cases of the campaign file; all else is left to a person.
    """
    tables, guessed, taken = copy.deepcopy(known.tables), {}, set()
    listed = {file for test in known.planned for file in test.files}
    tests = tables.setdefault("tests", {})
    axles = [str(a.get("name")) for a in _entries(_table(tables, "vehicle"), "axle")]
    for entry in look.tests:
        if entry.file in listed or entry.file not in there:
            continue
        guess, why = _entry(entry, axles if len(axles) == look.axles else [], _table(tables, "load_case"))
        said = "no test of the campaign file names it"
        if guess is None:
            guessed[entry.file] = f"{said}, and {why}: enter it in [tests]."
            continue
        guess |= {"file": entry.file}
        count = 1 + sum(_same(guess, e) for e in _entries(tests, entry.kind))
        if entry.kind == "bump_run":
            guess |= {"case": f"{guess['load_case']} {guess['nominal_speed_km_h']:g} km/h", "repeat": count}
        elif entry.kind == "plank_drop" and "plank_height_m" not in tests:
            heights = {e["plank_height_m"] for e in _entries(tests, "plank_drop") if "plank_height_m" in e}
            if len(heights) != 1:
                guessed[entry.file] = f"{said}, and nothing says its plank_height_m: enter it in [tests]."
                continue
            guess |= {"plank_height_m": heights.pop()}
        words = _words(entry.kind, guess)
        guessed[entry.file] = f"{said}; by its name and its readings it is taken for: {words}."
        tests.setdefault(entry.kind, []).append(guess)
        taken.add(entry.file)
    return Listing(
        tables, known.planned, guessed, frozenset(taken), open_values=known.open_values, waits_for=known.waits_for
    )


def planned_tests(tables: Mapping[str, Any], there: Collection[str]) -> tuple[PlannedTest, ...]:
    """All tests of a campaign file in their order, with what of them is there."""
    tests = _table(tables, "tests")
    first = next(iter(_table(tables, "load_case")), "")
    found = []
    for kind in _KINDS:
        for entry in _entries(tests, kind):
            files = tuple(log_names(entry))
            case = entry.get("load_case", tests.get("load_case", first if kind == "plank_drop" else ""))
            speed = entry.get("nominal_speed_km_h")
            speed = float(speed) if kind != "plank_drop" and isinstance(speed, int | float) else None
            of_entry = {**entry, "load_case": case}
            axle = str(entry.get("axle", "")) if kind == "plank_drop" else ""
            there_now = bool(files) and set(files) <= set(there)
            found.append(PlannedTest(kind, files, str(case), speed, axle, _words(kind, of_entry), there_now))
    return tuple(found)


def named_files(tables: Mapping[str, Any]) -> set[str]:
    """All texts in a campaign file that could be names of files, in the form in which files are compared."""
    return {relative_name(text) for text in _texts(tables) if text}


def _entry(entry: EntryGuess, axles: list[str], cases: Mapping[str, Any]) -> tuple[dict[str, Any] | None, str]:
    """A line of the list of tests, or why there is none."""
    if entry.load_case not in cases:
        return None, "its load case is not known"
    if not entry.sure:
        return None, f"what it is is not sure ({'; '.join(entry.why)})"
    if entry.kind == "plank_drop":
        if entry.axle is None or entry.axle >= len(axles):
            return None, "its axle is not known"
        return {"axle": axles[entry.axle], "load_case": entry.load_case}, ""
    if entry.speed_km_h is None:
        return None, "its speed is not known"
    return {"load_case": entry.load_case, "nominal_speed_km_h": entry.speed_km_h}, ""


def _same(first: Mapping[str, Any], second: Mapping[str, Any]) -> bool:
    return all(first.get(k) == second.get(k) for k in ("axle", "load_case", "nominal_speed_km_h"))


def _words(kind: str, entry: Mapping[str, Any]) -> str:
    what = {"plank_drop": "drop", "bump_run": "run", "road_drive": "road drive"}[kind]
    axles = entry.get("axle") or ", ".join(map(str, entry.get("axles", ())))
    speed = entry.get("nominal_speed_km_h") if kind != "plank_drop" else None
    parts = [what, axles, entry.get("load_case"), f"{speed:g} km/h" if isinstance(speed, int | float) else ""]
    if kind == "bump_run" and isinstance(entry.get("repeat"), int):
        parts.append(f"repeat {entry['repeat']}")
    known = [part for part in parts if part and not is_todo(part)]
    return ", ".join(map(shorten, known))


def log_names(entry: Mapping[str, Any]) -> Iterator[str]:
    """Names of the logs of a test."""
    if isinstance(entry.get("file"), str):
        yield relative_name(entry["file"])
    if isinstance(entry.get("files"), dict):
        yield from (relative_name(name) for name in entry["files"].values() if isinstance(name, str))


def _table(tables: Mapping[str, Any], key: str) -> dict[str, Any]:
    found = tables.get(key)
    return found if isinstance(found, dict) else {}


def _entries(tables: Mapping[str, Any], key: str) -> list[dict[str, Any]]:
    found = tables.get(key)
    return [e for e in found if isinstance(e, dict)] if isinstance(found, list) else []


def bump_tables(tables: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Tables of bumps: one, or several by name."""
    scan = _table(tables, "scan")
    inner = [table for table in scan.values() if isinstance(table, dict)]
    return inner if inner and len(inner) == len(scan) else [scan] if scan else []


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for inner in value.values():
            yield from _texts(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _texts(inner)
