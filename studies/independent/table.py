"""Tables of the study of independent trucks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from studies.coverage.shards import Record
from studies.documents import write_between_marks
from studies.independent.case import KINDS

_QUANTITIES = {"stiffness": "k", "damping": "c", "peak": "peak load ratios"}


def holds(entry: Record) -> bool:
    """Whether an interval holds the truth."""
    return _within(entry["truth"], entry["reported"])


def _within(truth: float, interval: Sequence[float]) -> bool:
    return bool(interval[0] <= truth <= interval[2])


def _half_width(interval: Sequence[float]) -> float:
    return 0.5 * (interval[2] - interval[0]) / interval[1]


def tables(records: Sequence[Record]) -> str:
    """Markdown: how often 90 % intervals hold and how wide they are, by quantity, by vehicle and by kind."""
    good = [r for r in records if r["failed"] is None]
    lines = [
        "| 90 % interval of | intervals | hold | median half-width | median error | 95 % of errors below "
        "| normal approximation: hold, half-width |"
    ]
    lines.append("|---|---:|---:|---:|---:|---:|---:|")
    for kind, name in _QUANTITIES.items():
        lines.append(_row(name, [e for r in good for e in r["entries"] if e["kind"] == kind]))
    for vehicle in dict.fromkeys(r["vehicle"] for r in good):
        lines.append(_row(vehicle, [e for r in good if r["vehicle"] == vehicle for e in r["entries"]]))
    lines.append(_row("all", [e for r in good for e in r["entries"]]))
    lines += ["", *_physics_head("kind of trucks")]
    for kind, every in KINDS.items():
        if of_kind := [r for r in good if r["physics"] in every]:
            lines.append(_physics_row(kind, of_kind))
    parts = [name for every in KINDS.values() if len(every) > 1 for name in every]
    if of_parts := {name: of for name in parts if (of := [r for r in good if r["physics"] == name])}:
        lines += ["", *_physics_head("of these kinds")]
        lines += [_physics_row(name, of) for name, of in of_parts.items()]
    linear = [r for r in good if r["linear"]]
    false = sum(bool(set(r["laws"]) - {"stops"}) for r in linear)
    missed = sum(sum(map(holds, r["entries"])) < 0.5 * len(r["entries"]) for r in good)
    lines += [
        "",
        f"Laws that are not there: in {false} of {len(linear)} campaigns of linear suspensions. Fewer than half of the "
        f"intervals hold in {missed} of {len(good)} campaigns. Not converged or refused: {len(records) - len(good)} of "
        f"{len(records)}.",
    ]
    for r in records:
        if r["failed"] is not None:
            lines += ["", f"- {r['vehicle']}, {r['physics']}: exit {r['code']}."]
    return "\n".join(lines)


def _row(name: str, entries: Sequence[Record]) -> str:
    width = [_half_width(e["reported"]) for e in entries]
    error = np.abs([e["reported"][1] / e["truth"] - 1.0 for e in entries])
    held = 100.0 * np.mean([holds(e) for e in entries])
    cells = (f"{100 * v:.1f} %" for v in (np.median(width), np.median(error), np.quantile(error, 0.95)))
    return f"| {name} | {len(entries)} | {held:.0f} % | " + " | ".join([*cells, _by_normal(entries)]) + " |"


def _by_normal(entries: Sequence[Record]) -> str:
    """How often the intervals of the normal at the optimum hold, and how wide they are; empty if an entry has none."""
    if not all("normal" in e for e in entries):
        return ""
    held = np.mean([_within(e["truth"], e["normal"]) for e in entries])
    return f"{100.0 * held:.0f} %, {100.0 * np.median([_half_width(e['normal']) for e in entries]):.1f} %"


def _physics_head(name: str) -> list[str]:
    head = f"| {name} | campaigns | hold | k held | c held | peaks held | largest error of k, c, peaks | verdict |"
    return [head, "|---|---:|---:|---:|---:|---:|---:|---|"]


def _physics_row(name: str, records: Sequence[Record]) -> str:
    held, worst = [], []
    for kind in _QUANTITIES:
        of = [e for r in records for e in r["entries"] if e["kind"] == kind]
        held.append(f"{sum(map(holds, of))} of {len(of)}")
        worst.append(f"{100.0 * max(abs(e['reported'][1] / e['truth'] - 1.0) for e in of):.1f}")
    whole = 100.0 * np.mean([holds(e) for r in records for e in r["entries"]])
    trust = [r["trust"].replace("_", " ") for r in records]
    verdict = ", ".join(f"{t}: {trust.count(t)}" for t in dict.fromkeys(trust))
    return f"| {name} | {len(records)} | {whole:.0f} % | " + " | ".join(held) + f" | {', '.join(worst)} % | {verdict} |"


def write(records: Sequence[Record], seed: int, document: Path) -> None:
    """Replace the tables between their marks in a document."""
    six = sum(r["vehicle"] == "lowboy" for r in records)
    words = f"{len(records)} campaigns of seed {seed}, {six} of them tractors with a lowboy."
    write_between_marks(document, "independent trucks", f"{words}\n\n{tables(records)}")
