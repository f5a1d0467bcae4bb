"""The command `watch`: a test day as it happens, said line by line."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console

from sysid.cli.guarded import guarded
from sysid.cli.tables import render
from sysid.display import TextTable
from sysid.folder_lock import FolderLock, writing_to
from sysid.numbers import listing
from sysid.wording import shorten
from sysid.workflow.stage import Blocks

if TYPE_CHECKING:
    from sysid.watch import DayReport, KnownAxle, KnownValue, LogVerdict, PlannedTest, StopRule, TestDay

#: How often the folder is looked at in one pass [s], and how long that waits for files that still grow.
_SOON_S, _GROWING_S = 0.25, 10.0
_ANSWERS = {
    "good": "good",
    "look": "look at this",
    "repeat": "REPEAT THIS TEST",
    "unlisted": "not in the campaign file",
}
#: Sentences about what is missing that one report shows.
_MISSING = 6


@dataclass(frozen=True)
class WatchChoices:
    """Options of the command: where to write, which campaign file, how to look, what is asked for."""

    output: Path
    campaign: Path | None
    begin: bool
    once: bool
    every_s: float
    estimates: bool
    stiffness_percent: float
    damping_percent: float
    as_json: bool
    page: bool
    port: int
    opens: bool


def run_watch(folder: Path, choices: WatchChoices) -> int:
    """Watch the folder until it is stopped, or look once; the exit code."""

    def do(screen: Console, errors: Console) -> int:
        from sysid.watch import TestDay

        rule = _rule(choices)
        day = TestDay(folder, choices.output, choices.campaign, rule, choices.estimates, begin=choices.begin)
        with FolderLock(day.output), writing_to(day.output), _page(day, choices, errors) as show:
            try:
                for report in _once(day, errors) if choices.once else _for_ever(day, choices.every_s):
                    show(report)
                    if report is None:
                        continue
                    if choices.as_json:
                        # Not by the console, which would fold long lines.
                        click.echo(_json(report))
                    else:
                        render(screen, show_report(report))
            finally:
                day.stop()
        return 0

    return guarded("watch", f"Stopped. What is known is kept in {choices.output}; start again to go on.", do)


@contextmanager
def _page(day: TestDay, choices: WatchChoices, errors: Console) -> Iterator[Callable[[DayReport | None], None]]:
    """What brings the page up to date after a look; nothing where no page was asked for."""
    if not (choices.page or choices.opens):
        yield lambda report: None
        return
    from sysid.watch.page import day_page, day_part
    from sysid.watch.server import PageServer

    server = PageServer(day_page, choices.port)
    rule = _rule(choices)
    known: DayReport | None = None
    last: tuple[LogVerdict, ...] = ()

    def show(report: DayReport | None) -> None:
        nonlocal known, last
        now = report or known
        # That a file is complete need not be worth a report.
        now = None if now is None else replace(now, growing=day.growing)
        if now != known:
            known, last = now, (report.new if report is not None else ()) or last
            server.show(day_part(known, last, day.vehicle, rule, day.last_run))

    server.show(day_part(None, (), None, rule))
    server.start()
    try:
        errors.print(f"Page: {server.address}", markup=False, soft_wrap=True)
        if choices.opens:
            import webbrowser

            webbrowser.open(server.address)
        yield show
    finally:
        server.stop()


def _rule(choices: WatchChoices) -> StopRule:
    from sysid.watch import StopRule

    return StopRule(choices.stiffness_percent / 100.0, choices.damping_percent / 100.0)


def _once(day: TestDay, errors: Console) -> Iterator[DayReport]:
    """One report of all that is there, when nothing grows or is computed any more."""
    from sysid.cli.progress import StageProgress

    last: DayReport | None = None
    remarks: list[str] = []
    begun = time.monotonic()
    with StageProgress(errors) as progress:
        progress.stage("reading logs")
        while True:
            report = day.look()
            if report is not None:
                last = report
                remarks += report.remarks
            if not day.computing and (not day.growing or time.monotonic() - begun > _GROWING_S):
                break
            progress.stage(last.computing if last is not None and day.computing else "waiting for logs that grow")
            time.sleep(_SOON_S)
    if last is not None:
        yield replace(last, new=last.logs, remarks=tuple(remarks), growing=day.growing)


def _for_ever(day: TestDay, every_s: float) -> Iterator[DayReport | None]:
    """What every look brings, None where that is nothing new."""
    while True:
        yield day.look()
        time.sleep(every_s)


def _json(report: DayReport) -> str:
    def plain(value: Any) -> Any:
        if isinstance(value, float) and not math.isfinite(value):
            return None
        if isinstance(value, dict):
            return {k: plain(v) for k, v in value.items()}
        return [plain(v) for v in value] if isinstance(value, list | tuple) else value

    return json.dumps(plain(asdict(report)), ensure_ascii=False, allow_nan=False)


def show_report(report: DayReport) -> Blocks:
    """What is new: every log with its answer, what is known, what to do next."""
    for verdict in report.new:
        yield from _verdict_lines(verdict)
    yield from report.remarks
    if report.growing:
        yield f"Still written: {listing([shorten(name, 100) for name in report.growing])}"
    if report.planned and report.new:
        yield _tests(report.planned)
    if not report.logs:
        return
    if any(row.stiffness or row.damping for row in report.known):
        yield _known(report.known)
    if report.computing:
        yield f"Computing: {report.computing} ..."
        return
    if not report.enough and report.missing:
        more = len(report.missing) - _MISSING
        yield "Not enough yet: " + " ".join(report.missing[:_MISSING]) + (f" ... {more} more." if more > 0 else "")
    yield from report.next_tests


def _verdict_lines(verdict: LogVerdict) -> Iterator[str]:
    what = f" ({verdict.test})" if verdict.test else ""
    yield f"{shorten(verdict.file, 100)}{what}: {_ANSWERS[verdict.answer]}"
    yield from (f"  {sentence}" for sentence in verdict.reasons)
    yield from (f"  note: {sentence}" for sentence in verdict.notes)


def _tests(planned: tuple[PlannedTest, ...]) -> TextTable:
    """How many tests of each kind are there, of how many."""
    table = TextTable("Tests", ("test", "there", "planned"))
    kinds: dict[str, list[PlannedTest]] = {}
    for test in planned:
        kinds.setdefault(test.words.split(", repeat ")[0], []).append(test)
    for words, tests in kinds.items():
        table.add_row(words, str(sum(test.there for test in tests)), str(len(tests)))
    return table


def _known(known: tuple[KnownAxle, ...]) -> TextTable:
    head = ("axle", "load case", "k kN/m", "± %", "by", "c kN s/m", "± %", "by")
    table = TextTable("Known so far (90 % intervals; a preview)", head)
    for row in known:
        cells = (*_cells(row.stiffness), *_cells(row.damping))
        table.add_row(f"{row.axle} {row.name}", row.load_case or "all", *cells)
    return table


def _cells(value: KnownValue | None) -> tuple[str, str, str]:
    if value is None:
        return "not known", "-", "-"
    by = {"fit": "fit", "balance": "force balance", "drops": "drops"}[value.source]
    return f"{value.value / 1e3:.4g}", f"{100.0 * value.half_width:.2g}", f"{by}, before" if value.older else by
