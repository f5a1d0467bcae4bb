"""The command line: ``calibrate.py STAGE [CAMPAIGN] [--output DIR]``.

Exit codes: 0 done, 1 unexpected error, 2 bad command or campaign file, 3 data rejected or output folder cannot be
written, 4 not converged (results are still written and marked so), 130 stopped by Ctrl-C (what is done is kept).
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

DEFAULT_CAMPAIGN = "data/campaign.toml"
DEFAULT_OUTPUT = "output"

_HELP = """Suspension stiffness and damping of a heavy vehicle from plank drops and bump runs.

CAMPAIGN is a campaign.toml or its folder (default: data/campaign.toml).  Every stage runs the stages it needs first and
leaves its results in the output folder for the next.

Exit codes: 0 done, 1 unexpected error, 2 bad command or campaign file, 3 data rejected or output folder cannot be
written, 4 not converged (results are still written and marked so), 130 stopped by Ctrl-C.
"""


def _options(command: Callable[..., Any]) -> Callable[..., Any]:
    decorators = [
        click.argument("campaign", default=DEFAULT_CAMPAIGN, type=click.Path(path_type=Path)),
        click.option("--output", default=DEFAULT_OUTPUT, show_default=True, help="Folder for everything written.",
                     type=click.Path(path_type=Path)),
        click.option("--quick", is_flag=True, help="Preview: few iterations, a short chain; results are marked so."),
        click.option("--seed", default=None, help="Seed of everything random (default: 0).", type=click.IntRange(0)),
        click.option("--max-steps", default=None, help="Limit of sampling steps per ensemble (default: 1500).",
                     type=click.IntRange(1)),
        click.option("--laws", default=None, type=click.Choice(["auto", "compare", "declared"]),
                     help="Suspension laws of axles without a declared one: richer ones where linear ones leave "
                          "residuals (auto), compared in any case, or as declared (default: auto)."),
        click.option("--contact", default=None, type=click.Choice(["footprint", "cams", "point"]),
                     help="Contact law of the tires: radial springs over the footprint, tandem elliptical cams, or a "
                          "point follower (default: footprint)."),
        click.option("--contact-spread", is_flag=True,
                     help="Repeat the fit with the other contact laws and show how far the results move."),
        click.option("--resume", is_flag=True, help="Go on with what an interrupted run left in the output folder."),
    ]  # fmt: skip
    for decorate in reversed(decorators):
        command = decorate(command)
    return command


@click.group(help=_HELP, context_settings={"help_option_names": ["-h", "--help"]})
def cli() -> None:
    """Entry point of all stages."""


_PASS_OPTIONS = (
    click.option("--speed", "speeds", multiple=True, type=click.FloatRange(0.0, 300.0, min_open=True),
                 help="Predict this speed [km/h] instead of the passes of the campaign; may be repeated."),
    click.option("--load-case", default=None, help="Load case of --speed (default: the first)."),
    click.option("--bump", default=None, metavar="NAME|FILE",
                 help="Bump of --speed: a scan of the campaign (default: the first), or a file with a profile "
                 "(CSV with station_m and height_m, or OpenCRG)."),
    click.option("--lateral", default=None, type=click.FloatRange(-1000.0, 1000.0),
                 help="Long section of an OpenCRG file, metres to the left of its reference line (default: 0)."),
    click.option("--shape", default=None, help="Another bump by its shape, with --height and --length.",
                 type=click.Choice(["watts", "sinusoidal", "half_sine", "parabolic", "trapezoid"])),
    click.option("--height", default=None, help="Height of the shape [m].", type=click.FloatRange(0.001, 1.0)),
    click.option("--length", default=None, help="Length of the shape [m].", type=click.FloatRange(0.01, 100.0)),
    click.option("--top", default=None, help="Flat top of a trapezoid [m] (default: a third of its length).",
                 type=click.FloatRange(0.0, 100.0)),
)  # fmt: skip


_ADVICE_OPTIONS = (
    click.option("--candidate-speed", "candidate_speeds", multiple=True,
                 type=click.FloatRange(0.0, 300.0, min_open=True),
                 help="Speed [km/h] of further runs to judge; may be repeated (default: 8, 16, 24, 32)."),
)  # fmt: skip

_PROFILE_OPTIONS = (
    click.option("--parameter", "profiled", multiple=True, required=True,
                 help="Parameter by its name in the fit, for example k_3; may be repeated."),
)  # fmt: skip


_LEAVE_OUT_OPTIONS = (
    click.option("--leave-out", "left_out", multiple=True, metavar="RUN",
                 help="Predict this run (its file) by a fit of all others; may be repeated."),
    click.option("--leave-one-out", is_flag=True, help="Predict every run, each by a fit of all others."),
)  # fmt: skip


def _stage(name: str, text: str, more: tuple[Callable[..., Any], ...] = ()) -> None:
    def command(campaign: Path, output: Path, resume: bool, **choices: Any) -> None:
        from sysid.cli.stages import run_stage

        sys.exit(run_stage(name, campaign, output, resume=resume, **choices))

    for decorate in reversed(more):
        command = decorate(command)
    cli.command(name, help=text)(_options(command))


_stage("check", "Quality of every log and channel: rate, gaps, clipping, wrong units, flipped signs.")
_stage("drops", "Stiffness and damping of every axle from its plank drops, equations (1)-(3) and corrections.")
_stage("fit", "Least-squares calibration of the vehicle model against all bump runs.")
_stage(
    "validate", "Agreement with the measured histories; of runs that no fit has seen, on request.", _LEAVE_OUT_OPTIONS
)
_stage("advise", "What to measure next: further runs and sensors ranked by what they would bring.", _ADVICE_OPTIONS)
_stage("profile", "Profile of the deviance of chosen parameters, all others optimised anew.", _PROFILE_OPTIONS)
_stage("sample", "Posterior of all parameters by emcee, continued until it has converged.")
_stage("crosscheck", "The posterior once more by a gradient-based sampler, and how far both agree; needs nutpie.")
_stage("predict", "Dynamic wheel loads of the passes that the campaign asks for, or of others.", _PASS_OPTIONS)
_stage("report", "Write report.html from the stages that have run.")
_stage(
    "export",
    "Write result.json, tables, posterior.nc and files for LS-DYNA, Chrono and bridge codes from finished stages.",
)
_stage(
    "run",
    "All stages in order, but for profile, crosscheck, selftest and validate --leave-out; advise not with --quick.",
)


@cli.command("selftest")
@click.argument("campaign", default=DEFAULT_CAMPAIGN, type=click.Path(path_type=Path))
@click.option(
    "--replicates", default=1, show_default=True, help="How many campaigns to simulate.", type=click.IntRange(1, 10000)
)
@click.option("--seed", default=0, show_default=True, help="Seed of everything random.", type=click.IntRange(0))
def selftest(campaign: Path, replicates: int, seed: int) -> None:
    """What the campaign would teach: simulate its runs with known k and c, calibrate them, compare; writes nothing."""
    from sysid.cli.selftest import run_selftest

    sys.exit(run_selftest(campaign, replicates, seed))


def main() -> None:
    """Run the command line."""
    cli(prog_name=Path(sys.argv[0]).name if sys.argv else "sysid")


if __name__ == "__main__":
    main()
