"""The commands of `fleet`: many campaigns side by side, their status, and what they say together."""

from __future__ import annotations

import os
import shlex
import sys
import time
from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from sysid.cli import output_option
from sysid.cli.calibration_options import calibration_options
from sysid.cli.fleet_help import FLEET_HELP
from sysid.cli.fleet_tables import MOST_ROWS, population_blocks, recalibration_blocks, status_blocks
from sysid.cli.guarded import guarded
from sysid.cli.invocation import command_line
from sysid.cli.progress import SILENCE_S, StageProgress
from sysid.cli.tables import render, show_command
from sysid.errors import CampaignError, NotConvergedError
from sysid.files import write_text
from sysid.folder_lock import writing_to
from sysid.wording import plain_text, shorten

if TYPE_CHECKING:
    from sysid.fleet.records import Fleet
    from sysid.fleet.results import FleetResults
    from sysid.fleet.running import RunOptions

DEFAULT_OUTPUT = "fleet_output"
#: Running campaigns that are named in a line.
MOST_RUNNING = 4
_STATES = {"done": "green", "not converged": "yellow", "running": "cyan", "queued": "dim"}


class _RunByDefault(click.Group):
    """Takes what is no name of a command for the fleet to run; lists its commands in the order of their use."""

    def parse_args(self, context: click.Context, arguments: list[str]) -> list[str]:
        if arguments and arguments[0] not in self.commands and arguments[0] not in ("-h", "--help"):
            arguments = ["run", *arguments]
        return super().parse_args(context, arguments)

    def list_commands(self, context: click.Context) -> list[str]:
        return list(self.commands)


@click.group(cls=_RunByDefault, help=FLEET_HELP)
def fleet() -> None:
    """Entry point of the commands of a fleet."""


_fleet_argument = click.argument("path", metavar="FLEET", type=click.Path(path_type=Path))
_output_option = click.option("--output", default=DEFAULT_OUTPUT, show_default=True, type=output_option.folder,
                              help="Folder for everything written.")  # fmt: skip
_workers_option = click.option("--workers", default=None, type=click.IntRange(1, 1024),
                               help="Campaigns at a time (default: as many as cores and memory allow).")  # fmt: skip
_scheduler_option = click.option("--scheduler", default=None, metavar="ADDRESS",
                                 help="Work on the cluster of this Dask scheduler; needs "
                                      "truck-sysid[cluster].")  # fmt: skip
_send_files_option = click.option("--send-files", is_flag=True,
                                  help="The workers of the cluster do not see these folders: send the files of every "
                                       "campaign, and fetch its results.")  # fmt: skip


_doubtful_option = click.option(
    "--with-doubtful", is_flag=True, help="Count campaigns too on whose numbers nobody should bet; remarks name them."
)


def _run_options(workers: int | None, scheduler: str | None, send_files: bool, **others: Any) -> RunOptions:
    from sysid.fleet.running import RunOptions

    if send_files and scheduler is None:
        raise CampaignError("--send-files is for the workers of a cluster; give its --scheduler too.")
    return RunOptions(workers, scheduler, send_files, **others)


def _command(function: Callable[..., int]) -> Callable[..., None]:
    """A command of `fleet` that leaves with the exit code of `function`, which prints on `screen` and `errors`."""

    @wraps(function)
    def leave(**options: Any) -> None:
        def do(screen: Console, errors: Console) -> int:
            return function(screen=screen, errors=errors, **options)

        stopped = "Stopped. What is done is kept; the same command goes on from there."
        sys.exit(guarded(f"fleet {function.__name__}", stopped, do))

    return leave


def _read(path: Path, errors: Console) -> Fleet:
    """The fleet; what was left out of it is said."""
    from sysid.fleet.read import read_fleet

    known = read_fleet(path)
    for message in known.messages:
        errors.print(message, markup=False)
    return known


def _computed(path: Path, output: Path, errors: Console, **options: bool) -> FleetResults:
    """Populations and loads of a fleet, with a progress bar."""
    from sysid.fleet.results import compute

    with StageProgress(errors) as progress:
        progress.stage("population")
        return compute(path, output, progress.update, **options)


@fleet.command("run")
@_fleet_argument
@_output_option
@_workers_option
@click.option("--retry", multiple=True, type=click.Choice(["failed", "not-converged"]),
              help="Try campaigns again that ended so; unchanged ones are otherwise left as they are.")  # fmt: skip
