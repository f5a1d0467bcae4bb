"""Table of the study of factors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from studies.coverage.shards import Record
from studies.documents import write_between_marks
from studies.independent.table import holds


def table(records: Sequence[Record]) -> str:
    """Markdown: how often 90 % intervals of k and c hold and how wide they are, with each factor left out."""
    lines = [
        "| left out | k hold | c hold | half-width of k, c | error of k, c | laws that are not there | not converged |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for name in dict.fromkeys(name for r in records for name in r["factors"]):
        found = [(r["linear"], r["factors"][name]) for r in records]
        held, width, error = [], [], []
        for kind in ("stiffness", "damping"):
            of = [e for _, one in found for e in one["entries"] if e["kind"] == kind]
            held.append(f"{100.0 * np.mean([holds(e) for e in of]):.0f} %")
            width.append(np.median([0.5 * (e["reported"][2] - e["reported"][0]) / e["reported"][1] for e in of]))
            error.append(np.median([abs(e["reported"][1] / e["truth"] - 1.0) for e in of]))
        linear = [one for is_linear, one in found if is_linear]
        cells = [name, *held, _percents(width), _percents(error)]
        cells += [f"{sum(bool(one['laws']) for one in linear)} of {len(linear)}"]
        cells += [f"{sum(not one['converged'] for _, one in found)} of {len(found)}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _percents(values: Sequence[float]) -> str:
    return ", ".join(f"{100.0 * v:.1f}" for v in values) + " %"


def write(records: Sequence[Record], seed: int, document: Path) -> None:
    """Replace the table between its marks in a document."""
    write_between_marks(document, "factors", f"{len(records)} campaigns of seed {seed}.\n\n{table(records)}")
