"""Tables of the study of made trucks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from studies.coverage.shards import Record
from studies.documents import write_between_marks

MAIN = ("k", "c", "peak")
_LIMITS = {"k": 0.02, "c": 0.05, "peak": 0.05}
_BET = ("use", "use_within")


def holds(entry: Record) -> bool:
    """Whether an interval holds the truth."""
    low, _, high = entry["interval"]
    return bool(low <= entry["true"] <= high)


def error(entry: Record) -> float:
    """Relative error of the median."""
    return abs(entry["interval"][1] / entry["true"] - 1.0)


def main_entries(record: Record) -> list[Record]:
    """Intervals of k, c and peaks."""
    return [e for e in record["entries"] if e["quantity"] in MAIN]


def deserves_doubt(record: Record) -> bool:
    """Whether *do not bet* is deserved: a value far off, or fewer than 70 % of the intervals hold."""
    every = main_entries(record)
    return any(error(e) > _LIMITS[e["quantity"]] for e in every) or float(np.mean([holds(e) for e in every])) < 0.7


def _share(values: Sequence[bool]) -> str:
    return f"{100.0 * float(np.mean(values)):.0f} % ({sum(values)} of {len(values)})" if values else "none"


def _cells(records: Sequence[Record], quantity: str) -> str:
    of = [e for r in records for e in r["entries"] if e["quantity"] == quantity]
    if not of:
        return "-"
    width = np.median([0.5 * (e["interval"][2] - e["interval"][0]) / e["interval"][1] for e in of])
    shown = float(np.mean([holds(e) for e in of])), float(np.median([error(e) for e in of])), float(width)
    return f"{100 * shown[0]:.0f}; {100 * shown[1]:.1f} ± {100 * shown[2]:.1f}"


def _row(name: str, records: Sequence[Record]) -> str:
    done = [r for r in records if r["verdict"] is not None]
    bet = [r for r in done if r["verdict"]["trust"] in _BET]
    doubt = [r for r in done if r["verdict"]["trust"] == "do_not_bet"]
    counts = Counter(r["verdict"]["trust"] for r in done)
    verdicts = ", ".join(f"{counts[t]} {t.replace('_', ' ')}" for t in sorted(counts)) or "none"
    cells = [_cells(group, q) for group in (bet, doubt) for q in MAIN]
    return f"| {name} | {len(records)} | {verdicts} | " + " | ".join(cells) + " |"


def _criteria(records: Sequence[Record]) -> list[str]:
    done = [r for r in records if r["verdict"] is not None and main_entries(r)]
    bet = [r for r in done if r["verdict"]["trust"] in _BET]
    doubt = [r for r in done if r["verdict"]["trust"] == "do_not_bet"]
    lines = ["| criterion | asked | found |", "|---|---|---|"]
    for q in MAIN:
        held = [holds(e) for r in bet for e in r["entries"] if e["quantity"] == q]
        lines.append(f"| {q} held, where one may bet | 88 to 94 % | {_share(held)} |")
    worst = []
    for kind in dict.fromkeys(r["kind"] for r in bet):
        for q in MAIN:
            held = [holds(e) for r in bet if r["kind"] == kind for e in r["entries"] if e["quantity"] == q]
            if held:
                worst.append((float(np.mean(held)), f"{kind}, {q}: {_share(held)}"))
    lines.append(f"| the worst kind, where one may bet | 80 % or more | {min(worst)[1] if worst else 'none'} |")
    missed = [r["verdict"]["trust"] == "do_not_bet" for r in done if np.mean([holds(e) for e in main_entries(r)]) < 0.5]
    lines.append(f"| *do not bet* where fewer than half of k, c and peaks hold | 95 % | {_share(missed)} |")
    deserved = [deserves_doubt(r) for r in doubt]
    lines.append(f"| *do not bet* that is deserved | 70 % | {_share(deserved)} |")
    for name, group in (("linear", [r for r in done if r["linear"]]), ("other", [r for r in done if not r["linear"]])):
        for q in ("k", "c"):
            of = [0.5 * (e["interval"][2] - e["interval"][0]) / e["interval"][1] for r in group for e in r["entries"]
                  if e["quantity"] == q]  # fmt: skip
            lines.append(
                f"| median half-width of {q}, {name} trucks | | "
                + (f"{100 * np.median(of):.1f} %" if of else "none")
                + " |"
            )
    for q, name in (
        ("kt", "kt"),
        ("ct", "ct"),
        ("friction", "friction"),
        ("drop k", "k of usable drops"),
        ("drop c", "c of usable drops"),
    ):
        held = [holds(e) for r in done for e in r["entries"] if e["quantity"] == q]
        lines.append(f"| {name} held | | {_share(held)} |")
    codes = Counter(r["code"] for r in records if r["code"] != 0)
    listed = ", ".join(f"{n} with exit code {c}" for c, n in sorted(codes.items())) or "none"
    lines.append(f"| refused, stopped or not converged | 0 | {listed} |")
    seconds = [r["processor_s"] for r in records]
    lines.append(f"| processor time, median and largest | | {np.median(seconds):.0f} s, {max(seconds):.0f} s |")
    return lines


def tables(records: Sequence[Record]) -> str:
    """Markdown of all records: criteria, then kinds."""
    if not records:
        return "No campaigns yet."
    head = "| trucks | campaigns | verdicts | may bet: k | c | peaks | do not bet: k | c | peaks |"
    lines = [*_criteria(records), "", "Held in %; median error ± median half-width in %.", "", head]
    lines += ["|---|---:|---|---|---|---|---|---|---|", _row("all", records)]
    for name in dict.fromkeys(r["vehicle"] for r in records):
        lines.append(_row(name, [r for r in records if r["vehicle"] == name]))
    for kind in dict.fromkeys(r["kind"] for r in records):
        lines.append(_row(kind, [r for r in records if r["kind"] == kind]))
    for r in records:
        if r["verdict"] is None:
            said = (r["said"].strip().splitlines() or [""])[-1][:200].replace("|", "/")
            lines += ["", f"- {r['kind']}, {r['vehicle']}, number {r['number']}: exit code {r['code']}. {said}"]
    return "\n".join(lines)


def write(records: Sequence[Record], document: Path) -> None:
    """Replace the table between its marks in a document."""
    write_between_marks(document, "made trucks", tables(records))
