"""The last screen of a whole run: k and c, the largest axle loads, whether to use them, and what to do next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.display import CommandHint, TextTable
from sysid.numbers import MISSING, count, fixed
from sysid.results.headline import (
    PeakLoad,
    answer_words,
    estimate_words,
    in_thousands,
    largest_at_any_speed,
    largest_loads,
    loads_answer,
    suspension_rows,
)
from sysid.results.judgement import judge
from sysid.results.next_steps import next_steps
from sysid.workflow.stage import Blocks

if TYPE_CHECKING:
    from sysid.campaign.records import Campaign
    from sysid.results.contents import Results

#: Reasons that are told; the report has all.
_REASONS = 3


def show_run(results: Results, report: Path) -> Blocks:
    """The answer of a whole calibration."""
    yield from _suspension(results)
    yield from _loads(results)
    judgement = results.judgement or judge(results)
    yield f"Can you use k and c? {answer_words(results, judgement)}."
    for number, reason in enumerate(judgement.reasons[:_REASONS], start=1):
        yield f"  {number}. {reason}" if len(judgement.reasons) > 1 else f"  {reason}"
    more = len(judgement.reasons) - _REASONS
    if more > 0:
        yield f"  {count(more, 'more reason')} in the report."
    if loads := loads_answer(results, judgement):
        yield f"Can you use the axle loads? {loads.words}."
        for words in filter(None, (loads.largest, loads.computed, loads.sentences)):
            yield f"  {words}"
    if steps := next_steps(results, judgement):
        yield f"Next: {steps[0]}"
    yield f"Report: {report}"
    yield _command(results)


def _suspension(results: Results) -> Iterator[TextTable]:
    rows = suspension_rows(results)
    if not rows:
        return
    table = TextTable("k and c, both sides, ± half of the 90 % interval", ("axle", "k kN/m", "c kN s/m"))
    for row in rows:
        case = "" if row.load_case is None else f", {row.load_case}"
        table.add_row(
            _axle(results.campaign, row.axle) + case, estimate_words(row.stiffness), estimate_words(row.damping)
        )
    yield table


def _axle(campaign: Campaign, axle: int) -> str:
    return f"{axle + 1} {campaign.vehicle.axles[axle].name}"


def _loads(results: Results) -> Iterator[TextTable | str]:
    loads = largest_loads(results)
    if not loads:
        return
    driven = largest_at_any_speed(results, as_driven=True)
    if any(driven):
        yield _load_table(results, "Axle loads as driven, the largest of every axle at any speed", driven)
    passes = 0 if results.predictions is None else len(results.predictions.passes)
    title = f"Axle loads in {count(passes, 'predicted pass', 'predicted passes')}, the largest of every axle"
    yield _load_table(results, title, loads)
    if any(load.beyond for load in loads):
        yield "* beyond what the driven runs reached: an extrapolation."


def _load_table(results: Results, title: str, loads: Sequence[PeakLoad | None]) -> TextTable:
    table = TextTable(title, ("axle", "static kN", "peak kN", "of static", "in"))
    for axle, load in enumerate(loads):
        if load is None:
            table.add_row(_axle(results.campaign, axle), *[MISSING] * 4)
            continue
        table.add_row(
            _axle(results.campaign, axle),
            fixed(load.static_N / 1e3, 1),
            in_thousands(load.peak_N, load.low_N, load.high_N) + ("*" if load.beyond else ""),
            f"{fixed(100.0 * load.ratio, 0)} %",
            load.pass_name,
        )
    return table


def _command(results: Results) -> CommandHint:
    """One command to go on with."""
    if results.status == "preview":
        return CommandHint("For numbers that can be used", ("run",))
    if results.fit is not None and not results.fit.converged:
        return CommandHint("Look at the logs: the fit did not converge", ("check",))
    if results.status == "not_converged":
        return CommandHint("Continue the chain with a larger --max-steps", ("run", "--resume"))
    return CommandHint("For axle loads at another speed", ("predict", "--speed", "60"))
