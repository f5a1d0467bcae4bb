"""Faults of the files themselves: damaged cells, stamps and heads, logs in the wrong place, logs that are not there."""

from __future__ import annotations

import io
import re
from collections.abc import Callable

import numpy as np
import pandas as pd

from studies.check_faults.made import EVERYWHERE, Fault, Made, a_column, change_table, drop_lines
from studies.faults.campaign_copy import CampaignCopy, DoesNotApply

_ALL = frozenset([EVERYWHERE])
#: Files that mean the same: no reading changes.
SAME_READINGS = "the readings are the same"


def _a_run(c: CampaignCopy) -> str:
    return c.pick(c.files("bump_runs"))


def text(what: str, words: str, change: Callable[[str], str | bytes], harmless: str = "") -> Fault:
    """The text of one run is another one."""

    def fault(c: CampaignCopy) -> Made:
        file = _a_run(c)
        path = c.folder / file
        changed = change(path.read_text(encoding="utf-8"))
        path.write_bytes(changed.encode() if isinstance(changed, str) else changed)
        said = words if harmless else f"{re.escape(file)}.*({words})"
        return Made(f"{file}: {what}", (said,), _ALL, harmless)

    return fault


def rows(what: str, words: str, change: Callable[[pd.DataFrame, np.random.Generator], pd.DataFrame]) -> Fault:
    """The rows of one run are others."""

    def fault(c: CampaignCopy) -> Made:
        file = _a_run(c)
        change_table(c, lambda t: change(t, c.rng), [file])
        return Made(f"{file}: {what}", (f"{re.escape(file)}.*({words})",), _ALL)

    return fault


def cells(what: str, words: str, entry: str, share: float) -> Fault:
    """Some cells of one column of one run hold something that is no number."""

    def fault(c: CampaignCopy) -> Made:
        file, column = _a_run(c), a_column(c)
        path = c.folder / file
        table = pd.read_csv(path, dtype=str)
        count = max(1, int(share * len(table)))
        table.loc[c.rng.choice(len(table), count, replace=False), column] = entry
        table.to_csv(path, index=False)
        said = f"({re.escape(file)}.*|{column}.*)({words})"
        return Made(f"{count} cells of {column} in {file} {what}", (said,), frozenset([column]))

    return fault


