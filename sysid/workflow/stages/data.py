"""Stages that work on the measured data alone: quality check, plank drops, scan of the bump."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from math import degrees, isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.display import TextTable, channel_unit
from sysid.errors import DataRejectedError, SysidError
from sysid.progress import portion
from sysid.workflow.stage import Blocks, Command, Context, Whole
from sysid.workflow.stages.cells import finite_cell, value_cell

if TYPE_CHECKING:
    from sysid.campaign.findings import ChannelFinding, QualityReport
    from sysid.campaign.records import Campaign
    from sysid.results.contents import Results
    from sysid.road.road_profile import ScanAnalysis
    from sysid.sdof.drop_results import DropSummary


# ---------------------------------------------------------------------- check


def _check(context: Context) -> QualityReport:
    from sysid.bookkeeping import check_bookkeeping
    from sysid.campaign.requests import check_passes

    report, read = context.inputs.quality, context.inputs.read
    crossed = check_bookkeeping(context.inputs.whole, read)
    # The reader does not know how long a scanned bump is.
    check_passes(read.predictions, read.vehicle, {s.name: s.length_m for s in crossed.scans}, read.file.name)
    return replace(
        report,
        messages=(
            *report.messages,
            *(m for m in crossed.messages if m not in report.messages),
            *_smooth_drives(context.inputs.whole),
        ),
        left_out=(*report.left_out, *crossed.left_out),
        speeds=tuple(replace(s, logged_m_s=report.logged_speeds_m_s.get(s.file)) for s in crossed.speeds),
        scans=crossed.scans,
        contradictions=crossed.contradictions,
    )


def _smooth_drives(campaign: Campaign) -> list[str]:
    """What drives of a campaign will not tell, and what to drive."""
    if not campaign.road_drives:
        return []
    from sysid.balance import smooth_roads

    return smooth_roads(campaign)


def _rejected(report: QualityReport) -> list[ChannelFinding]:
    return [f for f in report.channels if f.verdict == "rejected"]


def _check_warnings(report: QualityReport, quick: bool) -> Sequence[str]:
    left_out = [f"{f.file}, {f.column} was left out: {' '.join(f.messages)}" for f in _rejected(report)]
    return (*report.messages, *left_out)


def _check_fault(report: QualityReport) -> type[SysidError] | None:
    return DataRejectedError if _rejected(report) or report.left_out else None


def show_check(report: QualityReport, results: Results) -> Blocks:
    """One line per channel with a finding, the findings in words, and how many channels are good."""
    yield from quality_blocks(report)
    yield from _clock_blocks(report)
    yield from _speed_blocks(report)
    yield "Every channel with its rate and noise stands in the report."


def quality_blocks(report: QualityReport) -> Blocks:
    """The findings of :func:`show_check`."""
    found = [f for f in report.channels if f.verdict != "good"]
    if found:
        table = TextTable(
            "Channels with findings", ("log", "channel", "missing", "clipped", "rest", "noise", "verdict")
        )
        for f in found:
            table.add_row(*_finding_cells(f))
        yield table
    yield from _once(f"{f.file}, {f.column}: {m}" for f in found for m in f.messages)
    yield from report.messages
    verdicts = Counter(f.verdict for f in report.channels)
    logs = len({f.file for f in report.channels})
    yield (
        f"{len(report.channels)} channel records of {logs} logs: {verdicts['good']} good, {verdicts['usable']} usable "
        f"with findings, {verdicts['rejected']} rejected."
    )


def _once(sentences: Iterable[str]) -> Iterable[str]:
    """The first of sentences that differ in names and numbers only, and how many more there are."""
    alike: dict[str, list[str]] = {}
    for sentence in sentences:
        alike.setdefault(re.sub(r"\d[\d.]*", "0", sentence.partition(": ")[2]), []).append(sentence)
    for first, *more in alike.values():
        yield first + (f" {len(more)} more such {'channel' if len(more) == 1 else 'channels'}." if more else "")


def _clock_blocks(report: QualityReport) -> Blocks:
    """Offsets added to the stamps of further loggers, to put them on the clock of the first one."""
    if report.clocks:
        table = TextTable("Clocks", ("log", "logger", "offset s", "sd ms", "rate ppm", "sd ppm", "found by"))
        for c in report.clocks:
            known = isfinite(c.offset_s)
            offset = (f"{c.offset_s:+.4f}", f"{1e3 * c.sd_s:.2f}") if known else ("-", "-")
            method = f"{c.method}, not used" if c.complaint else c.method
            table.add_row(c.other_file, c.logger, *offset, f"{1e6 * c.rate:+.1f}", f"{1e6 * c.rate_sd:.1f}", method)
        yield table


def _speed_blocks(report: QualityReport) -> Blocks:
    """Measured speeds of the runs and bumps of the scans, for comparison with the user's notes."""
    if report.speeds:
        logged = bool(report.logged_speeds_m_s)
        columns = ("log", "load case", "listed km/h", "measured km/h", *(("logged km/h",) if logged else ()))
        table = TextTable("Speeds", columns)
        for run in report.speeds:
            speeds = (run.measured_m_s, *((run.logged_m_s,) if logged else ()))
            cells = ("-" if v is None else f"{3.6 * v:.1f}" for v in speeds)
            table.add_row(run.file, run.load_case, f"{3.6 * run.listed_m_s:.4g}", *cells)
        yield table
        yield from report.sensor_sentences
    if report.scans:
        table = TextTable(
            "Bumps", ("bump", "scan", "points", "height mm", "length m", "width m", "heading deg", "declared deg")
        )
        for scan in report.scans:
            angles = (
                "-" if angle is None else f"{degrees(angle) % 360.0:.1f}"
                for angle in (scan.heading_rad, scan.declared_heading_rad)
            )
            width = "-" if scan.width_m is None else f"{scan.width_m:.2f}"
            sizes = (f"{1e3 * scan.height_m:.1f}", f"{scan.length_m:.2f}", width)
            table.add_row(scan.name, scan.file, str(scan.points), *sizes, *angles)
        yield table