@click.option("--only", multiple=True, metavar="NAME", help="This campaign only; may be repeated.")
@_scheduler_option
@_send_files_option
@calibration_options
@_command
def run(
    screen: Console,
    errors: Console,
    path: Path,
    output: Path,
    workers: int | None,
    retry: tuple[str, ...],
    only: tuple[str, ...],
    scheduler: str | None,
    send_files: bool,
    **choices: Any,
) -> int:
    """Calibrate every campaign into its own folder. Several at a time; what is finished is not computed again."""
    from sysid.fleet.running import exit_code, run_fleet
    from sysid.fleet.status import write_status

    known = _read(path, errors)
    options = _run_options(workers, scheduler, send_files, retry=retry, only=only, choices=choices)
    with StatusView(errors, output) as view:
        rows = run_fleet(known, output, options, view.show)
    if not only:
        files = write_status(rows, output)
    render(screen, status_blocks(rows))
    if not only:
        screen.print(f"Table of all campaigns: {files[1]}", markup=False, soft_wrap=True)
    return exit_code(rows)


class StatusView:
    """The table while the fleet runs: live on a terminal, elsewhere a line for every campaign that ends, and one where
    none has come for a while.
    """

    def __init__(self, errors: Console, output: Path):
        self._errors, self._output = errors, output
        self._said: set[str] = set()
        self._begin = self._spoke = time.monotonic()
        self._live = Live(console=errors, refresh_per_second=2, transient=True) if errors.is_terminal else None

    def __enter__(self) -> StatusView:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *exception: object) -> None:
        if self._live is not None:
            self._live.stop()

    def show(self, rows: Sequence[Any]) -> None:
        """Show how far the campaigns are."""
        from sysid.fleet.status import stage_of

        if self._live is not None:
            self._live.update(self._table(rows))
            return
        ended = [row for row in rows if row.outcome is not None]
        for row in ended:
            if row.campaign not in self._said:
                self._said.add(row.campaign)
                why = f": {row.outcome.sentence}" if row.outcome.sentence else f", {row.outcome.seconds:.0f} s"
                self._print(f"{len(self._said)}/{len(rows)} {row.campaign}: {row.state}{why}")
        now = time.monotonic()
        if now - self._spoke >= SILENCE_S:
            running = [f"{r.campaign}, {stage_of(self._output, r.campaign)}" for r in rows if r.state == "running"]
            self._print(f"{now - self._begin:.0f} s: {'; '.join(running[:MOST_RUNNING]) or 'waiting'} ...")

    def _print(self, words: str) -> None:
        self._spoke = time.monotonic()
        self._errors.print(words, markup=False)

    def _table(self, rows: Sequence[Any]) -> Table:
        from sysid.fleet.status import stage_of, state_counts

        table = Table(
            title=", ".join(f"{n} {state}" for state, n in state_counts(rows).items()), box=None, title_justify="left"
        )
        for column in ("truck", "campaign", "state", "stage"):
            table.add_column(column)
        shown = [row for row in rows if row.state == "running"]
        shown += [row for row in rows if row.state not in ("running", "queued", "done")][-8:]
        for row in shown[:MOST_ROWS]:
            doing = stage_of(self._output, row.campaign) if row.state == "running" else row.outcome.sentence
            color = _STATES.get(row.state, "red")
            table.add_row(Text(row.truck), Text(row.campaign), Text(row.state, style=color), Text(shorten(doing, 90)))
        return table


@fleet.command("init")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--force", is_flag=True, help="Write over an existing file.")
@_command
def init(screen: Console, errors: Console, folder: Path, force: bool) -> int:
    """Begin a fleet.toml from the campaigns below FOLDER."""
    target, said = _write_fleet_file(folder, force)
    for message in said:
        errors.print(message, markup=False)
    screen.print(str(target), markup=False, soft_wrap=True)
    show_command(screen, "Look at trucks, types and dates in it, then", command_line("fleet", folder))
    return 0


def _write_fleet_file(folder: Path, force: bool) -> tuple[Path, list[str]]:
    from sysid.fleet.begin import fleet_text
    from sysid.fleet.read import FLEET_FILE

    if not folder.is_dir():
        raise CampaignError(f"{shorten(folder, 100)} is no folder; give the folder above the campaigns.")
    target = folder / FLEET_FILE
    if target.exists() and not force:
        raise CampaignError(f"{shorten(target, 100)} exists; give --force to write over it.")
    text, said = fleet_text(folder)
    with writing_to(folder):
        write_text(target, text)
    return target, said


