"""The command `selftest`: what a campaign would teach, from simulated readings; nothing is written."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape

from sysid.cli.guarded import guarded
from sysid.cli.invocation import configured, tell
from sysid.cli.progress import StageProgress
from sysid.cli.tables import plain_table
from sysid.display import shown_unit
from sysid.errors import NotConvergedError
from sysid.selftest.replicates import Replicate, SelfTest
from sysid.wording import shorten


def run_selftest(campaign: Path, count: int, seed: int) -> int:
    """Simulate and calibrate a campaign `count` times, print what was learned, and return the exit code."""

    def do(screen: Console, errors: Console) -> int:
        selftest = _simulated(campaign, count, seed, errors, partial(tell, errors, "selftest"))
        show_selftest(screen, selftest)
        return 0 if selftest.converged else NotConvergedError.exit_code

    return guarded("selftest", "Stopped; a self-test writes no files, so nothing is kept.", do)


def _simulated(campaign: Path, count: int, seed: int, errors: Console, say: Callable[[str], None]) -> SelfTest:
    from sysid.campaign.read import read_campaign
    from sysid.estimation.parameters.checked_priors import check_priors
    from sysid.road.point_cloud import read_point_cloud
    from sysid.road.profile_files import bump_from_file
    from sysid.road.scan import analyse_scan
    from sysid.selftest import self_test

    configured(say)
    with StageProgress(errors) as progress:
        progress.stage("selftest")
        read = read_campaign(campaign, point_cloud_reader=read_point_cloud, profile_reader=bump_from_file, planned=True)
        to_come = [r.log.file for r in read.bump_runs if r.log.duration_s == 0.0]
        if to_come:
            some = shorten(to_come[0], 60) + (", ..." if len(to_come) > 1 else "")
            logs = f"{len(to_come)} of {len(read.bump_runs)} logs do not exist yet ({some})"
            say(f"{logs}; these runs are simulated as planned.")
        check_priors(read)
        profiles = {name: analyse_scan(s).profile for name, s in read.scans.items()}
        return self_test(read, profiles, count, seed, progress=progress.update)


def show_selftest(screen: Console, selftest: SelfTest) -> None:
    """Prior and result of every k and c, and how many intervals hold the truth."""
    many = len(selftest.replicates) > 1
    if many:
        _show_pooled(screen, selftest)
    else:
        _show_one(screen, selftest.replicates[0], selftest.seed)
    if selftest.silent:
        some = shorten(selftest.silent[0], 60) + (", ..." if len(selftest.silent) > 1 else "")
        screen.print(
            f"{len(selftest.silent)} logs hold no usable channel ({some}); their runs were simulated with all sensors.",
            markup=False,
        )
    for failure in selftest.failures:
        screen.print(f"A simulated campaign could not be calibrated: {failure}", markup=False)
    stopped = sum(not r.converged for r in selftest.replicates)
    if stopped:
        screen.print(f"Least squares has not converged in {stopped} of {len(selftest.replicates)} simulated campaigns.")
    screen.print(
        "The data came from the model itself, so errors of the model are not tested here. The intervals allow for such "
        "errors and may therefore contain the true value more often than 90 %."
    )


def _percent(log_sd: float) -> str:
    return f"{100.0 * log_sd:.2g}"


def _show_one(screen: Console, replicate: Replicate, seed: int) -> None:
    columns = ("parameter", "true value", "estimate", "unit", "prior sd %", "sd after %", "90 % interval contains it")
    table = plain_table("What the campaign would show", columns)
    for c in replicate.checks:
        factor, unit = shown_unit(c.unit)
        table.add_row(
            escape(c.name),
            f"{c.truth * factor:.4g}",
            f"{c.value * factor:.4g}",
            unit,
            _percent(c.prior_sd),
            _percent(c.sd),
            "yes" if c.held else "no",
        )
    screen.print(table)
    mean, low, high = replicate.expected(np.random.default_rng(seed))
    screen.print(
        f"{replicate.held} of {len(replicate.checks)} intervals contain the true value; from the covariance of the fit "
        f"{mean:.1f} are expected on average, {low} to {high} in 95 % of campaigns.",
        markup=False,
    )


def _show_pooled(screen: Console, selftest: SelfTest) -> None:
    count = len(selftest.replicates)
    table = plain_table(
        f"What the campaign would show, {count} simulated campaigns",
        ("parameter", "prior sd %", "sd after %, median", "90 % intervals that contain the true value"),
    )
    for checks in zip(*(r.checks for r in selftest.replicates), strict=True):
        table.add_row(
            escape(checks[0].name),
            _percent(checks[0].prior_sd),
            _percent(float(np.median([c.sd for c in checks]))),
            f"{sum(c.held for c in checks)} of {count}",
        )
    screen.print(table)
    low, high = selftest.binomial_range()
    screen.print(
        f"{selftest.held} of {selftest.intervals} intervals contain the true value "
        f"({100.0 * selftest.held / selftest.intervals:.0f} %); "
        f"by chance {low} to {high} are expected (binomial, 95 %; wider where parameters are correlated).",
        markup=False,
    )
