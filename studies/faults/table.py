"""Table of the study of faults."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from studies.documents import write_between_marks
from studies.faults.bookkeeping import BOOKKEEPING
from studies.faults.measuring import MEASURING

_ENDINGS = {
    "done, exit 0": (0,),
    "bad campaign file, exit 2": (2,),
    "data rejected, exit 3": (3,),
    "not converged, exit 4": (4,),
    "unexpected error, exit 1": (1,),
    "not done within 20 minutes": (-1,),
}


def failed(record: dict[str, Any]) -> bool:
    """Whether a case ended in anything but a result or one sentence."""
    return record["code"] not in (0, 2, 3, 4) or bool(record["traceback"])


def table(records: Sequence[dict[str, Any]]) -> str:
    """Markdown: endings by where the first fault is."""
    kinds = {"bookkeeping": BOOKKEEPING, "measuring": MEASURING}
    lines = ["| ends in | bookkeeping | measuring | all |", "|---|---|---|---|"]
    for ending, codes in _ENDINGS.items():
        found = [r for r in records if r["code"] in codes]
        counts = [sum(r["faults"][0] in names for r in found) for names in kinds.values()]
        lines.append(f"| {ending} | {counts[0]} | {counts[1]} | {sum(counts)} |")
    lines.append(f"| of these with a traceback | | | {sum(bool(r['traceback']) for r in records)} |")
    return "\n".join(lines)


def write(records: Sequence[dict[str, Any]], command: str, seed: int, document: Path) -> None:
    """Replace the table between its marks in a document."""
    faults = len({name for r in records for name in r["faults"]})
    head = f"`calibrate.py {command}`, {len(records)} cases with {faults} kinds of faults, seed {seed}."
    write_between_marks(document, "faults", f"{head}\n\n{table(records)}")
