"""What the commands print: short tables in the units of the trade."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from sysid.cli.invocation import program
from sysid.display import NOT_DETERMINED, shown_unit
from sysid.validation.results import ChannelAgreement, channel_median


def plain_table(title: str, columns: Sequence[str]) -> Table:
    """A table without lines; the first column to the left, the others to the right."""
    table = Table(title=title, title_justify="left", header_style="bold", box=None, pad_edge=False)
    for i, column in enumerate(columns):
        table.add_column(column, justify="left" if i == 0 else "right")
    return table


def _value(number: float, sd: float, factor: float) -> str:
    if not np.isfinite(number):
        return "-"
    return f"{number * factor:.4g}" + (f" ± {sd * factor:.2g}" if np.isfinite(sd) else "")


def show_check(screen: Console, calibration, report) -> None:
    """One line per log for its good channels and one per other channel, the findings in words, and the sum."""
    table = plain_table(
        "Data quality", ("log", "channel", "Hz", "jitter ms", "missing", "clipped", "rest", "noise", "verdict")
    )
    good = Counter(f.file for f in report.channels if f.verdict == "good")
    said: set[str] = set()
    for f in report.channels:
        if good[f.file] and f.file not in said:
            said.add(f.file)
            table.add_row(escape(f.file), f"{good[f.file]} channels", f"{f.rate_hz:.1f}", *[""] * 5, "good")
        if f.verdict == "good":
            continue
        scale, unit = (1e-3, "mm") if f.si_unit == "m" else (9.80665, "g")

        def level(value: float | None, digits: str, scale: float = scale, unit: str = unit) -> str:
            return "-" if value is None else f"{value / scale:{digits}} {unit}"

        table.add_row(
            escape(f.file),
            escape(f.column),
            f"{f.rate_hz:.1f}",
            f"{1e3 * f.jitter_s:.2f}",
            str(f.missing),
            str(f.clipped) if f.clip_level is None else f"{f.clipped} at {level(f.clip_level, '.3g')}",
            level(f.rest_level, ".2f"),
            level(f.noise_rms, ".3f"),
            f.verdict,
        )
    screen.print(table)
    for f in report.channels:
        for message in f.messages:
            screen.print(f"{f.file}, {f.column}: {message}", markup=False)
    for message in report.messages:
        screen.print(message, markup=False)
    verdicts = Counter(f.verdict for f in report.channels)
    screen.print(
        f"{len(report.channels)} channel records: {verdicts['good']} good, {verdicts['usable']} usable with findings, "
        f"{verdicts['rejected']} rejected. Every channel with its noise stands in the report."
    )


def show_drops(screen: Console, calibration, summary) -> None:
    """Pooled k and c per axle and method."""
    axles = calibration.campaign.vehicle.axles
    table = plain_table(
        "Plank drops, pooled", ("axle", "method", "k kN/m", "c kN s/m", "friction kN", "period s", "decrement", "note")
    )
    for e in summary.pooled:
        table.add_row(
            f"{e.axle + 1} {escape(axles[e.axle].name)}",
            e.method,
            _value(e.stiffness, e.stiffness_sd, 1e-3),
            _value(e.damping, e.damping_sd, 1e-3),
            _value(e.friction_force, e.friction_force_sd, 1e-3),
            f"{e.damped_period:.3f}" if np.isfinite(e.damped_period) else "-",
            f"{e.log_decrement:.3f}" if np.isfinite(e.log_decrement) else "-",
            "" if e.usable else escape(e.note),
        )
    screen.print(table)
    for message in summary.messages:
        screen.print(message, markup=False)


def _show_laws(screen: Console, fit) -> None:
    comparison = fit.law_comparison
    if comparison is None:
        return
    table = plain_table("Suspension laws tried", ("laws", "parameters", "residual / noise", "gain", "chosen"))
    for t in comparison.trials:
        laws = t.laws[0] if len(set(t.laws)) == 1 else "; ".join(f"{i + 1}: {law}" for i, law in enumerate(t.laws))
        chosen = "yes" if t.laws == comparison.chosen else ""
        table.add_row(escape(laws), str(t.parameters), f"{t.misfit:.2f}", f"{t.gain:.4g}", chosen)
    screen.print(table)


def show_fit(screen: Console, calibration, fit) -> None:
    """Least-squares values of all parameters beside their priors, and what the data determine."""
    _show_laws(screen, fit)
    columns = ("parameter", "value", "unit", "prior", "sd / prior sd", "known from the data")
    table = plain_table("Least squares", columns)
    for p in fit.parameters:
        factor, unit = shown_unit(p.unit)
        table.add_row(
            escape(p.name),
            _value(p.value, p.sd, factor) if p.identified else NOT_DETERMINED,
            unit,
            f"{p.prior_median * factor:.4g} ± {100.0 * p.prior_sd:.2g} %",
            f"{p.sd / p.value / p.prior_sd:.2f}",
            "yes" if p.identified else "no",
        )
    screen.print(table)
    screen.print(f"{fit.iterations} iterations, {fit.residuals} residuals: {fit.message}.", markup=False)
    show_determined(screen, fit)
    for warning in fit.warnings:
        if fit.identifiability is None or warning not in fit.identifiability.statements:
            screen.print(warning, markup=False)


def show_determined(screen: Console, fit) -> None:
    """What the data determine, in words."""
    found = fit.identifiability
    if found is None:
        return
    screen.print(
        f"The data determine {found.determined} of {len(found.names)} combinations of the parameters better than the "
        "priors do.",
        markup=False,
    )
    for statement in found.statements:
        screen.print(statement, markup=False)
    if found.warnings:
        screen.print(f"Which run or sensor would help: {program()} advise.", markup=False)


def show_validate(screen: Console, calibration, validation) -> None:
    """Medians over the channels of every run, with the run in the fit and without it."""
    left = {} if validation.left_out is None else {run.run: run for run in validation.left_out.runs}
    head = ("run", "residual / noise", "NRMSE", "R")
    table = plain_table(
        "Agreement, medians over channels", head + (tuple(f"without it: {h}" for h in head[1:]) if left else ())
    )
    for run in dict.fromkeys(row.run for row in validation.channels):
        cells = _medians([row for row in validation.channels if row.run == run])
        if left:
            cells += _medians(left[run].channels) if run in left else ("-",) * 3
        table.add_row(escape(run), *cells)
    screen.print(table)
    outside = len(validation.outside)
    screen.print(f"{outside} of {len(validation.channels)} fitted channels are outside a limit.", markup=False)
    for run in left.values():
        if not run.converged:
            screen.print(f"The fit without {run.run} did not end at a minimum.", markup=False)


def _medians(rows: Sequence[ChannelAgreement]) -> tuple[str, ...]:
    found = ((channel_median(rows, "residual_over_noise"), ".2f"), (channel_median(rows, "nrmse"), ".2%"),
             (channel_median(rows, "iso18571"), ".3f"))  # fmt: skip
    return tuple(f"{value:{digits}}" if np.isfinite(value) else "-" for value, digits in found)


def show_sample(screen: Console, calibration, posterior) -> None:
    """Posterior medians with 90 % credible intervals; those that repeat the prior are named as such."""
    table = plain_table(
        "Posterior", ("parameter", "median", "90 % credible interval", "unit", "effective draws", "R-hat")
    )
    parameters = {p.name: p for p in calibration.fit().parameters}
    for s in posterior.summaries:
        factor, shown = shown_unit(parameters[s.name].unit)
        table.add_row(
            escape(s.name),
            f"{s.q50 * factor:.4g}" if parameters[s.name].identified else NOT_DETERMINED,
            f"{s.q05 * factor:.4g} to {s.q95 * factor:.4g}",
            shown,
            f"{s.ess:.0f}",
            f"{s.rhat:.3f}",
        )
    screen.print(table)
    screen.print(posterior.message, markup=False)


def show_crosscheck(screen: Console, calibration, checked) -> None:
    """Both samplers' means and spreads, parameter by parameter."""
    table = plain_table(
        "Ensembles against the gradient-based sampler", ("parameter", "means apart [sd]", "sd ratio", "agree")
    )
    for p in checked.parameters:
        table.add_row(
            escape(p.name),
            f"{p.shift:+.2f} ± {p.shift_error:.2f}",
            f"{p.sd_ratio:.2f} ± {p.sd_ratio_error:.2f}",
            "yes" if p.agrees else "no",
        )
    screen.print(table)
    screen.print(checked.message, markup=False)


