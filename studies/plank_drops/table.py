"""Table of the study of plank drops."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from studies.documents import write_between_marks
from studies.plank_drops.motion import KINDS

Z90 = 1.6448536269514722
METHODS = ("free_decay", "corrected", "paper")


def usable(records: Iterable[dict[str, Any]], method: str) -> list[dict[str, Any]]:
    """The drops of which a method gives numbers."""
    return [r for r in records if r["rows"][method]["usable"]]


def errors(records: Iterable[dict[str, Any]], method: str, quantity: int) -> list[tuple[float, float]]:
    """Relative error, and error over its standard deviation, of k (0) or c (1) in the rows that are called usable."""
    found = []
    for r in usable(records, method):
        value, sd = r["rows"][method]["numbers"][2 * quantity : 2 * quantity + 2]
        truth = r["truth"][quantity]
        found.append((value / truth - 1.0, (value - truth) / sd))
    return found


def held(found: Sequence[tuple[float, float]]) -> float:
    """Share of the 90 % intervals that hold the truth."""
    return sum(abs(z) <= Z90 for _, z in found) / max(len(found), 1)


def table(records: Sequence[dict[str, Any]]) -> str:
    """Markdown: usable rows, intervals that hold and errors of k and c, by kind and by method."""
    lines = [
        "| kind | drops | usable | k held | c held | k: median error | 95 % below | c: median error | 95 % below |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    groups = [(kind, [r for r in records if r["kind"] == kind], "free_decay") for kind in KINDS]
    without = [r for r in records if "friction" not in r["kind"]]
    groups += [("without friction", without, "free_decay"), ("all", list(records), "free_decay")]
    groups += [(f"all, method `{m}`", list(records), m) for m in METHODS[1:]]
    for name, group, method in groups:
        cells = [name, str(len(group)), str(len(usable(group, method)))]
        found = [errors(group, method, quantity) for quantity in (0, 1)]
        cells += [f"{100.0 * held(f):.0f} %" if f else "-" for f in found]
        for f in found:
            sizes = sorted(abs(e) for e, _ in f)
            shown = [median(sizes), sizes[min(int(0.95 * len(sizes)), len(sizes) - 1)]] if sizes else []
            cells += [f"{100.0 * s:.2g} %" for s in shown] or ["-", "-"]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def write(records: Sequence[dict[str, Any]], seed: int, document: Path) -> None:
    """Replace the table between its marks in a document."""
    write_between_marks(document, "plank-drops", f"{len(records)} plank drops, seed {seed}.\n\n{table(records)}")
