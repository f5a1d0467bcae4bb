"""Tables of the study of simulated fleets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from studies.documents import write_between_marks

_WORDS = {"mean": "mean of the type", "spread": "spread between trucks", "trucks": "k and c of every truck"}


def coverage(records: Sequence[dict[str, Any]], what: str) -> tuple[int, int]:
    """How many 90 % intervals hold the truth, and how many there are."""
    held = [h for r in records for h in r[what]]
    return sum(held), len(held)


def rms(records: Sequence[dict[str, Any]], what: str) -> float:
    """RMS of relative errors."""
    return float(np.sqrt(np.mean([e**2 for r in records for e in r[what]])))


def found(records: Sequence[dict[str, Any]]) -> int:
    """In how many fleets the broken damper is named."""
    return sum(any([o[0], o[1]] == r["broken"] for o in r["outliers"]) for r in records)


def alarms(records: Sequence[dict[str, Any]]) -> int:
    """In how many fleets something that is not broken is named."""
    return sum(any([o[0], o[1]] != r["broken"] for o in r["outliers"]) for r in records)


def tables(studies: Mapping[str, Sequence[dict[str, Any]]]) -> str:
    """Markdown: coverage and errors of the healthy fleets, outliers of all."""
    healthy = studies["healthy"]
    lines = ["| 90 % intervals of | hold the truth | of | share |", "|---|---|---|---|"]
    for what, words in _WORDS.items():
        held, count = coverage(healthy, what)
        lines.append(f"| {words} | {held} | {count} | {100.0 * held / count:.1f} % |")
    alone, shrunk = rms(healthy, "alone_error"), rms(healthy, "shrunk_error")
    better = sum(np.mean(np.square(r["shrunk_error"])) < np.mean(np.square(r["alone_error"])) for r in healthy)
    converged = sum(r["converged"] for r in healthy)
    lines += [
        "",
        f"RMS error of k and c of a truck: {100.0 * alone:.2f} % from its own two campaigns, {100.0 * shrunk:.2f} % "
        f"drawn towards the population; smaller in {better} of {len(healthy)} fleets. "
        f"Sampling converged in {converged}.",
        "",
        "| fleets | broken damper found | something else named |",
        "|---|---|---|",
    ]
    for name, words in (
        ("healthy", "no damper broken"),
        ("broken", "one broken, c of others differs by 5 to 12 %"),
        ("broken_wide", "one broken, c of others differs by 8 to 20 %"),
    ):
        records = studies[name]
        hits = "-" if name == "healthy" else f"{found(records)} of {len(records)}"
        lines.append(f"| {words} | {hits} | {alarms(records)} of {len(records)} |")
    return "\n".join(lines)


def write(text: str, document: Path) -> None:
    """Replace the tables between their marks in a document."""
    write_between_marks(document, "fleets", text)