def show_predict(screen: Console, calibration, predictions) -> None:
    """Peak dynamic load ratio per axle of every predicted pass."""
    axles = calibration.campaign.vehicle.axles
    for p in predictions.passes:
        table = plain_table(
            f"{escape(p.load_case)}, {3.6 * p.speed_m_s:.4g} km/h"
            + (f", {escape(p.shape)}" if p.shape else "")
            + ": peak dynamic load ratio",
            ("axle", "median", "90 % interval", "load coefficient", "off the road ms"),
        )
        for i, axle in enumerate(axles):
            low, high = p.peak_ratio_q05, p.peak_ratio_q95
            table.add_row(
                f"{i + 1} {escape(axle.name)}",
                f"{p.peak_ratio_q50[i]:.3f}",
                "-" if low is None or high is None else f"{low[i]:.3f} to {high[i]:.3f}",
                "-" if p.load_coefficient is None else f"{p.load_coefficient.q50[i]:.3f}",
                "-" if p.lift_off_s is None else f"{1e3 * p.lift_off_s.q50[i]:.0f}",
            )
        screen.print(table)
        for warning in p.warnings:
            screen.print(warning, markup=False)


def show_advise(screen: Console, calibration, advice) -> None:
    """What every further run and sensor would bring, then the best of them in words."""
    show_determined(screen, calibration.fit())
    peak = "-" if advice.peak is None else f"peak ratio, {escape(advice.peak.label)}"
    columns = ("one further run", "worst of k and c", "median of k and c", peak)
    table = plain_table("Standard deviations after one further run", columns)
    for p in advice.rows:
        name, worst = advice.worst(p)
        table.add_row(
            escape(p.label),
            f"{100.0 * worst:.2g} % ({escape(name)})",
            f"{100.0 * advice.median(p):.2g} %",
            f"{p.peak_sd:.2g}" if np.isfinite(p.peak_sd) else "-",
        )
    screen.print(table)
    for statement in advice.statements:
        screen.print(statement, markup=False)


