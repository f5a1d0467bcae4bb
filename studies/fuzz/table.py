"""The table of the fuzzer: a row for every reader, from its figures or, if there are none, from the page as it was."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from studies.fuzz.targets import TARGETS


def table(output: Path, page: str) -> str:
    """One row for every reader that was fuzzed now, or whose row stands on the page."""
    place = page.partition("<!-- fuzz: begin -->")[2].partition("<!-- fuzz: end -->")[0]
    earlier = {line.split(" | ")[0].strip("| "): line for line in place.splitlines() if line.startswith("| ")}
    rows = [
        "| reader | minutes | inputs | refused | places at first, in the end | kept | longest [s] "
        "| memory [MB] | stopped | wrong |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for target in TARGETS.values():
        file = output / target.name / "figures.json"
        if file.exists():
            rows.append(_row(target.title, json.loads(file.read_text(encoding="utf-8"))))
        elif target.title in earlier:
            rows.append(earlier[target.title])
    return "\n".join(rows)


def _row(title: str, figures: dict[str, Any]) -> str:
    wrong = sum("wrong" in found for found in figures["findings"].values())
    before, after = figures["places"]
    cells = (
        f"{figures['processor_s'] / 60:.0f}",
        f"{figures['inputs']:,.0f}",
        f"{figures['refused']:,.0f}",
        f"{before:,}, {after:,}",
        f"{figures['corpus']:,}",
        f"{figures['slowest_s']:.1f}",
        f"{figures['peak_MB']:,}",
        f"{figures['stopped'] + figures['died']:,.0f}",
        f"{wrong}",
    )
    return f"| {title} | {' | '.join(cells)} |"
