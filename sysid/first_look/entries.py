"""What was driven: drops and runs told apart, their axle, speed and load case."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.campaign.records import SensorKind
from sysid.first_look.file_words import TestKind
from sysid.first_look.kinds import KindGuess
from sysid.first_look.load_cases import LoadCases
from sysid.first_look.places import speed_m_s
from sysid.first_look.records import EntryGuess, SeenLog
from sysid.first_look.templates import Template
from sysid.first_look.words import AxleLabel

#: Size of an axle's acceleration over the largest of the log from which the axle itself was driven over something.
_STRUCK = 0.35
#: Steadiness of the axles' accelerations from which a log is a drive over a road.
_STEADY = 0.3
#: How clearly an axle must rise or fall first, and how long axles after each other take at least [s].
_CLEAR, _ONE_AFTER_THE_OTHER_S = 0.3, 0.12
#: |ln| between the speed that a name says and that of the arrivals from which they contradict each other.
_SPEEDS = 0.12


@dataclass(frozen=True)
class KindOfTest:
    """Drop, run or drive, whether name and behaviour agree, and why."""

    kind: TestKind
    sure: bool
    why: str


@dataclass(frozen=True)
class Driven:
    """What is known of the truck where it was driven.

    - `timed` maps files of runs to the arrival [s] of every axle;
    - `positions_m` of the axles;
    - `labels` maps labels of axles to axles; `named` and `axle_of` columns, by name and by arrival;
    - `agree`: whether these two do;
    - `logged_km_h` maps files to the speed that a sensor shows;
    - `trusted`: whether positions do not come from a guessed template.
    """

    timed: Mapping[str, Mapping[int, float]]
    positions_m: tuple[float, ...] | None
    labels: Mapping[AxleLabel, int]
    named: Mapping[str, int]
    template: Template | None
    axles: int
    axle_of: Mapping[str, int]
    agree: bool
    logged_km_h: Mapping[str, float]
    trusted: bool


def kind_of_test(log: SeenLog, kinds: Mapping[str, KindGuess]) -> KindOfTest:
    """Whether a log is a drop, a run or a drive over a road: its path against the way in which its axles move."""
    by_name, by_motion = log.said.kind, _motion(log, kinds)
    if by_name == "bump_run" and by_motion == "road_drive":
        # Names of runs and drives have the same words.
        by_name = "road_drive"
    if by_name is not None and by_motion is not None:
        if by_name == by_motion:
            return KindOfTest(by_name, True, "name and behaviour agree")
        return KindOfTest(by_name, False, f"its name says {_WORDS[by_name]}, its axles move as in {_WORDS[by_motion]}")
    if by_motion is not None:
        return KindOfTest(by_motion, False, f"its axles move as in {_WORDS[by_motion]}")
    if by_name is not None:
        return KindOfTest(by_name, False, f"{_WORDS[by_name]} by its name alone")
    return KindOfTest("bump_run", False, "neither name nor behaviour say what it is")


_WORDS: dict[TestKind, str] = {"plank_drop": "a drop", "bump_run": "a run", "road_drive": "a drive over a road"}


def struck_columns(log: SeenLog, kinds: Mapping[str, KindGuess]) -> list[str]:
    """Columns of axle accelerations that move about as much as the largest of the log, largest first."""
    axles = [x for x in log.looks if x.alive and kinds[x.name].kind == "axle_acceleration"]
    largest = max((x.size for x in axles), default=0.0)
    axles = [x for x in axles if x.size > _STRUCK * largest]
    return [x.name for x in sorted(axles, key=lambda x: -x.size)]


def _motion(log: SeenLog, kinds: Mapping[str, KindGuess]) -> TestKind | None:
    struck = set(struck_columns(log, kinds))
    steady = [x.steady for x in log.looks if x.name in struck]
    if steady and float(np.median(steady)) > _STEADY:
        return "road_drive"
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
    up: dict[SensorKind | None, int] = {"suspension_deflection": -1, "axle_acceleration": 1, "body_acceleration": 1}
    moving = [(x, kinds[x.name]) for x in log.looks if x.alive]
    lifts = [x.lift * guess.sign * up[guess.kind] for x, guess in moving if guess.kind in up]
    lift = float(np.median(lifts))
    if abs(lift) < _CLEAR:
        return None
    return "bump_run" if lift > 0.0 else "plank_drop"


def entries_of(
    logs: Sequence[tuple[SeenLog, Mapping[str, KindGuess]]],
    kinds: Mapping[str, KindOfTest],
    cases: LoadCases,
    driven: Driven,
) -> tuple[EntryGuess, ...]:
    """Drops in the order of their axles, then runs and drives, each in the order of load case and speed."""
    result = []
    for log, of_columns in logs:
        kind, case = kinds[log.file], cases.of_file[log.file]
        axle: int | None = None
        speed: float | None = None
        if kind.kind == "plank_drop":
            axle, sure, reasons = _drop_axle(log, of_columns, driven)
        else:
            speed, sure, reasons = _speed(log, driven)
        why = (*(() if kind.sure else (kind.why,)), *case.why, *reasons)
        sure = sure and kind.sure and not case.why and case.name is not None
        result.append(EntryGuess(log.file, kind.kind, case.name, axle, speed, sure, why))
    order = [*cases.names, None]
    return tuple(sorted(result, key=lambda e: _in_list(e, order)))


_ORDER: tuple[TestKind, ...] = ("plank_drop", "bump_run", "road_drive")


def _in_list(entry: EntryGuess, cases: Sequence[str | None]) -> tuple[int, int, int, float, str]:
    of_axle, of_case = 99 if entry.axle is None else entry.axle, cases.index(entry.load_case)
    drop = entry.kind == "plank_drop"
    first, second = (of_axle, of_case) if drop else (of_case, 0)
    return _ORDER.index(entry.kind), first, second, entry.speed_km_h or 0.0, entry.file


def _drop_axle(log: SeenLog, kinds: Mapping[str, KindGuess], driven: Driven) -> tuple[int | None, bool, list[str]]:
    """Axle on the plank, whether name and motion agree where both can speak, and reasons."""
    by_name, name_says = _axle_of_path(log.said.axle, driven)
    columns = [x.name for x in log.looks if kinds[x.name].kind == "axle_acceleration"]
    struck = struck_columns(log, kinds)
    by_motion = None
    if len(columns) > 1 and struck:
        by_motion = driven.axle_of.get(struck[0], driven.named.get(struck[0]))
    of_columns = {driven.named[x.name] for x in log.looks if x.name in driven.named and kinds[x.name].kind}
    by_columns = of_columns.pop() if len(of_columns) == 1 else None
    if by_name is not None:
        against = [f"axle {by_motion + 1} moves most"] if by_motion not in (None, by_name) else []
        if by_motion is None and by_columns not in (None, by_name):
            against.append(f"its columns are named for axle {by_columns + 1}")
        if by_motion == by_name and not driven.agree and by_columns != by_name:
            against.append("names and arrivals of the axles do not agree")
        if name_says and by_motion != by_name and by_columns != by_name:
            against.append(name_says)
        # Where the sensors sit at the axle under test, nothing but names can say which that was.
        by_name_alone = [AXLE_BY_NAME] if by_motion is None and not against else []
        return by_name, not against, against or by_name_alone
    if by_motion is not None:
        return by_motion, False, ["the axle that moves most"]
    if by_columns is not None:
        return by_columns, False, ["axle by the names of its columns alone"]
    return None, False, ["axle not known"]


#: Reason of a drop whose axle the name of its file says, and nothing else can.
AXLE_BY_NAME = "axle by its name"
#: The same of the speed of a run whose axles and sensors do not tell it.
SPEED_BY_NAME = "speed by its name alone"


def _axle_of_path(label: AxleLabel, driven: Driven) -> tuple[int | None, str]:
    """Axle that a path says, and why that needs another sign of it, empty if it does not."""
    axle = driven.labels.get(label)
    if axle is not None:
        return (axle, "") if axle < max(driven.axles, 1) else (None, "")
    if label.place is None or label.number is not None:
        return None, ""
    if label.place == "rear" and driven.axles == 2:
        return 1, ""
    there = [i for i, p in enumerate(driven.template.places) if p == label.place] if driven.template else []
    return (there[0], f"the {label.place} axle by the template") if len(there) == 1 else (None, "")


#: Factors to km/h of units in which people give speeds without saying them.
_UNITS_OF_SPEEDS = {"km/h": 1.0, "mph": 1.609344, "m/s": 3.6}


def _speed(log: SeenLog, driven: Driven) -> tuple[float | None, bool, list[str]]:
    """Speed [km/h], whether two of name, arrivals and sensor agree on it and none contradicts, and reasons."""
    times = driven.timed.get(log.file, {})
    seen: dict[str, float] = {}
    if log.file in driven.logged_km_h:
        seen["its speed sensor shows {:.1f} km/h"] = driven.logged_km_h[log.file]
    if driven.positions_m is not None and len(times) > 1 and (speed := speed_m_s(times, driven.positions_m)):
        seen["its axles arrive as at {:.1f} km/h"] = 3.6 * speed
    named = log.said.speed_km_h
    if named is None:
        return _unnamed_speed(list(seen.values()), log.file in driven.logged_km_h, driven.trusted)
    doubt = []
    if not log.said.speed_unit_said:
        units = {u: named * f for u, f in _UNITS_OF_SPEEDS.items() if all(_alike(named * f, v) for v in seen.values())}
        unit = next(iter(units), None) if seen else None
        if unit != "km/h":
            doubt = [f"{named:g} {unit} by the other signs of its speed" if unit else "its name does not say km/h"]
        named = round(units[unit], 1) if unit else named
    against = [text.format(value) for text, value in seen.items() if not _alike(named, value)]
    return (
        named,
        bool(seen) and not against and not doubt,
        [*doubt, *against] or [] if seen else [*doubt, SPEED_BY_NAME],
    )


def _alike(one: float, other: float) -> bool:
    return abs(float(np.log(one / other))) < _SPEEDS


def _unnamed_speed(seen: Sequence[float], logged: bool, trusted: bool) -> tuple[float | None, bool, list[str]]:
    """Speed of a run whose name says none: by its sensor, else by arrivals."""
    if not seen:
        return None, False, ["speed not known"]
    if len(seen) == 2:
        agree = _alike(*seen)
        return round(seen[0], 1), agree, [] if agree else [f"its axles arrive as at {seen[1]:.1f} km/h"]
    of_what = "its speed sensor alone" if logged else f"arrivals and {'' if trusted else 'guessed '}axle positions"
    return round(seen[0], 1), False, [f"speed by {of_what}"]