def _jitter(t: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    time = t.columns[0]
    step = float(t[time].diff().median())
    return t.assign(**{time: t[time] + step * rng.uniform(-0.45, 0.45, len(t))})


def _backward(t: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    """A block of stamps runs behind those before it, as of a clock that was set back."""
    time, middle = t.columns[0], len(t) // 2
    return t.assign(**{time: t[time] - 0.5 * (np.arange(len(t)) > middle)})


def _twice(t: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    """Twenty rows in the middle stand twice."""
    middle = len(t) // 2
    return pd.concat([t.head(middle + 20), t.tail(len(t) - middle)], ignore_index=True)


def _gap(t: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    """0.4 s of rows are missing where the truck moves."""
    size = t["axle1_accel_g"].abs().fillna(0.0).to_numpy()
    first = int(np.argmax(size)) + 10
    return t.drop(index=range(first, min(first + 80, len(t) - 1)))


def _decimal_commas(text: str) -> str:
    table = pd.read_csv(io.StringIO(text), dtype=str)
    return table.to_csv(index=False, sep=";").replace(".", ",")


def _units_row(text: str) -> str:
    head, rest = text.split("\n", 1)
    units = ["s"] + [m.group(1) if (m := re.search(r"_(mm|g)$", name)) else "-" for name in head.split(",")[1:]]
    return "\n".join([head, ",".join(units), rest])


def _twin_head(text: str) -> str:
    head, rest = text.split("\n", 1)
    names = head.split(",")
    names[-1] = names[-2]
    return "\n".join([",".join(names), rest])


def _last_row_cut(text: str) -> str:
    return text[: int(0.97 * len(text))].rstrip("\n")[:-3]


def _shuffled(text: str) -> str:
    table = pd.read_csv(io.StringIO(text), dtype=str)
    return table[[table.columns[0], *table.columns[:0:-1]]].to_csv(index=False)


def later(c: CampaignCopy) -> Made:
    """All stamps count from 2718 s."""
    files = [*c.files("bump_runs"), *c.files("plank_drops")]
    change_table(c, lambda t: t.assign(**{t.columns[0]: 2718.0 + t[t.columns[0]]}), files)
    return Made("stamps from 2718 s", (r"stamps|clock",), _ALL, "the first stamp is zero")


def column_missing(c: CampaignCopy) -> Made:
    """One run lacks a column."""
    file, column = _a_run(c), a_column(c)
    change_table(c, lambda t: t.drop(columns=column), [file])
    return Made(f"{column} missing in {file}", (f"{column}",), frozenset([column]))


def column_renamed(c: CampaignCopy) -> Made:
    """A column has another name in all runs."""
    column = a_column(c)
    change_table(c, lambda t: t.rename(columns={column: column.upper() + " (2)"}), c.files("bump_runs"))
    return Made(f"{column} has another name in the logs", (f"{column}",), frozenset([column]))


def not_there(c: CampaignCopy) -> Made:
    """One log has been moved away."""
    file = _a_run(c)
    (c.folder / file).unlink()
    return Made(f"{file} is not there", (re.escape(file),), _ALL)


def folder_instead(c: CampaignCopy) -> Made:
    """The entry of a run names a folder."""
    file = _a_run(c)
    c.write(c.text.replace(f'"{file}"', '"bump_runs"'))
    return Made(f"a folder in place of {file}", (r"bump_runs",), _ALL)


def no_scan(c: CampaignCopy) -> Made:
    """The scan has been moved away."""
    (c.folder / "bump_scan.csv").unlink()
    return Made("the scan is not there", (r"bump_scan\.csv",), _ALL)


def drop_as_run(c: CampaignCopy) -> Made:
    """The log of a drop lies where that of a run should."""
    file, drop = _a_run(c), c.pick(c.files("plank_drops"))
    (c.folder / file).write_bytes((c.folder / drop).read_bytes())
    return Made(f"{file} is the log of a drop", (re.escape(file), r"frame_axle_mm|column"), _ALL)


def run_as_drop(c: CampaignCopy) -> Made:
    """The log of a run lies where that of a drop should, with the names of the sensors of a drop."""
    line = c.pick(drop_lines(c))
    drop = re.findall(r'file = "([^"]+)"', line)[0]
    table = pd.read_csv(c.folder / _a_run(c))
    if len(table.columns) < 4:
        raise DoesNotApply("too few columns")
    kept = table[[table.columns[0], "lvdt1_mm", "axle1_accel_g", "frame1_accel_g"]]
    names = list(pd.read_csv(c.folder / drop, nrows=1).columns)
    kept.set_axis(names, axis=1).to_csv(c.folder / drop, index=False)
    return Made(f"{drop} is the log of a bump run", (f"{re.escape(drop)}",), _ALL)


_STAMPS = "stamp|time|clock"
FAULTS: dict[str, Fault] = {
    "decimal commas": text("decimal commas", "comma|separator", _decimal_commas, SAME_READINGS),
    "byte order mark": text("a byte order mark", "mark|encoding", lambda t: "\ufeff" + t, SAME_READINGS),
    "UTF-16": text("UTF-16", "encoding", lambda t: t.encode("utf-16"), SAME_READINGS),
    "columns shuffled": text("columns in another order", "order", _shuffled, SAME_READINGS),
    "undeclared units row": text("a row of units", "unit", _units_row, SAME_READINGS),
    "NUL bytes": text("NUL bytes", "NUL|byte|text|row|line", lambda t: t[:2000] + "\0" * 400 + t[2400:]),
    "one name twice": text("one name twice", "twice|two columns|duplicate|several|missing|not.*column", _twin_head),
    "file cut in a row": text("cut within a row", "row|line|cut|ends|short|missing", _last_row_cut),
    "empty file": text("empty", "empty|no ", lambda t: ""),
    "head alone": text("only a head", "empty|no |row|reading|sample", lambda t: t.split("\n", 1)[0] + "\n"),
    "no column of time": text("no time", _STAMPS, lambda t: t.replace("time_s", "speed_v", 1)),
    "binary": text("binary", "text|table|byte|read|column|format", lambda t: bytes(np.arange(60000) % 251)),
    "rows twice": rows("twenty rows stand twice", f"{_STAMPS}|twice|repeat", _twice),
    "stamps run back": rows("the clock runs back", f"{_STAMPS}|back", _backward),
    "stamps jitter": rows("stamps jitter by 45 % of a step", f"{_STAMPS}|uneven|jitter|step|interval", _jitter),
    "rows missing": rows("0.4 s of rows missing", "missing|gap|lost|jump", _gap),
    "2.5 Hz": rows("at 2.5 Hz", f"{_STAMPS}|rate|interval|sample|Hz", lambda t, _: t.iloc[::80]),
    "three rows": rows("three rows", "row|short|sample|reading|long", lambda t, _: t.head(3)),
    "cells with words": cells("say ERR", "ERR|number|row", "ERR", 0.002),
    "infinite cells": cells("say inf", "inf|finite|number|missing|lost", "inf", 0.02),
    "cells say #N/A": cells("say #N/A", "missing|lost|number", "#N/A", 0.2),
    "stamps from 2718 s": later,
    "column missing": column_missing,
    "column renamed": column_renamed,
    "log not there": not_there,
    "folder for a log": folder_instead,
    "scan not there": no_scan,
    "drop listed as a run": drop_as_run,
    "run listed as a drop": run_as_drop,
}
