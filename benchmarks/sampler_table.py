"""The table of samplers on a page of the documentation, from its JSON file alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from studies.documents import write_between_marks


def write_table(found: dict[str, Any], document: Path) -> None:
    """Write the table between the marks ``samplers`` of a page."""
    write_between_marks(document, "samplers", table(found))


def table(found: dict[str, Any]) -> str:
    """Introduction and table."""
    machine = found["machine"]
    head = ("sampler", "processor (wall) [s]", "R-hat", "spread", "effective draws", "per processor second", "later")
    head += ("work per effective draw", "later")
    lines = [
        f"Log-density of the fit of `{found['campaign']}/` with {found['parameters']} parameters, as the stage",
        f"`sample` gets it. A likelihood in a batch takes {found['likelihood_s'] * 1e3:.2f} ms of processor time.",
        "Effective draws and R-hat are those of the worst parameter. *Work per effective draw* counts everything,",
        "burn-in too, in likelihoods. *Later* leaves burn-in and adapting out.",
        "*Spread*: standard deviations over those of the converged posterior. Walkers",
        "that start apart from each other and hardly move count as that many effective draws, of where they started:",
        "R-hat and spread tell. "
        f"{machine['cores']} cores, {machine['instruction_set']}, load "
        f"{machine['load_before']:.1f}.",
        "",
        f"| {' | '.join(head)} |",
        "|---" * len(head) + "|",
    ]
    lines += [_row(one) for one in found["samplers"].values()]
    lines += ["", *(f"- {one['name']}: {one['remark']}." for one in found["samplers"].values())]
    return "\n".join(lines)


def _row(one: dict[str, Any]) -> str:
    effective, kept, spread = one["effective"], one["share_kept"], one.get("sd_ratio")
    wide = "" if spread is None else f"{spread[0]:.2f} to {spread[1]:.2f}"
    rate, work = effective / one["processor_s"], one["likelihoods"] / effective
    return (
        f"| {one['name']} | {one['processor_s']:.0f} ({one['wall_s']:.0f}) | {one['rhat']:.3f} | {wide} | "
        f"{effective:.0f} | {rate:.2g} | {rate / kept:.2g} | {work:.0f} | {work * kept:.0f} |"
    )
