"""The command `init`: from the folder of a logger to a commented campaign file."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from sysid.campaign.toml.reading import parse_toml
from sysid.campaign.toml.todo import find_doubts, find_todos
from sysid.cli.guarded import guarded
from sysid.cli.invocation import command_line
from sysid.cli.progress import StageProgress
from sysid.cli.tables import render, show_command
from sysid.display import TextTable
from sysid.errors import CampaignError, OutputError
from sysid.files import write_text
from sysid.numbers import count
from sysid.output_folder import has_control_characters
from sysid.wording import shorten

if TYPE_CHECKING:
    from sysid.first_look import EntryGuess, FirstLook

#: Rows of a table on a terminal.
_ROWS = 200


def run_init(folder: Path, vehicle: str | None, output: Path | None, force: bool) -> int:
    """Look at the folder, write the campaign file, and return the exit code."""

    def do(screen: Console, errors: Console) -> int:
        target, prefix = _target(folder, output, force)
        with StageProgress(errors) as progress:
            progress.stage("init")
            # What reads logs takes longer to load than the first word of progress may take.
            from sysid.first_look import campaign_text, first_look

            look = first_look(folder, vehicle, progress.update)
        text = campaign_text(look, shorten(folder.resolve().name, 60), command_line("check", target), prefix)
        _write(target, text)
        _show(screen, look, target, text)
        return 0

    return guarded("init", "Stopped; nothing was written.", do)


def _target(folder: Path, output: Path | None, force: bool) -> tuple[Path, str]:
    """The file to write, and the path from its folder to that of the logs."""
    target = folder / "campaign.toml" if output is None else output
    if target.is_dir():
        target = target / "campaign.toml"
    if has_control_characters(os.fspath(target)):
        raise CampaignError("--output contains control characters; give a name of letters, digits and signs.")
    if target.exists() and not force:
        raise CampaignError(f"{shorten(target, 100)} exists; give --force to write over it, or another --output.")
    try:
        below = folder.resolve().relative_to(target.resolve().parent)
    except ValueError:
        raise CampaignError(
            f"{shorten(target, 100)} is neither in the folder of the logs nor above it, and a campaign reads no files "
            "outside its own folder; write it into the folder of the logs or one above it."
        ) from None
    return target, "" if below == Path() else f"{below.as_posix()}/"


def _write(target: Path, text: str) -> None:
    parse_toml(text.encode("utf-8"), target.name)
    try:
        write_text(target, text)
    except OSError as error:
        reason = (error.strerror or "unknown reason").lower()
        raise OutputError(f"{shorten(target, 100)} cannot be written ({reason}); choose another --output.") from None


def _show(screen: Console, look: FirstLook, target: Path, text: str) -> None:
    from sysid.first_look import coverage_table

    render(screen, [_files(look), _columns(look), *look.messages, coverage_table(look)])
    todos, doubts = find_todos(parse_toml(text.encode("utf-8"), target.name)), find_doubts(text)
    drops, runs, drives = (sum(e.kind == kind for e in look.tests) for kind in ("plank_drop", "bump_run", "road_drive"))
    tests = (
        f"{drops} drops, {runs} runs and {count(drives, 'road drive')}" if drives else f"{drops} drops and {runs} runs"
    )
    columns = sum(s.unused is None for s in (*look.run_sensors, *look.drop_sensors))
    vehicle = f"vehicle {look.template.name}" if look.template else f"a vehicle with {look.axles} axles, no template"
    if not look.axles:
        vehicle = "nothing says how many axles: give --vehicle"
    screen.print(
        f"{tests}, {columns} columns of sensors, {vehicle}. Wrote {target}: "
        f"{len(todos)} values to fill in, {len(doubts)} guesses to confirm; its comments say which.",
        markup=False,
    )
    show_command(screen, "Next", command_line("check", target))


def _columns(look: FirstLook) -> TextTable:
    table = TextTable("Columns", ("column", "logs", "kind", "unit", "axle", "guess"))
    for tests, sensors in (("runs", look.run_sensors), ("drops", look.drop_sensors)):
        for s in sensors[:_ROWS]:
            of_drop = tests == "drops" and s.kind is not None
            axle = str(s.axle + 1) if s.axle is not None else "of the drop" if of_drop else "?"
            axle = "-" if s.unused is not None or s.kind in ("speed", "pitch_rate") else axle
            kind, unit = ("unused", "-") if s.unused is not None else (s.kind or "?", s.unit or "?")
            guess = "to confirm" if not s.sure else s.unused or ""
            table.add_row(shorten(s.column, 60), tests, kind, unit, axle, shorten(guess, 40))
    return table


def _files(look: FirstLook) -> TextTable:
    kinds = {entry.file: entry for entry in look.tests}
    table = TextTable("Files", ("file", "Hz", "length s", "taken for"))
    for log in look.logs[:_ROWS]:
        entry = kinds.get(log.file)
        if entry is None:
            of_run = any(log.file in files.values() for files in look.files.values())
            taken_for = "run, another logger" if of_run else f"left out: {look.left_out.get(log.file, '')}"
        else:
            taken_for = _taken_for(entry)
        table.add_row(
            shorten(log.file, 60),
            f"{log.rate_hz:.4g}",
            f"{log.duration_s:.3g}",
            taken_for,
        )
    for scan in look.scans[:_ROWS]:
        size = f"{scan.extent[0]:.3g} x {scan.extent[1]:.3g}"
        name = shorten(scan.file, 60)
        count, kind = (f"{scan.points} heights", "profile") if scan.levelled else (f"{scan.points} points", "scan")
        table.add_row(name, "-", f"{size} {scan.unit}", f"{kind}, {count}")
    return table


def _taken_for(entry: EntryGuess) -> str:
    what = {"plank_drop": "drop", "bump_run": "run", "road_drive": "road drive"}[entry.kind]
    detail = f", axle {entry.axle + 1}" if entry.axle is not None else ""
    detail += f", {entry.speed_km_h:g} km/h" if entry.speed_km_h is not None else ""
    return f"{what}, {entry.load_case or 'load case ?'}{detail}"
