"""The command `compare`: what differs between finished campaigns; page, figure and table of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console

from sysid.cli.guarded import guarded
from sysid.cli.tables import render
from sysid.display import TextTable, shown_unit
from sysid.numbers import fixed
from sysid.workflow.stage import Blocks

if TYPE_CHECKING:
    from sysid.comparison import Comparison, Comparisons


def run_compare(
    folders: tuple[Path, ...],
    output: Path,
    as_json: bool,
    cancel: bool,
    opens: bool,
    campaigns: tuple[Path, ...] = (),
) -> int:
    """Compare output folders, write page, figure and table, and return the exit code."""

    def do(screen: Console, errors: Console) -> int:
        from sysid.cli.progress import StageProgress
        from sysid.comparison import compare
        from sysid.comparison.files import comparison_json, write_comparison

        with StageProgress(errors) as progress:
            progress.stage("comparing")
            comparisons = compare(*folders, cancel=cancel, campaigns=campaigns)
            written = write_comparison(comparisons, output)
        if as_json:
            # Not by the console, which would fold long lines.
            click.echo(comparison_json(comparisons), nl=False)
        else:
            render(screen, show_comparisons(comparisons))
            for path in written:
                screen.print(str(path), markup=False, soft_wrap=True)
        if opens:
            import webbrowser

            webbrowser.open(written[0].resolve().as_uri())
        return 0

    return guarded("compare", "Stopped; nothing was written.", do)


def show_comparisons(comparisons: Comparisons) -> Blocks:
    """The answer for every pair, and its tables."""
    for pair in comparisons.pairs:
        yield from _show_pair(pair)


def _show_pair(pair: Comparison) -> Blocks:
    from sysid.comparison.differences import ERROR_RATE
    from sysid.comparison.page import (
        AGREEMENT,
        AGREEMENT_COLUMNS,
        HEADINGS,
        answer,
        change_words,
        higher_words,
        row_name,
        shared_words,
        value_words,
    )
    from sysid.comparison.records import FAMILIES

    yield f"{pair.second.label} against {pair.first.label}: {answer(pair)}"
    for family in FAMILIES:
        found = pair.of(family)
        if not found or family == "tires":
            continue
        table = TextTable(HEADINGS[family], ("quantity", "first", "second", "change %", "higher"))
        for d in found:
            first, second = value_words(d)
            words = "0 (one reading)" if d.log_sd == d.log_ratio == 0.0 else change_words(d).replace(" %", "")
            mark = "* " if d.changed else "  "
            name = f"{mark}{row_name(d)} {shown_unit(d.unit)[1]}"
            table.add_row(name, first, second, words, higher_words(d))
        yield table
    if pair.differences:
        yield (
            "* changed: among all quantities of its table, had none changed, one would look like this in fewer than "
            f"{100.0 * ERROR_RATE:g} % of comparisons. Higher: probability that the second value is. "
            "Brackets hold 90 %."
        )
    if pair.agreement:
        table = TextTable(AGREEMENT, AGREEMENT_COLUMNS)
        for a in pair.agreement:
            table.add_row(f"{a.run} ({a.recorded_by})", fixed(a.own, 2), fixed(a.other, 2))
        yield table
    yield shared_words(pair)
    yield from pair.remarks
