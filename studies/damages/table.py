"""Table of the study of damages."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from studies.damages.files import FILE_DAMAGES
from studies.damages.forgeries import FORGERIES
from studies.documents import write_between_marks


def failures(record: dict[str, Any]) -> list[str]:
    """What is wrong with a case: an unexpected error, another number, too much memory, no end."""
    return [f"{step['command']}: {wrong}" for step in record["steps"] for wrong in step["wrong"]]


def table(records: Sequence[dict[str, Any]]) -> str:
    """Markdown: how the commands end, by the kind of damage."""
    lines = ["| damage | cases | commands | exit 0 | refused in a sentence | failures |", "|---|---|---|---|---|---|"]
    for name in (*FILE_DAMAGES, *FORGERIES):
        lines.append(_row(name, [r for r in records if r["damage"] == name]))
    lines.append(_row("all", records))
    return "\n".join(lines)


def _row(name: str, records: Sequence[dict[str, Any]]) -> str:
    steps = [step for r in records for step in r["steps"]]
    refused = sum(step["code"] in (2, 3, 4) for step in steps)
    done, failed = sum(step["code"] == 0 for step in steps), sum(bool(failures(r)) for r in records)
    return f"| {name} | {len(records):,} | {len(steps):,} | {done:,} | {refused} | {failed} |"


def figures(records: Sequence[dict[str, Any]], seed: int) -> str:
    """One sentence: how many cases, and what they took at most."""
    steps = [step for r in records for step in r["steps"]]
    counts = {name: sum(step["command"] == name for step in steps) for name in ("export", "report", "run")}
    most = {name: max(step[name] for step in steps) for name in ("seconds", "MB")}
    return (
        f"{len(records):,} damages, seed {seed}: {counts['export']:,} times `export`, {counts['report']} times "
        f"`report`, {counts['run']} times `run --resume`; at most {most['seconds']:.0f} s of processor time, and "
        f"{most['MB']} MB more than before the command."
    )


def write(records: Sequence[dict[str, Any]], seed: int, document: Path) -> None:
    """Replace the table between its marks in a document."""
    write_between_marks(document, "damages", f"{figures(records, seed)}\n\n{table(records)}")
