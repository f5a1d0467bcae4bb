"""The command line: ``calibrate.py STAGE [CAMPAIGN] [--output DIR]``.

Exit codes: 0 done, 1 unexpected error, 2 bad command or campaign file, 3 data rejected or output folder cannot be
written, 4 not converged (results are still written and marked so), 130 stopped by Ctrl-C (what is done is kept).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from sysid.cli import output_option
from sysid.cli.calibration_options import calibration_options, decorated
from sysid.cli.fleet_help import FLEET_HELP
from sysid.cli.invocation import MODULE
from sysid.cli.later import LaterGroup
from sysid.runtime import own_process
from sysid.version import VERSION
from sysid.workflow.stage import Option
from sysid.workflow.stages import RECORDS

DEFAULT_CAMPAIGN = "data/campaign.toml"
DEFAULT_OUTPUT = "output"
_FOLDER = click.Path(exists=True, file_okay=False, path_type=Path)

_HELP = """Suspension stiffness and damping of a heavy vehicle from plank drops and bump runs.

CAMPAIGN is a campaign.toml or its folder (default: data/campaign.toml).  Every stage runs the stages it needs first and
leaves its results in the output folder for the next.

Exit codes: 0 done, 1 unexpected error, 2 bad command or campaign file, 3 data rejected or output folder cannot be
written, 4 not converged (results are still written and marked so), 130 stopped by Ctrl-C.
"""


def _options(command: Callable[..., Any]) -> Callable[..., Any]:
    return decorated(
        command,
        click.argument("campaign", default=DEFAULT_CAMPAIGN, type=click.Path(path_type=Path)),
        click.option("--output", default=DEFAULT_OUTPUT, show_default=True, help="Folder for everything written.",
                     type=output_option.folder),
        calibration_options,
        click.option("--resume", is_flag=True, help="Continue an interrupted run from what is in the output folder."),
        click.option("--json", "as_json", is_flag=True,
                     help="Print the results as the text of result.json instead of tables, for other programs."),
    )  # fmt: skip


class _InOrder(click.Group):
    """Lists its commands in the order in which they were added: that of the stages."""

    def list_commands(self, context: click.Context) -> list[str]:
        return list(self.commands)


def _show_version(context: click.Context, option: click.Parameter, wanted: bool) -> None:
    if wanted and not context.resilient_parsing:
        click.echo(f"sysid {VERSION}")
        context.exit()


@click.group(cls=_InOrder, help=_HELP, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--version", is_flag=True, is_eager=True, expose_value=False, callback=_show_version,
              help="Show the version and stop.")  # fmt: skip
def cli() -> None:
    """Entry point of all stages."""


def _click_option(option: Option) -> Callable[..., Any]:
    """An option of a stage's record as click takes it."""
    kind: Any = option.kind
    if option.choices:
        kind = click.Choice(list(option.choices))
    elif option.limits is not None:
        low, high = option.limits
        number = option.kind is int
        kind = click.IntRange(int(low), int(high)) if number else click.FloatRange(low, high, min_open=option.above)
    if option.kind is bool:
        return click.option(option.flag, option.name, is_flag=True, help=option.help)
    return click.option(
        option.flag,
        option.name,
        default=None,
        multiple=option.multiple,
        required=option.required,
        metavar=option.metavar,
        help=option.help,
        type=kind,
    )


def _add(name: str, text: str, options: Sequence[Option] = ()) -> None:
    def command(campaign: Path, output: Path, resume: bool, **choices: Any) -> None:
        if name == "check":
            from sysid.cli.unfinished import run_check

            sys.exit(run_check(campaign, output, resume=resume, **choices))
        from sysid.cli.stages import run_stage

        sys.exit(run_stage(name, campaign, output, resume=resume, **choices))

    for option in reversed(options):
        command = _click_option(option)(command)
    if name in ("run", "report"):
        command = click.option("--open", "opens", is_flag=True, help="Open the report in the browser.")(command)
    cli.command(name, help=text)(_options(command))


@cli.command("init")
@click.argument("folder", type=_FOLDER)
@click.option(
    "--vehicle",
    default=None,
    help="Template of the vehicle: rigid2, rigid3, rigid4, semitrailer4, "
    "semitrailer5 or lowboy6 (default: by the number and arrivals of the axles).",
)
@click.option(
    "--output", default=None, type=click.Path(path_type=Path), help="File to write (default: campaign.toml in FOLDER)."
)
@click.option("--force", is_flag=True, help="Write over an existing file.")
def init(folder: Path, vehicle: str | None, output: Path | None, force: bool) -> None:
    """Write a first campaign file from the logs and scans in FOLDER. Its comments say what to complete."""
    from sysid.cli.init import run_init

    sys.exit(run_init(folder, vehicle, output, force))


for _record in RECORDS:
    if _record.command is not None:
        _add(_record.name, _record.command.help, _record.command.options)
