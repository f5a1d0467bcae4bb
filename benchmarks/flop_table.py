"""The table of operations and rates on a page of the documentation, from its JSON file alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks.flop_count import Operations
from studies.documents import write_between_marks

#: Parameter sets in a call.
SETS = 64


def write_table(found: dict[str, Any], document: Path) -> None:
    """Write the tables between the marks ``flops`` of a page."""
    write_between_marks(document, "flops", "\n\n".join((_counts(found), _rates(found), _limits(found))))


def _counts(found: dict[str, Any]) -> str:
    lines = [
        "Operations of one likelihood (one set, four runs), in millions; *others* are comparisons, selections, signs",
        "and bits, which do not count as floating-point operations; the road is looked up once for the sets of a pack.",
        "",
        "| laws | additions | multiplications | divisions | roots | road | floating-point | others |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, numbers in found["operations"].items():
        of = Operations(**numbers)
        cells = (of.additions, of.multiplications, of.divisions, of.roots, of.road, of.floating, of.others)
        lines.append(f"| {name} | " + " | ".join(f"{value / 1e6:.3g}" for value in cells) + " |")
    return "\n".join(lines)


def _rates(found: dict[str, Any]) -> str:
    machine = found["machine"]
    peak = ", ".join(
        f"{lanes} lanes {one['core']:.0f} GF/s of a core ({one['together']:.0f} of all together by wall time; one that "
        f"waits for the one before takes {one['dependent_ns']:.2f} ns)"
        for lanes, one in found["peak"].items()
    )
    lines = [
        f"Peak of fused multiply-adds: {peak}. Load {machine['load_before']:.1f} on {machine['cores']} cores.",
        "Rates are by processor time, so that other work on the machine hardly shows; medians.",
        "",
        "| laws | cores | processor time per set [ms] | GF/s of a core | of its peak |",
        "|---|---|---|---|---|",
    ]
    top = max(found["peak"].values(), key=lambda one: one["core"])["core"]
    for row in found["seconds"]["as it is"]:
        name = found["laws"][row["call"]]
        rate = _rate(found, row)
        millis = 1e3 * row["processor_s"][1] / SETS
        lines.append(f"| {name} | {row['threads']} | {millis:.2f} | {rate:.1f} | {100 * rate / top:.0f} % |")
    return "\n".join(lines)


def _limits(found: dict[str, Any]) -> str:
    lines = [
        "What limits it, by builds that are changed (their results are of no use where something costs nothing), on",
        "one core; time as a share of that of the build as it is:",
        "",
        "| build | " + " | ".join(found["laws"]) + " |",
        "|---|" + "---|" * len(found["laws"]),
    ]
    plain = {row["call"]: row for row in found["seconds"]["as it is"] if row["threads"] == 1}
    for name, rows in found["seconds"].items():
        alone = [row for row in rows if row["threads"] == 1]
        cells = (f"{row['processor_s'][1] / plain[row['call']]['processor_s'][1]:.2f}" for row in alone)
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _rate(found: dict[str, Any], row: dict[str, Any]) -> float:
    of = Operations(**found["operations"][found["laws"][row["call"]]])
    return float(1e-9 * SETS * of.floating / row["processor_s"][1])