def _finding_cells(f: ChannelFinding) -> tuple[str, ...]:
    from sysid.campaign.units import STANDARD_GRAVITY_M_S2

    factor, unit = (1.0 / STANDARD_GRAVITY_M_S2, "g") if f.si_unit == "m/s^2" else channel_unit(f.si_unit)

    def level(value: float | None, digits: str) -> str:
        return "-" if value is None else f"{value * factor:{digits}} {unit}"

    return (
        f.file,
        f.column,
        str(f.missing),
        str(f.clipped) if f.clip_level is None else f"{f.clipped} at {level(f.clip_level, '.3g')}",
        level(f.rest_level, ".2f"),
        level(f.noise_rms, ".3f"),
        f.verdict,
    )


CHECK = Whole(
    name="check",
    compute=_check,
    code=("campaign", "road", "bookkeeping", "balance"),
    put=lambda results, report: replace(results, quality=report),
    warnings=_check_warnings,
    in_run="always",
    effort=2.0,
    command=Command(
        help="Quality of every log and channel. Rate, gaps, clipping, wrong units, flipped signs.",
        show=show_check,
        fault=_check_fault,
        next=("run",),
    ),
)


# ---------------------------------------------------------------------- drops


def _drops(context: Context) -> DropSummary:
    from sysid.estimation.fit.drop_coupling import with_cautions
    from sysid.estimation.fit.drop_model import with_model_estimates
    from sysid.estimation.fit.options import FitOptions
    from sysid.sdof.summary import analyse_drops
    from sysid.workflow.drop_readings import kept_readings

    report = portion(context.progress, 0.0, 0.5)
    summary = analyse_drops(context.campaign, progress=report, read=kept_readings(context.folder))
    if not context.campaign.plank_drops:
        return summary
    # In a preview the fit of bump runs, which knows more than that of the drops, follows. Drops alone need it: methods
    # that take an axle for the only one under its body do not see by how much they err.
    fitted_later = context.settings.fit.preview and context.campaign.bump_runs
    if fitted_later or not context.settings.drop_model:
        return with_cautions(context.campaign, summary)
    fit = context.settings.fit
    # Only what is named in the record: other settings of the fit leave the drops as they are.
    options = FitOptions(
        # Drops start further from where they end than runs, which start from the drops.
        weight_rounds=1,
        tolerance=1e-4,
        max_iterations=2 * fit.max_iterations,
        target_step_s=fit.target_step_s,
    )
    summary = with_model_estimates(context.campaign, summary, options, portion(context.progress, 0.5, 1.0))
    return with_cautions(context.campaign, summary)


def _without_readings(folder: Path) -> None:
    from sysid.workflow.drop_readings import forget_readings

    forget_readings(folder)


def show_drops(summary: DropSummary, results: Results) -> Blocks:
    """Pooled k and c per axle and method."""
    axles = results.campaign.vehicle.axles
    table = TextTable(
        "Plank drops, pooled", ("axle", "method", "k kN/m", "c kN s/m", "friction kN", "period s", "decrement", "note")
    )
    for e in summary.pooled:
        table.add_row(
            f"{e.axle + 1} {axles[e.axle].name}",
            e.method,
            value_cell(e.stiffness, e.stiffness_sd, 1e-3),
            value_cell(e.damping, e.damping_sd, 1e-3),
            value_cell(e.friction_force, e.friction_force_sd, 1e-3),
            finite_cell(e.damped_period, ".3f"),
            finite_cell(e.log_decrement, ".3f"),
            e.caution or (e.note if e.method == "model" else ""),
        )
    yield table
    yield from summary.messages


DROPS = Whole(
    name="drops",
    compute=_drops,
    needs=(CHECK,),
    settings=("fit.preview", "drop_model", "fit.max_iterations", "fit.target_step_s"),
    code=("sdof", "estimation"),
    put=lambda results, summary: replace(results, drops=summary),
    in_run="always",
    effort=20.0,
    helper=("sysid.sdof.analysis",),
    discard=_without_readings,
    command=Command(
        help="k and c of every axle from its plank drops. Equations (1)-(3) and corrections.",
        show=show_drops,
        next=("run",),
    ),
)


# ---------------------------------------------------------------------- scan


def _scan(context: Context) -> dict[str, ScanAnalysis]:
    from sysid.road.scan import analyse_scan

    return {name: analyse_scan(scan) for name, scan in context.campaign.scans.items()}


def all_but_logs(campaign: Campaign) -> Collection[str]:
    """The campaign file, scans and whatever else is no log."""
    logs = [test.log for test in campaign.plank_drops] + [run.log for run in campaign.bump_runs]
    logs += [drive.log for drive in campaign.road_drives]
    files = {name for log in logs for name in (log.file, *log.more_files)}
    return [name for name in campaign.input_sha256 if name not in files]


SCAN = Whole(
    name="scan",
    compute=_scan,
    inputs=all_but_logs,
    code=("road",),
    put=lambda results, scans: replace(results, scans=scans),
    in_run="always",
    effort=1.0,
)
