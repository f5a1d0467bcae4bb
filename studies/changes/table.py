"""Tables of the study of changes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from studies.coverage.shards import Record
from studies.documents import write_between_marks
from sysid.display import Z90


def holds(entry: Record) -> bool:
    """Whether the 90 % interval of a difference holds the true one."""
    return abs(entry["log_ratio"] - entry["truth"]) <= Z90 * entry["log_sd"]


def tables(records: Sequence[Record]) -> str:
    """Markdown: changes found, false alarms, intervals that hold and their widths.

    Intervals are those of pairs about which `compare` decides.  What was not fitted was not found.
    """
    good = [r for r in records if r["failed"] is None]
    decided = [r for r in good if not r["undecided"]]
    changed = [r for r in records if r["factor"] != 1.0]
    same = [r for r in records if r["factor"] == 1.0]
    found = sum(any(e["truth"] != 0.0 and e["changed"] for e in r["entries"]) for r in changed)
    wrong = sum(any(e["truth"] == 0.0 and e["changed"] for e in r["entries"]) or bool(r.get("also")) for r in changed)
    alarms = sum(any(e["changed"] for e in r["entries"]) or bool(r.get("also")) for r in same)
    entries = [e for r in decided for e in r["entries"]]
    lines = [
        "| pairs | one damper by 10 %: found | there something else called changed | unchanged: called changed "
        "| 90 % intervals of differences of k and c that hold | median half-width of c |",
        "|---:|---:|---:|---:|---:|---:|",
    ]
    width = np.median([Z90 * e["log_sd"] for e in entries if e["quantity"] == "damping"] or [np.nan])
    held = sum(map(holds, entries))
    share = 100.0 * held / max(len(entries), 1)
    lines.append(
        f"| {len(records)} | {found} of {len(changed)} | {wrong} of {len(changed)} | {alarms} of {len(same)} "
        f"| {held} of {len(entries)} ({share:.0f} %) | {100.0 * width:.2g} % |"
    )
    alone = [sd for r in decided for sd in r.get("log_sd_alone", ())]
    if alone:
        ratio = np.median(alone) / np.median([e["log_sd"] for e in entries])
        lines += ["", f"Without cancelling, intervals would be {ratio:.1f} times as wide (medians)."]
    apart = sum(any("do not agree" in s for s in r["remarks"]) for r in good)
    unsettled = sum("did not converge" in r["undecided"] for r in good)
    laws = sum(any("laws differ" in s for s in r["remarks"]) for r in good)
    lines += [
        "",
        f"Left undecided: {len(good) - len(decided)} of {len(good)} pairs, {unsettled} of them because a fit did not "
        "converge, the others because the campaigns contradict each other about the masses; intervals are those of the "
        f"other pairs. Shared errors on which the campaigns did not agree: {apart} pairs. Axles with other laws "
        f"before than after: {laws} of {len(good)} pairs. Not fitted: {len(records) - len(good)}.",
    ]
    return "\n".join(lines)


def write(records: Sequence[Record], seed: int, document: Path) -> None:
    """Rewrite the table of pairs by the program's own equations on a page."""
    _write("changes", "the program's own equations, so that only the statistics are tried", "", records, seed, document)


def write_independent(records: Sequence[Record], seed: int, document: Path) -> None:
    """Rewrite the table of pairs by independent equations on a page."""
    _write(
        "changes of independent trucks",
        "independent equations (friction, rockers, bending frames and more by turns)",
        "--independent ",
        records,
        seed,
        document,
    )


def _write(name: str, what: str, option: str, records: Sequence[Record], seed: int, document: Path) -> None:
    text = (
        f"Three-axle trucks by {what}; masses and tires off the declared ones by their tolerances, noise, speeds and "
        f"gains drawn anew for the second campaign (`python -m studies.changes {option}--seed {seed}`):\n\n"
    )
    write_between_marks(document, name, text + tables(records))