def show_profile(screen: Console, calibration, profiles) -> None:
    """Deviance over value of every profiled parameter, and both intervals."""
    for p in profiles:
        factor, unit = shown_unit(p.unit)
        table = plain_table(f"Profile of {escape(p.name)}", ("value", "unit", "deviance", "adjusted", "converged"))
        rows = zip(p.value, p.deviance, p.adjusted, p.converged, strict=True)
        for value, deviance, adjusted, converged in rows:
            table.add_row(
                f"{value * factor:.5g}", unit, f"{deviance:.4g}", f"{adjusted:.3f}", "yes" if converged else "no"
            )
        screen.print(table)
        both = (("likelihood ratio", p.interval), ("covariance", p.covariance_interval))
        for what, ends in both:
            low, high = (f"{end * factor:.5g}" if np.isfinite(end) else "open" for end in ends)
            screen.print(f"90 % interval by {what}: {low} to {high} {unit}", markup=False)
        screen.print(p.message, markup=False)


def show_report(screen: Console, calibration, path) -> None:
    """Where the report is."""
    screen.print(f"Report: {path}", markup=False)


def show_export(screen: Console, calibration, paths) -> None:
    """Which files were written."""
    for path in paths:
        screen.print(str(path), markup=False)


def show_run(screen: Console, calibration, results) -> None:
    """The answer of a whole calibration: k and c with intervals, status and where to read on."""
    if results.posterior is not None:
        show_sample(screen, calibration, results.posterior)
    if results.predictions is not None:
        show_predict(screen, calibration, results.predictions)
    # Those of the passes stand below their tables already.
    said = {w for p in results.predictions.passes for w in p.warnings} if results.predictions is not None else set()
    for warning in results.all_warnings:
        if warning not in said:
            screen.print(f"Note: {warning}", markup=False)
    screen.print(f"Status: {results.status}. Report: {calibration.output / 'report.html'}", markup=False)
