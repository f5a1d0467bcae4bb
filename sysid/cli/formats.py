"""The command `formats`: which formats of logs can be read here, and what a file is and holds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console

from sysid.cli.guarded import guarded
from sysid.cli.invocation import tell
from sysid.cli.tables import render
from sysid.display import TextTable
from sysid.errors import DataRejectedError, SysidError
from sysid.first_look.log_columns import read_everything
from sysid.logs.by_library import installed
from sysid.logs.channels import LogContent, LogFormat, LogRequest
from sysid.logs.registry import FORMATS, format_of, read_channels
from sysid.logs.text_table import file_content
from sysid.wording import shorten

#: Channels of a file that are listed.
_NAMES = 40


def run_formats(files: Sequence[Path]) -> int:
    """Print the formats, or format and channels of every file; return the exit code."""

    def do(screen: Console, errors: Console) -> int:
        if not files:
            render(screen, [_table()])
        code = 0
        for path in files:
            try:
                _show_file(screen, path)
            except SysidError as error:
                tell(errors, "formats", str(error))
                code = max(code, error.exit_code)
        return code

    return guarded("formats", "Stopped.", do)


def _table() -> TextTable:
    table = TextTable("Formats of logs", ("format", "suffixes", "state", "to install"))
    for known in FORMATS:
        there = installed(known.libraries)
        command = "" if there or known.extra is None else f"python -m pip install 'truck-sysid[{known.extra}]'"
        table.add_row(
            f"{known.name}: {_noun(known)}", " ".join(known.suffixes), "ready" if there else "missing", command
        )
    return table


def _noun(known: LogFormat) -> str:
    return known.title.removeprefix("a ").removeprefix("an ")


def _show_file(screen: Console, path: Path) -> None:
    label = shorten(path.name, 100)
    file = file_content(path, label)
    known = format_of(file)
    refused = ""
    try:
        content, _ = read_everything(file, label)
    except DataRejectedError as error:
        content, refused = read_channels(file, label, LogRequest(())), str(error)
    names = content.names
    listed = ", ".join(f"'{shorten(n)}'" for n in names[:_NAMES]) + (", ..." if len(names) > _NAMES else "")
    screen.print(f"{label} is {known.title} with the channels {listed}.", markup=False)
    if content.channels:
        render(screen, [_clocks(content)])
    for said in (*content.messages, *content.left_out, refused):
        if said:
            screen.print(said, markup=False)


def _clocks(content: LogContent) -> TextTable:
    """The channels by the names that a campaign file may use, with their clocks: equal numbers are one clock."""
    table = TextTable(
        "", ("channel", "group", "unit", "samples", "missing", "clock", "rate [Hz]", "first stamp [s]", "stamps")
    )
    numbers: dict[int, int] = {}
    for channel in content.channels[:_NAMES]:
        clock = channel.clock
        known = clock.time_s[np.isfinite(clock.time_s)]
        step = float(np.median(np.diff(known))) if known.size > 1 else 0.0
        table.add_row(
            shorten(channel.name),
            shorten(channel.source.removesuffix(channel.name).rpartition("/")[0]),
            channel.unit or "",
            str(known.size),
            str(int(np.count_nonzero(np.isnan(channel.values) & np.isfinite(clock.time_s)))),
            str(numbers.setdefault(id(clock), len(numbers) + 1)),
            f"{1.0 / step:.6g}" if step > 0.0 else "",
            f"{known[0]:.10g}" if known.size else "",
            shorten(clock.name),
        )
    return table
