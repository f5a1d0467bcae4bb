"""Prints what the records of the stages say is shown, and the answer of a whole run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from sysid.cli.invocation import program
from sysid.display import CommandHint, TextTable
from sysid.workflow.stage import Blocks
from sysid.workflow.stages.loads import show_predict
from sysid.workflow.stages.posterior import show_sample

if TYPE_CHECKING:
    from sysid.results.contents import Results
    from sysid.workflow import Calibration


def plain_table(title: str, columns: Sequence[str]) -> Table:
    """A table without lines; the first column to the left, the others to the right."""
    table = Table(title=title, title_justify="left", header_style="bold", box=None, pad_edge=False)
    for i, column in enumerate(columns):
        table.add_column(column, justify="left" if i == 0 else "right")
    return table


def render(screen: Console, blocks: Blocks) -> None:
    """Print tables and sentences; names that users chose are never taken for markup."""
    for block in blocks:
        if isinstance(block, TextTable):
            table = plain_table(escape(block.title), [escape(column) for column in block.columns])
            for row in block.rows:
                table.add_row(*map(escape, row))
            screen.print(table)
        elif isinstance(block, CommandHint):
            screen.print(f"{block.text}: {program()} {block.command}.", markup=False)
        else:
            screen.print(block, markup=False)


def show_run(results: Results, calibration: Calibration) -> Blocks:
    """The answer of a whole calibration: k and c with intervals, status and where to read on."""
    if results.posterior is not None:
        yield from show_sample(results.posterior, results)
    if results.predictions is not None:
        yield from show_predict(results.predictions, results)
    # Those of the passes stand below their tables already.
    said = {w for p in results.predictions.passes for w in p.warnings} if results.predictions is not None else set()
    for warning in results.all_warnings:
        if warning not in said:
            yield f"Note: {warning}"
    yield f"Status: {results.status}. Report: {calibration.output / 'report.html'}"
