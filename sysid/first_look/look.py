"""A first look at the folder of a logger: what lies there, what each column measures, what was driven."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from sysid.campaign.records import AUXILIARY_KINDS, KIND_DIMENSION, SensorKind
from sysid.errors import CampaignError, DataRejectedError, SysidError
from sysid.first_look.column_words import NameSays, columns_say
from sysid.first_look.entries import Driven, entries_of, kind_of_test
from sysid.first_look.features import Threes, looks, threes
from sysid.first_look.file_words import PathSays, paths_say
from sysid.first_look.folder import names_in, opened
from sysid.first_look.kinds import KindGuess, may_move
from sysid.first_look.layouts import Layout, layouts_of_logs, logged_speeds, righted
from sysid.first_look.load_cases import load_cases_of
from sysid.first_look.log_columns import LogColumns, read_columns_of
from sysid.first_look.loggers import find_loggers, joined_logs
from sysid.first_look.places import (
    Order,
    Passage,
    arrival_order,
    axle_times,
    axles_of_ranks,
    counted_from_one,
    in_order,
    measured_positions,
    misfit,
    numbered_axles,
)
from sysid.first_look.records import FirstLook, SeenLog, SeenScan
from sysid.first_look.scans import seen_profile, seen_scan
from sysid.first_look.sensor_guesses import sensor_guesses
from sysid.first_look.templates import Template, template, template_names
from sysid.progress import Progress, unwatched
from sysid.wording import shorten

#: Largest difference between shares of the passage at which a template fits the arrivals.
_FITS = 0.12
#: Logs with the same columns whose threes are compared, and logs altogether: more say nothing new and take memory.
_FITTED_ALIKE, _FITTED = 30, 300

_OF_AXLES = KIND_DIMENSION.keys() - AUXILIARY_KINDS


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
    seen = find_loggers(logs)
    if seen is None:
        return _first_look(layouts_of_logs(logs, fits), logs, scans, messages, wanted)
    logs, fits, columns = joined_logs(logs, fits, seen)
    look = _first_look(layouts_of_logs(logs, fits, seen.files), logs, scans, messages, wanted)
    # What one logger calls axle 1, the other calls axle 1 too: only a person knows which it is.
    why = "another logger has a column of this name"
    sensors = tuple(
        replace(s, axle=None, sure=False, why=(*s.why, why))
        if s.column in columns and columns[s.column][1] != s.column
        else s
        for s in look.run_sensors
    )
    return replace(look, run_sensors=sensors, loggers=seen.loggers, files=seen.files, columns=columns)


def _files(folder: Path, progress: Progress) -> tuple[list[SeenLog], dict[str, Threes], list[SeenScan], list[str]]:
    logs: list[SeenLog] = []
    fits: dict[str, Threes] = {}
    counts: Counter[frozenset[str]] = Counter()
    scans: list[SeenScan] = []
    names, messages = names_in(folder)
    said = paths_say(names)
    of_columns: dict[frozenset[str], dict[str, NameSays]] = {}
    told: list[tuple[str, str]] = []
    for i, name in enumerate(names):
        progress("reading files", i / len(names))
        try:
            file = opened(folder, name)
            if file is None or file.what == "other":
                continue
            if file.what == "scan":
                scans.append(seen_scan(file))
                continue
            if file.what == "profile":
                scans.append(seen_profile(file))
                continue
            columns = read_columns_of(file)
        except SysidError as error:
            messages.append(str(error))
            continue
        told += [(name, sentence) for sentence in columns.messages]
        log = _seen(columns, said[name])
        logs.append(log)
        layout = frozenset(log.columns)
        if len(fits) < _FITTED and counts[layout] < _FITTED_ALIKE:
            if layout not in of_columns:
                of_columns[layout] = columns_say(log.columns)
            moving = [k for k, x in enumerate(log.looks) if may_move(x, of_columns[layout][x.name])]
            fit = threes([columns.channels[k] for k in moving], [log.looks[k] for k in moving])
            if fit is not None:
                fits[name] = fit
                counts[layout] += 1
    if not logs:
        label = shorten(folder, 100)
        if messages:
            more = f" ({len(messages)} files cannot be read; the last one: {messages[-1]})"
            raise DataRejectedError(f"{label} holds no log that can be read{more}")
        raise CampaignError(f"{label} holds no logs; give the folder into which the logger wrote.")
    return logs, fits, scans, [*messages, *_once(told)]


def _once(told: Sequence[tuple[str, str]]) -> list[str]:
    """Sentences about files, each once for all files of which it is said with other numbers."""
    files: dict[str, list[str]] = {}
    for name, sentence in told:
        alike = re.sub(r"\d+(?:\.\d+)?(?:e[-+]\d+)?", "#", sentence.removeprefix(shorten(name, 100)))
        files.setdefault(alike, []).append(sentence)
    more = {1: "", 2: " The same holds for one more file."}
    return [of[0] + more.get(len(of), f" The same holds for {len(of) - 1} more files.") for of in files.values()]


def _seen(columns: LogColumns, said: PathSays) -> SeenLog:
    of_columns = looks(columns.channels)
    starts = [float(t[0]) for c in columns.channels if (t := c.clock.time_s[np.isfinite(c.clock.time_s)]).size]
    start = min(starts, default=0.0)
    return SeenLog(columns.file, columns.title, of_columns, columns.time, columns.text, said, start)


def _first_look(
    layouts: Sequence[Layout],
    logs: Sequence[SeenLog],
    scans: Sequence[SeenScan],
    messages: list[str],
    wanted: Template | None,
) -> FirstLook:
    kinds = {log.file: kind_of_test(log, layout.kinds) for layout in layouts for log in layout.logs}
    layouts = [righted(layout, [x for x in layout.logs if kinds[x.file].kind == "bump_run"]) for layout in layouts]
    left_out = {log.file: f"its name says '{log.said.no_test}'" for log in logs if _is_no_test(log, layouts)}
    tested = [log for log in logs if log.file not in left_out]
    cases = load_cases_of({log.file: log.said for log in tested})
    passages = {
        log.file: _passage(log, layout.kinds)
        for layout in layouts
        for log in layout.logs
        if kinds[log.file].kind == "bump_run" and log.file not in left_out
    }
    order = arrival_order([p for p in passages.values() if len(p.arrival_s) > 1])
    run_layouts = [k for k in layouts if any(kinds[log.file].kind != "plank_drop" for log in k.logs)]
    drop_layouts = [k for k in layouts if any(kinds[log.file].kind == "plank_drop" for log in k.logs)]
    # A pressure is at an axle that others have: only what moves with an axle counts them.
    said = _sensors_said(run_layouts or layouts, order, _OF_AXLES)
    from_one = counted_from_one(s.axle for s in said.values())
    of_drops = counted_from_one(log.said.axle for log in tested if kinds[log.file].kind == "plank_drop")
    labels = numbered_axles([*from_one.values(), *of_drops.values()], len(order.share))
    at_axles = _sensors_said(layouts, order, {*_OF_AXLES, "air_pressure"})
    of_columns = {c: from_one.get(s.axle, s.axle) for c, s in at_axles.items()}
    named = {c: labels[label] for c, label in of_columns.items() if label in labels}
    count = len(wanted.axles) if wanted else max(len(order.share), *(n + 1 for n in labels.values()), 0)
    labels = {path: labels[label] for path, label in of_drops.items() if label in labels}
    from_zero = any(s.axle.number == 0 for s in said.values()) and not any(a.number == 0 for a in of_drops)
    if from_zero and not any(a.number == count for a in of_drops):
        # Columns count from 0, and nothing says from where the paths do.
        labels = {path: axle for path, axle in labels.items() if path.number is None}
    chosen = wanted or _fitting(count, order)
    axle_of, agree = _axle_columns(order, named, count, chosen)
    run_sensors = sensor_guesses(run_layouts, named, axle_of, agree, drops=False)
    drop_sensors = sensor_guesses(drop_layouts, named, axle_of, agree, drops=True)
    speeds = {log.file: log.said.speed_km_h for log in logs}
    timed = {file: axle_times(p, axle_of) for file, p in passages.items()}
    known = [(timed[f], speed / 3.6) for f, speed in speeds.items() if speed is not None and f in timed]
    measured = measured_positions(known, count) if count > 1 else None
    positions = measured if wanted is None and measured is not None else chosen.positions_m if chosen else None
    trusted = wanted is not None or measured is not None
    driven = Driven(timed, positions, labels, named, chosen, count, axle_of, agree, logged_speeds(layouts), trusted)
    listed = [(log, k.kinds) for k in layouts for log in k.logs if log.file not in left_out]
    entries = entries_of(listed, kinds, cases, driven)
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
        load_cases=cases.names,
        text_columns=tuple(sorted({c for log in logs for c in log.text if c})),
        left_out=left_out,
        messages=tuple(messages),
    )


def _is_no_test(log: SeenLog, layouts: Sequence[Layout]) -> bool:
    """Whether the path of a log says that it is no test, and no axle of it moves."""
    if log.said.no_test is None:
        return False
    kinds = next(layout.kinds for layout in layouts if log in layout.logs)
    return not any(look.alive and kinds[look.name].kind == "axle_acceleration" for look in log.looks)


def _sensors_said(layouts: Sequence[Layout], order: Order, kinds: Collection[SensorKind]) -> dict[str, NameSays]:
    """What the names of sensors of these kinds say.

    Numbers beyond the axles that arrive count sensors, if no word for axle stands at them.
    """
    said = {c: layout.said[c] for layout in layouts for c, guess in layout.kinds.items() if guess.kind in kinds}
    free = [s.axle.number for s in said.values() if s.axle.number is not None and not s.numbered]
    axles = [s.axle.number for s in said.values() if s.axle.number is not None and s.numbered]
    if len(order.share) < 2 or not free or max(free) <= max([len(order.share), *axles]):
        return said
    return {c: s if s.numbered else replace(s, axle=s.axle._replace(number=None)) for c, s in said.items()}


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