@fleet.command("status")
@_fleet_argument
@_output_option
@_command
def status(screen: Console, errors: Console, path: Path, output: Path) -> int:
    """What has become of every campaign; nothing is computed."""
    from sysid.fleet.status import rows_on_disk

    render(screen, status_blocks(list(rows_on_disk(_read(path, errors), output))))
    return 0


@fleet.command("jobs")
@_fleet_argument
@_output_option
@calibration_options
@_command
def jobs(screen: Console, errors: Console, path: Path, output: Path, **choices: Any) -> int:
    """One command per campaign, a line each. For Slurm arrays, Snakemake, GNU parallel."""
    from sysid.fleet.key import typed_options

    words = [sys.executable, os.path.abspath(sys.argv[0]), "fleet", "run", str(path.resolve())]
    for name, value in typed_options(choices).items():
        flag = f"--{name.replace('_', '-')}"
        words += [flag] if value is True else [flag, str(value)]
    for _, campaign in _read(path, errors).campaigns():
        line = [*words, "--output", str(output.resolve()), "--workers", "1", "--only", campaign.name]
        # Not by the console: these lines are for other programs.
        click.echo(_on_a_line(line))
    return 0


def _on_a_line(words: list[str]) -> str:
    """A command to the letter; CampaignError where a terminal would obey it or a reader of lines cut it."""
    line = shlex.join(words)
    if plain_text(line) != line or "\n" in line:
        raise CampaignError(
            f"The paths of campaign {shorten(words[-1])} have characters that are not shown ({shorten(line, 200)}), so "
            "that its command cannot stand on a line; rename the folder."
        )
    return line


@fleet.command("population")
@_fleet_argument
@_output_option
@_doubtful_option
@_command
def population(screen: Console, errors: Console, path: Path, output: Path, with_doubtful: bool) -> int:
    """Mean and spread of every type of truck, and outliers. It needs three trucks with results."""
    results = _computed(path, output, errors, with_doubtful=with_doubtful)
    render(screen, population_blocks(results.populations, results.loads, results.remarks))
    screen.print(f"All numbers: {results.file}", markup=False, soft_wrap=True)
    return 0 if all(p.converged for p in results.populations) else NotConvergedError.exit_code


@fleet.command("recalibrate")
@_fleet_argument
@_output_option
@_workers_option
@_scheduler_option
@_send_files_option
@_doubtful_option
@_command
def recalibrate(
    screen: Console,
    errors: Console,
    path: Path,
    output: Path,
    workers: int | None,
    scheduler: str | None,
    send_files: bool,
    with_doubtful: bool,
) -> int:
    """Sample campaigns anew whose draws miss their population. They are sampled under the population."""
    from sysid.fleet.running import exit_code, recalibrate

    options = _run_options(workers, scheduler, send_files)
    before = _computed(path, output, errors, with_doubtful=with_doubtful)
    priors = {name: prior for p in before.populations for name, prior in p.of_others.items()}
    if not priors:
        screen.print("The draws of every campaign reach where the population puts its truck: nothing to do.")
        return 0
    with StatusView(errors, output) as view:
        rows = recalibrate(before.fleet, output, priors, options, view.show)
    after = _computed(path, output, errors, with_doubtful=with_doubtful)
    render(screen, recalibration_blocks(rows, before.populations, after.populations))
    screen.print(f"All numbers: {after.file}", markup=False, soft_wrap=True)
    return exit_code(rows)


@fleet.command("index")
@_fleet_argument
@_output_option
@_command
def index(screen: Console, errors: Console, path: Path, output: Path) -> int:
    """Parquet tables of all campaigns. For queries by DuckDB or pandas; needs truck-sysid[parquet]."""
    from sysid.fleet.index import write_index

    with StageProgress(errors) as progress:
        progress.stage("tables")
        written = write_index(_read(path, errors), output)
    screen.print(str(written), markup=False, soft_wrap=True)
    return 0


@fleet.command("report")
@_fleet_argument
@_output_option
@_doubtful_option
@_command
def report(screen: Console, errors: Console, path: Path, output: Path, with_doubtful: bool) -> int:
    """One page of all trucks, with links to their reports. Map by k and c, shrinkage, outliers, axle loads, quality."""
    from sysid.fleet.page import write_fleet_page

    results = _computed(path, output, errors, with_doubtful=with_doubtful, without_population=True)
    with StageProgress(errors) as progress:
        progress.stage("page")
        page = write_fleet_page(results, results.rows, output)
    screen.print(str(page), markup=False, soft_wrap=True)
    return 0
