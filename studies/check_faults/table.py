"""Tables of the study: what faults end in by family, which are silent, and what is said of healthy campaigns."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from studies.check_faults.effects import HARMLESS_C, HARMLESS_K
from studies.documents import write_between_marks

ENDINGS = ("stopped", "warned", "other", "silent")


def share_named(records: Sequence[dict[str, Any]]) -> float:
    """Share of harmful faults that are named: stopped or warned of with the right accusation."""
    harmful = _harmful(records)
    return sum(r["ending"] in ("stopped", "warned") for r in harmful) / max(1, len(harmful))


def falsely_accused(records: Sequence[dict[str, Any]]) -> tuple[int, int]:
    """Healthy channel records that are accused, and channel records of all cases."""
    done = [r for r in records if r["ending"] != "does not apply"]
    return sum(len(r["falsely"]) for r in done), sum(r["records"] for r in done)


def _harmful(records: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    return [r for r in records if r["ending"] != "does not apply" and not r["harmless"]]


def fault_table(records: Sequence[dict[str, Any]]) -> str:
    """Markdown: endings of the harmful faults by family, and those that are harmless."""
    lines = [
        "| family | cases | stopped, rightly | warned, rightly | something else said | silent | named |",
        "|---|---|---|---|---|---|---|",
    ]
    families = list(dict.fromkeys(r["family"] for r in records))
    for name in (*families, "all"):
        of_family = [r for r in _harmful(records) if name in ("all", r["family"])]
        counts = [sum(r["ending"] == e for r in of_family) for e in ENDINGS]
        cells = [name, str(len(of_family)), *map(str, counts), f"{100 * share_named(of_family):.0f} %"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def unnamed(records: Sequence[dict[str, Any]]) -> str:
    """Markdown: harmful faults that are not named, and harmless ones with the reason."""
    lines = ["| fault | campaign | ends in |", "|---|---|---|"]
    for r in _harmful(records):
        if r["ending"] in ("other", "silent"):
            lines.append(f"| {r['said']} | {r['base']} | {r['ending']} |")
    reasons = sorted({(r["fault"], r["harmless"]) for r in records if r.get("harmless")})
    lines += ["", "Taken as harmless, by reasoning:", ""]
    lines += [f"- {fault}: {reason};" for fault, reason in reasons]
    return "\n".join(lines)


def effect_table(records: Sequence[dict[str, Any]]) -> str:
    """Markdown: what the faults that passed do to k and c of the three-axle campaign."""
    lines = ["| fault that passed, put into the three-axle campaign | k changes by | c changes by |", "|---|---|---|"]
    for r in sorted(records, key=lambda r: -float(r.get("k", -1.0))):
        if r["ends"] in ("fitted", "same readings"):
            exact = r["ends"] == "same readings"
            shown = ["0 (the same readings)"] * 2 if exact else [f"{100 * r['k']:.2g} %", f"{100 * r['c']:.2g} %"]
            lines.append(f"| {r['said']} | {shown[0]} | {shown[1]} |")
        elif r["ends"] == "no fit":
            lines.append(f"| {r['said']} | stopped there | |")
    measured = [r for r in records if r["ends"] in ("fitted", "same readings")]
    harmless = sum(r["k"] <= HARMLESS_K and r["c"] <= HARMLESS_C for r in measured)
    both = sum(r["k"] > HARMLESS_K and r["c"] > HARMLESS_C for r in measured)
    said = (
        f"{len(measured)} faults passed on some campaign: {harmless} change no k by more than {100 * HARMLESS_K:.0f} % "
        f"and no c by more than {100 * HARMLESS_C:.0f} %, {both} change both by more."
    )
    return "\n".join([said, "", *lines])


def healthy_table(records: Sequence[dict[str, Any]]) -> str:
    """Markdown: what is said of healthy campaigns."""
    accused = [r for r in records if r["accusing"] or r["rejected"]]
    lines = [
        f"{len(records)} healthy campaigns, {sum(r['records'] for r in records)} channel records: "
        f"{sum(len(r['rejected']) for r in records)} records rejected, {len(accused)} campaigns with a sentence that "
        "names a fault."
    ]
    lines += [f"- campaign {r['number']}: {text}" for r in accused for text in (*r["accusing"], *r["rejected"])]
    return "\n".join(lines)


def write(
    faults: Sequence[dict[str, Any]],
    healthy: Sequence[dict[str, Any]],
    effects: Sequence[dict[str, Any]],
    seed: int,
    document: Path,
) -> None:
    """Replace what stands between the marks of a document: of faults, and of healthy campaigns, where there are any.

    Each has marks of its own, so that healthy campaigns can be drawn again by themselves.
    """
    if healthy:
        write_between_marks(document, "healthy campaigns", f"Seed {seed}. {healthy_table(healthy)}")
    if not faults:
        return
    wrong, channels = falsely_accused(faults)
    applied = [r for r in faults if r["ending"] != "does not apply"]
    parts = [
        f"{len(applied)} cases with {len({r['fault'] for r in applied})} faults, seed {seed}.",
        fault_table(faults),
        f"Healthy channel records accused beside the faults: {wrong} of {channels} "
        f"({100 * wrong / max(1, channels):.2f} %).",
        "Not named:",
        unnamed(faults),
        effect_table(effects),
    ]
    body = "\n\n".join(parts)
    write_between_marks(document, "check faults", body)
