"""Table of the study of ring-downs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from studies.documents import write_between_marks
from studies.ring_downs.motion import KINDS

Z90 = 1.6448536269514722
QUANTITIES = ("period", "k", "c", "F", "Q")
_TERM = {"c": "viscous", "F": "friction", "Q": "quadratic"}


def errors(records: Iterable[dict[str, Any]], quantity: str) -> list[tuple[float, float]]:
    """Relative error and error over its standard deviation of every ring-down that has the quantity.

    Ring-downs whose kind was told wrong count where the quantity was given at all.
    """
    found = []
    for r in records:
        truth, value, sd = r["quantities"][quantity]
        if quantity in _TERM and _TERM[quantity] not in r["kind"]:
            continue
        if value is None or sd is None or not truth:
            continue
        found.append((value / truth - 1.0, (value - truth) / sd if sd > 0.0 else float("inf")))
    return found


def right(records: Sequence[dict[str, Any]]) -> int:
    """How many kinds were told right."""
    return sum(r["kind"] == r["found"] for r in records)


def held(found: Sequence[tuple[float, float]]) -> float:
    """Share of the 90 % intervals that hold the truth."""
    return sum(abs(z) <= Z90 for _, z in found) / max(len(found), 1)


def table(records: Sequence[dict[str, Any]]) -> str:
    """Markdown: kinds told right, then errors and intervals of every quantity."""
    visible = [r for r in records if r["visible"]]
    lines = ["| kind | ring-downs | visible | told right of the visible | told right of all |", "|---|---|---|---|---|"]
    for kind in [*(" + ".join(k) for k in KINDS), None]:
        every = [r for r in records if kind in (None, r["kind"])]
        seen = [r for r in every if r["visible"]]
        name = "all" if kind is None else kind
        lines.append(f"| {name} | {len(every)} | {len(seen)} | {right(seen)} | {right(every)} |")
    lines += [
        "",
        "| of the visible | numbers | median error | 95 % below | largest | 90 % intervals that hold |",
        "|---|---|---|---|---|---|",
    ]
    for quantity in QUANTITIES:
        found = errors(visible, quantity)
        sizes = sorted(abs(e) for e, _ in found)
        if not sizes:
            continue
        shown = [sizes[len(sizes) // 2], sizes[min(int(0.95 * len(sizes)), len(sizes) - 1)], sizes[-1]]
        cells = " | ".join(f"{100.0 * s:.2g} %" for s in shown)
        lines.append(f"| {quantity} | {len(found)} | {cells} | {100.0 * held(found):.0f} % |")
    return "\n".join(lines)


def write(records: Sequence[dict[str, Any]], seed: int, document: Path) -> None:
    """Replace the table between its marks in a document."""
    write_between_marks(document, "ring-downs", f"{len(records)} ring-downs, seed {seed}.\n\n{table(records)}")
