"""What was driven: drops and runs told apart, their axle, speed and load case."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.first_look.file_words import TestKind
from sysid.first_look.kinds import KindGuess
from sysid.first_look.places import speed_m_s
from sysid.first_look.records import EntryGuess, SeenLog
from sysid.first_look.templates import Template
from sysid.first_look.words import PlaceWord

#: Size of an axle's acceleration over the largest of the log from which the axle itself was driven over something.
_STRUCK = 0.35
#: How clearly an axle must rise or fall first, and how long axles after each other take at least [s].
_CLEAR, _ONE_AFTER_THE_OTHER_S = 0.3, 0.12
#: |ln| between the speed that a name says and that of the arrivals from which they contradict each other.
_SPEEDS = 0.12


@dataclass(frozen=True)
class KindOfTest:
    """Drop or run, whether name and behaviour agree, and why."""

    kind: TestKind
    sure: bool
    why: str


@dataclass(frozen=True)
class Driven:
    """What is known of the truck where it was driven.

    - `timed` maps files of runs to the arrival [s] of every axle;
    - `positions_m` of the axles;
    - `named` and `axle_of` map columns to axles, by name and by arrival;
    - `trusted`: whether positions do not come from a guessed template.
    """

    timed: Mapping[str, Mapping[int, float]]
    positions_m: tuple[float, ...] | None
    named: Mapping[str, int]
    template: Template | None
    axles: int
    axle_of: Mapping[str, int]
    trusted: bool


def kind_of_test(log: SeenLog, kinds: Mapping[str, KindGuess]) -> KindOfTest:
    """Whether a log is a plank drop or a bump run: its path against the way in which its axles move."""
    by_name, by_motion = log.said.kind, _motion(log, kinds)
    if by_name is not None and by_motion is not None:
        if by_name == by_motion:
            return KindOfTest(by_name, True, "name and behaviour agree")
        return KindOfTest(by_name, False, f"its name says {_WORDS[by_name]}, its axles move as in {_WORDS[by_motion]}")
    if by_motion is not None:
        return KindOfTest(by_motion, False, f"its axles move as in {_WORDS[by_motion]}")
    if by_name is not None:
        return KindOfTest(by_name, False, f"{_WORDS[by_name]} by its name alone")
    return KindOfTest("bump_run", False, "neither name nor behaviour say what it is")


_WORDS: dict[TestKind, str] = {"plank_drop": "a drop", "bump_run": "a run"}


def struck_columns(log: SeenLog, kinds: Mapping[str, KindGuess]) -> list[str]:
    """Columns of axle accelerations that move about as much as the largest of the log, largest first."""
    axles = [x for x in log.looks if x.alive and kinds[x.name].kind == "axle_acceleration"]
    largest = max((x.size for x in axles), default=0.0)
    axles = [x for x in axles if x.size > _STRUCK * largest]
    return [x.name for x in sorted(axles, key=lambda x: -x.size)]


def _motion(log: SeenLog, kinds: Mapping[str, KindGuess]) -> TestKind | None:
    struck = set(struck_columns(log, kinds))
    looks = [x for x in log.looks if x.name in struck and x.arrival_s is not None]
    if not looks:
        return None
    axles = [x for x in log.looks if x.alive and kinds[x.name].kind == "axle_acceleration"]
    if len(struck) == 1 and len(axles) > 1:
        return "plank_drop"
    times = [x.arrival_s for x in looks if x.arrival_s is not None]
    if max(times) - min(times) > _ONE_AFTER_THE_OTHER_S:
        return "bump_run"
    # Over a bump axle and frame rise first and the suspension is pressed together, off a plank all is turned round.
    up = {"suspension_deflection": -1, "axle_acceleration": 1, "body_acceleration": 1}
    lifts = [
        x.lift * kinds[x.name].sign * up[k] for x in log.looks if x.alive and (k := kinds[x.name].kind) is not None
    ]
    lift = float(np.median(lifts))
    if abs(lift) < _CLEAR:
        return None
    return "bump_run" if lift > 0.0 else "plank_drop"


def load_cases_of(logs: Sequence[SeenLog]) -> tuple[dict[str, str], dict[str, str | None]]:
    """Names of load cases with what they are (empty first), and that of every log, None where its path says none."""
    words: dict[str, str] = {}
    for kind in ("empty", "partly", "laden"):
        for log in logs:
            if log.said.load_case == kind and kind not in words.values():
                words[log.said.load_word] = kind
    name_of = {kind: word for word, kind in words.items()}
    named = {log.file: name_of.get(log.said.load_case or "") for log in logs}
    return (words or {"as_tested": "empty"}), named


def entries_of(
    logs: Sequence[tuple[SeenLog, Mapping[str, KindGuess]]],
    kinds: Mapping[str, KindOfTest],
    case_of: Mapping[str, str | None],
    driven: Driven,
) -> tuple[EntryGuess, ...]:
    """Drops in the order of their axles, then runs in the order of load case and speed."""
    cases = list(dict.fromkeys(c for c in case_of.values() if c is not None)) or ["as_tested"]
    numbers = [log.said.axle for log, _ in logs if kinds[log.file].kind == "plank_drop" and log.said.axle is not None]
    base = 0 if 0 in numbers else 1
    result = []
    for log, of_columns in logs:
        kind = kinds[log.file]
        case = case_of[log.file]
        why = [] if kind.sure else [kind.why]
        if kind.kind == "plank_drop":
            axle, sure, reason = _drop_axle(log, of_columns, base, driven)
            result.append(
                EntryGuess(log.file, kind.kind, case or _first(cases), axle, None, kind.sure and sure, (*why, *reason))
            )
            continue
        speed, sure, reason = _speed(log, driven)
        if case is None:
            reason = [*reason, "load case not said"] if len(cases) > 1 else reason
        sure = sure and kind.sure and (case is not None or len(cases) == 1)
        result.append(EntryGuess(log.file, kind.kind, case or _first(cases), None, speed, sure, (*why, *reason)))
    return tuple(sorted(result, key=lambda e: _in_list(e, cases)))


def _first(cases: Sequence[str]) -> str:
    return cases[0]


def _in_list(entry: EntryGuess, cases: Sequence[str]) -> tuple[bool, int, float, str]:
    of_axle = 99 if entry.axle is None else entry.axle
    place = of_axle if entry.kind == "plank_drop" else cases.index(entry.load_case) if entry.load_case in cases else 0
    return entry.kind == "bump_run", place, entry.speed_km_h or 0.0, entry.file


def _drop_axle(
    log: SeenLog, kinds: Mapping[str, KindGuess], base: int, driven: Driven
) -> tuple[int | None, bool, list[str]]:
    """Axle on the plank, whether name and motion agree where both can speak, and reasons."""
    by_name = _axle_of_path(log.said.axle, log.said.place, base, driven)
    columns = [x.name for x in log.looks if kinds[x.name].kind == "axle_acceleration"]
    struck = struck_columns(log, kinds)
    by_motion = None
    if len(columns) > 1 and struck:
        by_motion = driven.axle_of.get(struck[0], driven.named.get(struck[0]))
    if by_motion is not None and by_name is not None:
        agree = by_motion == by_name
        return by_name, agree, [] if agree else [f"axle {by_motion + 1} moves most"]
    if by_name is not None:
        # The sensors sit at the axle under test: nothing but the name can say which that was.
        return by_name, True, ["axle by its name"]
    if by_motion is not None:
        return by_motion, False, ["the axle that moves most"]
    return None, False, ["axle not known"]


def _axle_of_path(number: int | None, place: PlaceWord | None, base: int, driven: Driven) -> int | None:
    if place is not None and driven.template is not None:
        there = [i for i, p in enumerate(driven.template.places) if p == place]
        if place == "rear" and not there:
            there = [driven.axles - 1]
        if number is not None and 0 <= number - base < len(there) and len(there) > 1:
            return there[number - base]
        if len(there) == 1:
            return there[0]
    axle = None if number is None else number - base
    return axle if axle is not None and 0 <= axle < max(driven.axles, 1) else None


def _speed(log: SeenLog, driven: Driven) -> tuple[float | None, bool, list[str]]:
    """Speed [km/h], whether name and arrivals agree on it, and reasons."""
    by_name = log.said.speed_km_h
    times = driven.timed.get(log.file, {})
    measured = None
    if driven.positions_m is not None and len(times) > 1:
        speed = speed_m_s(times, driven.positions_m)
        measured = None if speed is None else 3.6 * speed
    if by_name is not None and measured is not None:
        agree = abs(float(np.log(measured / by_name))) < _SPEEDS
        return by_name, agree, [] if agree else [f"its axles arrive as at {measured:.1f} km/h"]
    if by_name is not None:
        return by_name, False, ["speed by its name alone"]
    if measured is not None:
        of_what = "axle positions" if driven.trusted else "guessed axle positions"
        return round(measured, 1), False, [f"speed by arrivals and {of_what}"]
    return None, False, ["speed not known"]
