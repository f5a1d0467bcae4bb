"""The tables of whole jobs on a page of the documentation, from their JSON file alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from studies.documents import write_between_marks


def write_table(found: dict[str, Any], document: Path) -> None:
    """Write the tables between the marks ``jobs`` of a page."""
    write_between_marks(document, "jobs", f"{_jobs(found)}\n\n{_stages(found)}")


def _jobs(found: dict[str, Any]) -> str:
    lines = [
        "`calibrate.py run CAMPAIGN --output FOLDER`, with engine and JAX's functions compiled before (but for rows",
        "called *cold*), in an environment without optional packages. Wall time is that of a shared machine where the",
        "load says so.",
        "",
        "| campaign | what | ends | wall [s] | processor [s] | peak memory [GB] | load |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, one in found.items():
        lines.append(
            f"| {name} | {one['about']} | {_ending(one)} | {one['wall_s']:.0f} | {one['processor_s']:.0f} | "
            f"{one['peak_bytes'] / 1e9:.2f} | {one['machine']['load_before']:.1f} |"
        )
    return "\n".join(lines)


def _ending(one: dict[str, Any]) -> str:
    if one["exit"] == 0:
        return str(one["status"])
    last = (one["last_words"] or [""])[-1].split("\r")[-1].strip()
    return f"ended at the limit, at '{last}'" if one["exit"] < 0 else f"exit code {one['exit']}"


def _stages(found: dict[str, Any]) -> str:
    names = list(dict.fromkeys(stage for one in found.values() for stage in one["stages_s"] if ": " not in stage))
    lines = ["Wall seconds of the stages:", "", "| stage | " + " | ".join(found) + " |", "|---|" + "---|" * len(found)]
    for stage in names:
        cells = (one["stages_s"].get(stage) for one in found.values())
        lines.append(f"| {stage} | " + " | ".join("" if s is None else f"{s:.1f}" for s in cells) + " |")
    outside = [one["wall_s"] - sum(s for k, s in one["stages_s"].items() if ": " not in k) for one in found.values()]
    lines.append("| outside of the stages | " + " | ".join(f"{s:.1f}" for s in outside) + " |")
    return "\n".join(lines)
