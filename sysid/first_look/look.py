"""A first look at the folder of a logger: what lies there, what each column measures, what was driven."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sysid.errors import CampaignError, DataRejectedError, SysidError
from sysid.first_look.entries import Driven, entries_of, kind_of_test, load_cases_of
from sysid.first_look.features import Threes, looks, threes
from sysid.first_look.file_words import TestKind, path_says
from sysid.first_look.folder import names_in, opened
from sysid.first_look.kinds import KindGuess, guess_kinds, told_dimensions
from sysid.first_look.log_columns import LogColumns, read_columns_of
from sysid.first_look.matching import Three, matched_threes, upright
from sysid.first_look.places import (
    Order,
    Passage,
    arrival_order,
    axle_times,
    axles_of_ranks,
    in_order,
    measured_positions,
    misfit,
    named_axles,
)
from sysid.first_look.records import FirstLook, SeenLog, SeenScan, SensorGuess
from sysid.first_look.scans import seen_scan
from sysid.first_look.templates import Template, template, template_names
from sysid.first_look.words import NameSays, column_says, paired_sides
from sysid.progress import Progress, unwatched
from sysid.wording import shorten

#: Largest difference between shares of the passage at which a template fits the arrivals.
_FITS = 0.12
#: How clearly all sensors of an axle must move the wrong way, in the middle of all runs.
_FALLS = 0.5
#: Logs with the same columns whose threes are compared, and logs altogether: more say nothing new and take memory.
_FITTED_ALIKE, _FITTED = 30, 300


@dataclass(frozen=True)
class _Layout:
    """Logs with the same columns, the kind of every column, and threes of columns that belong to one axle."""

    logs: tuple[SeenLog, ...]
    kinds: Mapping[str, KindGuess]
    said: Mapping[str, NameSays]
    found: tuple[Three, ...]


def first_look(folder: Path, vehicle: str | None = None, progress: Progress = unwatched) -> FirstLook:
    """Look at all files of a folder and guess what they are.

    Parameters
    ----------
    folder
        Folder of the logger, with its subfolders.
    vehicle
        Name of a template; None: the one that fits number and arrivals of the axles best.
    progress
        Callback (message, fraction).

    Raises
    ------
    CampaignError
        If it is no folder, there is no such vehicle, or the folder holds no logs or too many files.
    DataRejectedError
        If none of its logs can be read.
    """
    wanted = None if vehicle is None else template(vehicle)
    logs, fits, scans, messages = _files(folder, progress)
    layouts = _layouts(logs, fits)
    return _found(layouts, logs, scans, messages, wanted)


def _files(folder: Path, progress: Progress) -> tuple[list[SeenLog], dict[str, Threes], list[SeenScan], list[str]]:
    logs: list[SeenLog] = []
    fits: dict[str, Threes] = {}
    counts: Counter[frozenset[str]] = Counter()
    scans: list[SeenScan] = []
    messages: list[str] = []
    names = names_in(folder)
    refused: SysidError | None = None
    for i, name in enumerate(names):
        progress("reading files", i / len(names))
        try:
            file = opened(folder, name)
            if file is None or file.what == "other":
                continue
            if file.what == "scan":
                scans.append(seen_scan(file))
                continue
            columns = read_columns_of(file)
        except SysidError as error:
            refused = error
            messages.append(str(error))
            continue
        log = _seen(columns)
        logs.append(log)
        layout = frozenset(log.columns)
        if len(fits) < _FITTED and counts[layout] < _FITTED_ALIKE:
            fit = threes(columns.channels, log.looks)
            if fit is not None:
                fits[name] = fit
                counts[layout] += 1
    if not logs:
        label = shorten(folder, 100)
        if refused is not None:
            more = f" ({len(messages)} files cannot be read; the last one: {refused})"
            raise DataRejectedError(f"{label} holds no log that can be read{more}")
        raise CampaignError(f"{label} holds no logs; give the folder into which the logger wrote.")
    return logs, fits, scans, messages


def _seen(columns: LogColumns) -> SeenLog:
    said = path_says(columns.file)
    of_columns = looks(columns.channels)
    return SeenLog(columns.file, columns.title, of_columns, columns.time, columns.units_row, columns.text, said)


def _layouts(logs: Sequence[SeenLog], fits: Mapping[str, Threes]) -> list[_Layout]:
    groups: dict[frozenset[str], list[SeenLog]] = {}
    for log in logs:
        groups.setdefault(frozenset(log.columns), []).append(log)
    result = []
    for columns, members in groups.items():
        seen = {c: [look for log in members for look in log.looks if look.name == c] for c in sorted(columns)}
        alive = {c: [look for look in of_logs if look.alive] or of_logs for c, of_logs in seen.items()}
        hop = {c: float(np.median([look.hop_share for look in of_logs])) for c, of_logs in alive.items()}
        sides = paired_sides(sorted(columns))
        said = {c: column_says(c) for c in columns}
        said = {c: replace(s, side=s.side or sides.get(c)) for c, s in said.items()}
        of_members = [fits[log.file] for log in members if log.file in fits]
        kinds = {c: s.kind for c, s in said.items()}
        found = tuple(upright(t, kinds) for t in matched_threes(of_members, hop, told_dimensions(alive, said)))
        result.append(_Layout(tuple(members), guess_kinds(alive, said, found), said, found))
    return result


def _found(
    layouts: Sequence[_Layout],
    logs: Sequence[SeenLog],
    scans: Sequence[SeenScan],
    messages: list[str],
    wanted: Template | None,
) -> FirstLook:
    kinds = {log.file: kind_of_test(log, layout.kinds) for layout in layouts for log in layout.logs}
    layouts = [_righted(layout, [x for x in layout.logs if kinds[x.file].kind == "bump_run"]) for layout in layouts]
    cases, case_of = load_cases_of(logs)
    passages = {
        log.file: _passage(log, layout.kinds)
        for layout in layouts
        for log in layout.logs
        if kinds[log.file].kind == "bump_run"
    }
    order = arrival_order([p for p in passages.values() if len(p.arrival_s) > 1])
    run_layouts = [k for k in layouts if any(kinds[log.file].kind == "bump_run" for log in k.logs)]
    drop_layouts = [k for k in layouts if any(kinds[log.file].kind == "plank_drop" for log in k.logs)]
    named = named_axles(_sensors_said(run_layouts or layouts))
    count = len(wanted.axles) if wanted else max(len(order.share), *(n + 1 for n in named.values()), _dropped(logs))
    chosen = wanted or _fitting(count, order)
    axle_of, agree = _axle_columns(order, named, count, chosen)
    run_sensors = _sensors(run_layouts, named, axle_of, agree, count, drops=False)
    drop_sensors = _sensors(drop_layouts, named, axle_of, agree, count, drops=True)
    speeds = {log.file: log.said.speed_km_h for log in logs}
    timed = {file: axle_times(p, axle_of) for file, p in passages.items()}
    known = [(timed[f], speed / 3.6) for f, speed in speeds.items() if speed is not None and f in timed]
    measured = measured_positions(known, count) if count > 1 else None
    positions = measured if wanted is None and measured is not None else chosen.positions_m if chosen else None
    driven = Driven(timed, positions, named, chosen, count, axle_of, trusted=wanted is not None or measured is not None)
    entries = entries_of(layouts_of(layouts), kinds, case_of, driven)
    return FirstLook(
        logs=tuple(logs),
        scans=tuple(scans),
        run_sensors=run_sensors,
        drop_sensors=drop_sensors,
        tests=entries,
        template=chosen,
        template_given=wanted is not None,
        axles=count,
        positions_m=positions,
        measured_m=measured,
        load_cases=cases,
        unused=_unused(layouts, (*run_sensors, *drop_sensors)),
        messages=tuple(messages),
    )


def layouts_of(layouts: Sequence[_Layout]) -> list[tuple[SeenLog, Mapping[str, KindGuess]]]:
    """Every log with the kinds of its columns."""
    return [(log, layout.kinds) for layout in layouts for log in layout.logs]


def _sensors_said(layouts: Sequence[_Layout]) -> dict[str, NameSays]:
    return {c: layout.said[c] for layout in layouts for c, guess in layout.kinds.items() if guess.kind is not None}


def _dropped(logs: Sequence[SeenLog]) -> int:
    """Number of axles that the paths of drops name."""
    numbers = [log.said.axle for log in logs if log.said.kind == "plank_drop" and log.said.axle is not None]
    return max(numbers) + (0 in numbers) if numbers else 0


def _righted(layout: _Layout, runs: Sequence[SeenLog]) -> _Layout:
    """The layout with all sensors of an axle turned that falls where an axle meets a bump."""
    kinds = dict(layout.kinds)
    for three in layout.found:
        up = {three.deflection: -1, three.axle: 1} | ({three.body: 1} if three.body else {})
        lifts = [
            float(np.mean([look.lift * kinds[look.name].sign * up[look.name] for look in log.looks if look.name in up]))
            for log in runs
        ]
        if lifts and float(np.median(lifts)) < -_FALLS:
            for column in up:
                guess = kinds[column]
                why = (*guess.why, "all sensors of this axle move as if it fell where it meets the bump")
                kinds[column] = replace(guess, sign=-guess.sign, sure=False, why=why)
    return replace(layout, kinds=kinds)


def _passage(log: SeenLog, kinds: Mapping[str, KindGuess]) -> Passage:
    return Passage(
        log.file,
        {
            look.name: look.arrival_s
            for look in log.looks
            if look.alive and look.arrival_s is not None and kinds[look.name].kind == "axle_acceleration"
        },
    )


def _fitting(count: int, order: Order) -> Template | None:
    """The template with this number of axles whose positions fit the arrivals best."""
    known = [t for t in map(template, template_names()) if len(t.axles) == count]
    if not known:
        return None
    if len(order.share) != count or count < 3:
        return known[0]
    best = min(known, key=lambda t: misfit(order.share, t.positions_m))
    return best if misfit(order.share, best.positions_m) < _FITS or len(known) == 1 else known[0]


def _axle_columns(
    order: Order, named: Mapping[str, int], count: int, chosen: Template | None
) -> tuple[dict[str, int], bool]:
    """Axle of every column that arrives, and whether names and arrivals say the same."""
    by_name = {c: named[c] for c in order.rank if c in named}
    if by_name and len(by_name) == len(order.rank):
        agree = in_order(by_name, order.rank) and (len(order.share) < count or by_name == dict(order.rank))
        # Fewer arrivals than axles: axles on a beam move before they arrive, and their order says little.
        if agree or len(order.share) < len(set(by_name.values())):
            return by_name, agree
    places = axles_of_ranks(order.share, chosen.positions_m) if chosen else tuple(range(len(order.share)))
    return {c: places[rank] for c, rank in order.rank.items()}, False


def _sensors(
    layouts: Sequence[_Layout],
    named: Mapping[str, int],
    axle_of: Mapping[str, int],
    agree: bool,
    count: int,
    *,
    drops: bool,
) -> tuple[SensorGuess, ...]:
    """One guess per column of the logs of runs, or of drops."""
    result: dict[str, SensorGuess] = {}
    for layout in layouts:
        of_three = {c: t.axle for t in layout.found for c in (t.deflection, t.axle, t.body) if c}
        alone = Counter(g.kind for g in layout.kinds.values() if g.kind is not None)
        for column, guess in layout.kinds.items():
            if guess.kind is None and guess.sure:
                continue
            said = layout.said[column]
            why = list(guess.why)
            if drops and guess.kind is not None and alone[guess.kind] == 1:
                # Mounted at the axle under test: the list of drops says which.
                axle, axle_sure = None, True
            else:
                axle, axle_sure = _axle_of_column(column, of_three.get(column, column), named, axle_of, agree, why)
            sensor = SensorGuess(
                column, guess.kind, guess.unit, guess.sign, axle, said.side, guess.sure and axle_sure, tuple(why)
            )
            before = result.setdefault(column, sensor)
            if (before.kind, before.unit, before.sign) != (sensor.kind, sensor.unit, sensor.sign):
                result[column] = replace(before, sure=False, why=(*before.why, "other logs look different"))
    return tuple(sorted(result.values(), key=_place_in_list))


def _axle_of_column(
    column: str, axle_column: str, named: Mapping[str, int], axle_of: Mapping[str, int], agree: bool, why: list[str]
) -> tuple[int | None, bool]:
    """Axle of a column, and whether its name and the arrivals say the same."""
    by_name, by_arrival = named.get(column), axle_of.get(axle_column)
    if by_name is not None and by_arrival is not None:
        if by_name == by_arrival and agree:
            return by_name, True
        unlike = f"axle by arrival; its name says {by_name + 1}"
        why.append(unlike if by_name != by_arrival else "names and arrivals of the axles do not agree")
        return by_arrival, False
    if by_arrival is not None:
        why.append(f"axle by arrival: {_ordinal(by_arrival)}")
        return by_arrival, False
    if by_name is not None:
        why.append("axle by its name alone")
        return by_name, False
    why.append("axle not known")
    return None, False


def _ordinal(index: int) -> str:
    return f"{index + 1}{({0: 'st', 1: 'nd', 2: 'rd'}).get(index, 'th')}"


def _place_in_list(sensor: SensorGuess) -> tuple[int, int, str]:
    kinds = ("suspension_deflection", "axle_acceleration", "body_acceleration")
    rank = kinds.index(sensor.kind) if sensor.kind in kinds else len(kinds)
    return rank, 99 if sensor.axle is None else sensor.axle, sensor.column


def _unused(layouts: Sequence[_Layout], used: Sequence[SensorGuess]) -> dict[str, str]:
    names = {s.column for s in used}
    result: dict[str, str] = {}
    for layout in layouts:
        for column, guess in layout.kinds.items():
            if column not in names:
                result[column] = "; ".join(guess.why)
        for log in layout.logs:
            result |= {c: "text, no numbers" for c in log.text if c}
    return dict(sorted(result.items()))


__all__ = ["TestKind", "first_look"]