_add(
    "run",
    "All stages in order, from check to report.html. Without profile, selftest and validate --leave-out; with --quick "
    "also without advise.",
)


@cli.command("selftest")
@click.argument("campaign", default=DEFAULT_CAMPAIGN, type=click.Path(path_type=Path))
@click.option(
    "--replicates", default=1, show_default=True, help="How many campaigns to simulate.", type=click.IntRange(1, 10000)
)
@click.option("--seed", default=0, show_default=True, help="Seed of everything random.", type=click.IntRange(0))
def selftest(campaign: Path, replicates: int, seed: int) -> None:
    """What these runs would teach: simulated, calibrated, compared. Their k and c are known; nothing is written."""
    from sysid.cli.selftest import run_selftest

    sys.exit(run_selftest(campaign, replicates, seed))


@cli.command("watch")
@click.argument("folder", type=_FOLDER)
@click.option("--output", default="watch_output", show_default=True, type=output_option.folder,
              help="Folder for everything written, outside of FOLDER.")  # fmt: skip
@click.option("--campaign", default=None, type=click.Path(exists=True, dir_okay=False, path_type=Path),
              help="Campaign file, with names relative to FOLDER (default: campaign.toml in FOLDER).")  # fmt: skip
@click.option("--init", "begin", is_flag=True, help="Write campaign.toml into FOLDER by what the first logs suggest.")
@click.option("--once", is_flag=True, help="Look at what is there, say all of it, and end.")
@click.option("--every", "every_s", default=2.0, show_default=True, metavar="S", type=click.FloatRange(0.2, 3600.0),
              help="Seconds between two looks.")  # fmt: skip
@click.option("--no-fit", is_flag=True, help="Check the logs, and estimate no k and c.")
@click.option(
    "--stiffness",
    "stiffness_percent",
    default=2.0,
    show_default=True,
    metavar="PERCENT",
    type=click.FloatRange(0.1, 100.0),
    help="Half width of the 90 % interval of every k that is enough.",
)
@click.option(
    "--damping",
    "damping_percent",
    default=5.0,
    show_default=True,
    metavar="PERCENT",
    type=click.FloatRange(0.1, 100.0),
    help="The same of every c.",
)
@click.option("--json", "as_json", is_flag=True, help="Print every report as one line of JSON.")
@click.option("--page", is_flag=True, help="Show the day on a page too, for a browser on this machine only.")
@click.option("--port", default=0, metavar="PORT", type=click.IntRange(0, 65535),
              help="Port of the page (default: one that is free).")  # fmt: skip
@click.option("--open", "opens", is_flag=True, help="Open the page in the browser.")
def watch(folder: Path, no_fit: bool, **choices: Any) -> None:
    """A test day: every log checked as it lands, k and c so far. It says what comes next, and when to stop."""
    from sysid.cli.watch import WatchChoices, run_watch

    sys.exit(run_watch(folder, WatchChoices(estimates=not no_fit, **choices)))


@cli.command("compare")
@click.argument("folders", nargs=-1, required=True, metavar="FOLDER FOLDER...", type=_FOLDER)
@click.option("--output", default="comparison", show_default=True, type=output_option.folder,
              help="Folder for page, figure and table.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print the comparison as JSON instead of tables.")
@click.option("--campaign", "campaigns", multiple=True, metavar="CAMPAIGN",
              type=click.Path(exists=True, path_type=Path),
              help="Campaign file of a folder, once for each in their order: the truck of each then drives the runs of "
                   "the other.")  # fmt: skip
@click.option("--nothing-shared", is_flag=True, help="Cancel no errors: the intervals are those of separate trucks.")
@click.option("--open", "opens", is_flag=True, help="Open the page in the browser.")
def compare(
    folders: tuple[Path, ...],
    output: Path,
    as_json: bool,
    campaigns: tuple[Path, ...],
    nothing_shared: bool,
    opens: bool,
) -> None:
    """Did it change? Finished campaigns beside the first of them. Output folders; shared errors are cancelled."""
    from sysid.cli.compare import run_compare

    sys.exit(run_compare(folders, output, as_json, not nothing_shared, opens, campaigns))


cli.add_command(LaterGroup("sysid.cli.fleet", "fleet", FLEET_HELP))


@cli.command("formats")
@click.argument("files", nargs=-1, type=click.Path(path_type=Path), metavar="[FILE]...")
def formats(files: tuple[Path, ...]) -> None:
    """Formats of logs that can be read here, or what FILE holds. Also which packages are missing."""
    from sysid.cli.formats import run_formats

    sys.exit(run_formats(files))


def main() -> None:
    """Run the command line."""
    own_process()
    name = Path(sys.argv[0]).name if sys.argv else "sysid"
    cli(prog_name=MODULE if name == "__main__.py" else name)


if __name__ == "__main__":
    main()
