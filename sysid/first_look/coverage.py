"""What was driven, as a table in which holes are seen: drops by axle, runs and drives by speed, each by load case."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.display import TextTable
from sysid.first_look.records import EntryGuess, FirstLook
from sysid.wording import shorten

#: Load cases that are shown, and columns of a terminal for them.
_CASES, _WIDTH = 8, 80 - 22
#: Ratio of speeds that count as one.
_SAME_SPEED = 1.08


def coverage_table(look: FirstLook) -> TextTable:
    """Number of drops by axle and load case, and of runs by speed and load case: holes are seen at once.

    "1 + 2?" are one that is known and two that are to be confirmed, which may belong elsewhere.
    """
    unknown = [None] * any(entry.load_case is None for entry in look.tests)
    cases: list[str | None] = [*list(look.load_cases)[:_CASES], *unknown]
    # The whole table has room in 80 columns.
    width = max(5, _WIDTH // max(1, len(cases)) - 2)
    table = TextTable("Drops and runs", ("", *(shorten(c or "load case ?", width) for c in cases)))
    drops = [e for e in look.tests if e.kind == "plank_drop"]
    runs, drives = ([e for e in look.tests if e.kind == kind] for kind in ("bump_run", "road_drive"))
    axles: list[int | None] = [*range(look.axles)] if drops else []
    axles += [None] * any(e.axle is None for e in drops)
    rows = [(f"drops, axle {'?' if a is None else a + 1}", [e for e in drops if e.axle == a]) for a in axles]
    rows += [(f"runs, {speed} km/h", of_speed) for speed, of_speed in _by_speed(runs)]
    rows = [*([] if drops else [("drops", [])]), *rows, *([] if runs else [("runs", [])])]
    rows += [(f"drives, {speed} km/h", of_speed) for speed, of_speed in _by_speed(drives)]
    for title, entries in rows:
        table.add_row(title, *(_cell([e for e in entries if e.load_case == case]) for case in cases))
    return table


def _cell(entries: Sequence[EntryGuess]) -> str:
    """How many: those known, and with a question mark those to be confirmed."""
    known = sum(e.sure for e in entries)
    open_ = len(entries) - known
    return " + ".join([str(known)] * (known > 0) + [f"{open_}?"] * (open_ > 0)) or "none"


def _by_speed(runs: Sequence[EntryGuess]) -> list[tuple[str, list[EntryGuess]]]:
    """Runs of about the same speed, slowest first; those of unknown speed last."""
    groups: list[list[EntryGuess]] = []
    for run in sorted((r for r in runs if r.speed_km_h is not None), key=lambda r: r.speed_km_h or 0.0):
        if groups and (run.speed_km_h or 0.0) < _SAME_SPEED * (groups[-1][0].speed_km_h or 0.0):
            groups[-1].append(run)
        else:
            groups.append([run])
    result = [(f"{float(np.median([r.speed_km_h or 0.0 for r in group])):.3g}", group) for group in groups]
    unknown = [r for r in runs if r.speed_km_h is None]
    return [*result, *([("?", unknown)] if unknown else [])]
