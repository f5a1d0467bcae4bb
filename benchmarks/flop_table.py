"""The table of operations and rates on a page of the documentation, from its JSON file alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks.document import BUSY
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
    quiet = machine["load_before"] < BUSY
    peak = ", ".join(
        f"{lanes} lanes {one['core']:.0f} GF/s of a core"
        + (f" ({one['together']:.0f} of all together by wall time)" if quiet else "")
        + f", one that waits for the one before {one['dependent_ns']:.2f} ns"
        for lanes, one in found["peak"].items()
    )
    lines = [
        f"Peak of fused multiply-adds: {peak}.",
        f"Load {machine['load_before']:.1f} on {machine['cores']} cores.",
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
    return "\n".join([*lines, "", *_reasons(found)])


def _reasons(found: dict[str, Any]) -> list[str]:
    """Why the rate is what it is: shares of other peaks."""
    peaks = {int(lanes): one["core"] for lanes, one in found["peak"].items()}
    widest = max(peaks)

    def shares(name: str, peak: float) -> str:
        rows = (row for row in found["seconds"][name] if row["threads"] == 1)
        return " and ".join(f"{100 * _rate(found, row) / peak:.0f}" for row in rows)

    lines = [
        f"The peak counts two operations for each instruction, and only some operations fuse: without any fusing "
        f"{shares('no multiply-add is fused', peaks[widest] / 2)} %",
        "of the peak of separate additions and multiplications are reached. The rest are selections and comparisons,",
        "which count for nothing here and take as long, loads and stores of the state, and chains in which every",
        "operation waits for the one before (polynomials, sums over the coordinates).",
    ]
    if 4 in peaks and widest > 4:
        lines += [
            f"Half as many lanes reach "
            f"{shares('four lanes (AVX2)', peaks[4])} % of their own peak: so what all sets of",
            "a pack share (the road, the matrices) is not the limit, nor is memory.",
        ]
    return lines


def _rate(found: dict[str, Any], row: dict[str, Any]) -> float:
    of = Operations(**found["operations"][found["laws"][row["call"]]])
    return float(1e-9 * SETS * of.floating / row["processor_s"][1])
