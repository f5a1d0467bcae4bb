"""Tables of pairs: how well bump and drives agree about one truck."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from studies.coverage.shards import Record
from studies.documents import write_between_marks
from sysid.display import Z90

_SYMBOLS = {"stiffness": "k", "damping": "c"}
#: Kinds of physics, in words.
_WORDS = {
    "of the model": "the model",
    "bushing": "rubber of 3 MN/m in series with dampers",
    "leaf": "leaf friction of 8 % that falls with the rate, slip of 6 mm",
    "helper": "a second leaf beyond 20 mm of jounce behind axle 1, as stiff as the first",
    "bump": "the bump gives by 8 %",
}


def apart_sd(entry: Record) -> float:
    """ln(drives / bump) over the root of the sum of both variances."""
    (bump, bump_sd), (drives, drives_sd) = entry["bump"], entry["drives"]
    return math.log(drives / bump) / math.hypot(bump_sd, drives_sd)


def overlap(entry: Record) -> bool:
    """Whether the 90 % intervals have a value in common."""
    (bump, bump_sd), (drives, drives_sd) = entry["bump"], entry["drives"]
    return abs(math.log(drives / bump)) <= Z90 * (bump_sd + drives_sd)


def holds(entry: Record, source: str) -> bool:
    """Whether the 90 % interval of a source holds the truth."""
    value, sd = entry[source]
    return abs(math.log(value / entry["truth"])) <= Z90 * sd


def tables(records: Sequence[Record]) -> str:
    """Markdown: how many values and trucks agree, and what the intervals hold."""
    good = [r for r in records if r["failed"] is None]
    lines = [
        "| | values | difference within its 90 % | intervals overlap | hold the truth: bump, drives "
        "| median half-width: bump, drives |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for quantity in (*_SYMBOLS, None):
        entries = [e for r in good for e in r["entries"] if quantity in (e["quantity"], None)]
        within = sum(abs(apart_sd(e)) <= Z90 for e in entries)
        held = [sum(holds(e, s) for e in entries) / max(len(entries), 1) for s in ("bump", "drives")]
        widths = [100.0 * Z90 * np.median([e[s][1] for e in entries] or [np.nan]) for s in ("bump", "drives")]
        lines.append(
            f"| {'all' if quantity is None else _SYMBOLS[quantity]} | {len(entries)} | {_share(within, len(entries))} "
            f"| {_share(sum(map(overlap, entries)), len(entries))} | {held[0]:.0%}, {held[1]:.0%} "
            f"| {widths[0]:.1f}, {widths[1]:.1f} % |"
        )
    every = sum(all(map(overlap, r["entries"])) for r in good)
    within = sum(all(abs(apart_sd(e)) <= Z90 for e in r["entries"]) for r in good)
    accused = sum("balance_disagrees" in r["kinds"] for r in good)
    lines += [
        "",
        f"All intervals of a truck overlap in {every} of {len(good)} pairs; all differences are within their 90 % in "
        f"{within}. The verdict says that the balance disagrees in {accused}. Refused: {len(records) - len(good)}.",
    ]
    return "\n".join(lines)


def wrong_tables(records: Sequence[Record]) -> str:
    """Markdown, one line for each physics that no law has: errors, disagreement, and what the verdict says."""
    good = [r for r in records if r["failed"] is None]
    lines = [
        "| what is true | trucks | k off, worst: bump, drives | c off, worst: bump, drives "
        "| largest difference of a truck, sd | verdict names the balance | do not bet |",
        "|---|---:|---:|---:|---|---:|---:|",
    ]
    for physics in dict.fromkeys(r["physics"] for r in good):
        of = [r for r in good if r["physics"] == physics]
        cells = []
        for quantity in _SYMBOLS:
            entries = [e for r in of for e in r["entries"] if e["quantity"] == quantity]
            worst = [max((e[s][0] / e["truth"] - 1.0 for e in entries), key=abs) for s in ("bump", "drives")]
            cells.append(f"{100 * worst[0]:+.1f}, {100 * worst[1]:+.1f} %")
        apart = []
        for r in of:
            e = max(r["entries"], key=lambda e: abs(apart_sd(e)))
            apart.append(f"{apart_sd(e):+.1f} ({e['name'].partition('[')[0]})")
        named = sum("balance_disagrees" in r["kinds"] for r in of)
        refused = sum(r["trust"] == "do_not_bet" for r in of)
        lines.append(
            f"| {_WORDS[physics]} | {len(of)} | {cells[0]} | {cells[1]} | {', '.join(apart)} | {named} | {refused} |"
        )
    return "\n".join(lines)


def _share(part: int, whole: int) -> str:
    return f"{part} ({part / max(whole, 1):.0%})"


def write_tables(records: Sequence[Record], seed: int, document: Path) -> None:
    """Rewrite the table of trucks of the model's physics on a page."""
    trucks = f"{len(records)} trucks of seed {seed} (`python -m studies.road_drives.pairs`):"
    write_between_marks(document, "pairs", f"{trucks}\n\n{tables(records)}")


def write_wrong(records: Sequence[Record], seed: int, document: Path) -> None:
    """Rewrite the table of trucks with physics that no law has on a page."""
    trucks = f"{len(records)} trucks of seed {seed} (`python -m studies.road_drives.pairs --wrong`):"
    write_between_marks(document, "pairs that no law describes", f"{trucks}\n\n{wrong_tables(records)}")
