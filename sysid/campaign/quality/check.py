"""Quality check of all logs: sentences on every channel, and the campaign without the channels that are rejected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtri

from sysid.campaign.clipping import mark_clipped
from sysid.campaign.findings import ChannelFinding, QualityReport, Verdict
from sysid.campaign.gaps import parted, unseen
from sysid.campaign.passage.speed import speed_complaint
from sysid.campaign.passage.speed_sensors import with_logged_speeds
from sysid.campaign.quality import defects
from sysid.campaign.quality.auxiliary import check_auxiliary
from sysid.campaign.quality.bellows import with_bellows
from sysid.campaign.quality.copies import copied_columns, copied_logs
from sysid.campaign.quality.exchanges import Suspicion
from sysid.campaign.quality.pitch_rates import pitch_rate_suspicions
from sysid.campaign.quality.suspects import axles_shown_falling, falling_in_run, suspicions
from sysid.campaign.records import BumpRun, Campaign, Channel, Log, PlankDrop
from sysid.campaign.vehicle_records import Vehicle
from sysid.known_results import KnownResults
from sysid.wording import say_once, shorten

if TYPE_CHECKING:
    import pandas as pd

FEWEST_SAMPLES = 20  # a second at the slowest rate below
SLOWEST_HZ = 20.0  # body modes reach 4 Hz: five samples per cycle are the least that shows them
SHORTEST_S = 0.1  # a cycle of wheel hop at 10 Hz
LARGEST = 1e9  # m or m/s^2: error codes of loggers, not motion
# A record whose peak is one that noise alone reaches in all but this share of records holds nothing but noise: normal
# noise has a peak of 4.4 rms in 1,000 readings and of 5.3 in 100,000.
NO_RESPONSE = 0.01
# Assumptions: what is beyond them is worth a look, and none of them decides an estimate.
NOISY = 0.2  # noise rms over peak
SPIKY_SHARE = 0.02  # of the samples: more spikes than that are a loose connection
_USED = ("speed", "air_pressure")  # auxiliary kinds that estimates use
_NAMED = 10  # columns that one sentence names
HOP_HZ, HIDES_S = 15.0, 0.3  # a pause that may hide all that a channel shows of a bump: some cycles of wheel hop
JITTER_SHARE = 0.2  # of the step between stamps


@dataclass
class _ChannelCheck:
    """One channel on its way through the check."""

    channel: Channel
    missing: int
    clip_level: float | None
    dead: tuple[tuple[float, float], ...]
    rest_level: float | None
    noise: float | None
    messages: list[str]
    rejected: bool = False


def check_quality(campaign: Campaign, known: KnownResults | None = None) -> tuple[Campaign, QualityReport]:
    """Check every channel of every log.

    Clipped samples are marked as censored; dead spans and spikes become NaN. Channels that cannot be used (dead, noise
    only, wrong unit, wrong sign, exchanged columns) are left out of the returned campaign. So are logs of which nothing
    remains.

    Parameters
    ----------
    campaign : as read; it is not changed.
    known : what was found in logs before; what is found now is added.

    Returns
    -------
    campaign, report
        The cleaned campaign, and one finding per channel with its verdict: good, usable (and why) or rejected.
    """
    known = known or KnownResults()
    findings: list[ChannelFinding] = []
    messages: list[str] = [*campaign.messages, *(c.caution for c in campaign.clocks if c.caution)]
    of_logs: list[tuple[str, str]] = []
    left_out: list[str] = [c.complaint for c in campaign.clocks if c.complaint]
    messages += left_out
    drops: list[PlankDrop] = []
    runs: list[BumpRun] = []
    tests: tuple[PlankDrop | BumpRun, ...] = (*campaign.plank_drops, *campaign.bump_runs)
    votes = [
        known.of(falling_in_run, run.log.channels, campaign.vehicle, run.nominal_speed_m_s)
        for run in campaign.bump_runs
    ]
    falling = axles_shown_falling(votes)
    for test in tests:
        speed = test.nominal_speed_m_s if isinstance(test, BumpRun) else None
        log, found, said = known.of(_check_log, test.log, campaign.vehicle, speed, falling)
        findings += found
        of_logs += [(log.file, message) for message in said]
        if not log.channels:
            of_logs.append((log.file, f"{log.file}: no channel can be used; the log is left out."))
        elif isinstance(test, BumpRun):
            run = replace(test, log=log)
            complaint, hopeless = known.of(speed_complaint, run, campaign.vehicle) or ("", False)
            if complaint:
                of_logs.append((log.file, complaint))
            if hopeless:
                left_out.append(complaint)
            else:
                runs.append(run)
        else:
            drops.append(replace(test, log=log))
    drives = []
    for drive in campaign.road_drives:
        log, found, said = known.of(_check_log, drive.log, campaign.vehicle, None, falling, False)
        findings += found
        of_logs += [(log.file, message) for message in said]
        if log.channels:
            drives.append(replace(drive, log=log))
        else:
            of_logs.append((log.file, f"{log.file}: no channel can be used; the log is left out."))
    messages += [*say_once(of_logs), *copied_logs(tests), *_rejections(findings), *_not_yet_used(tests)]
    cleaned = replace(campaign, plank_drops=tuple(drops), bump_runs=tuple(runs), road_drives=tuple(drives))
    logged = with_logged_speeds(cleaned)
    cleaned, of_bellows = with_bellows(logged.campaign)
    messages += (*logged.messages, *of_bellows)
    report = QualityReport(
        tuple(findings),
        tuple(messages),
        tuple(left_out),
        clocks=campaign.clocks,
        speed_sensors=logged.sensors,
        logged_speeds_m_s=logged.logged_m_s or {},
    )
    return cleaned, report


def quality_table(report: QualityReport) -> pd.DataFrame:
    """Findings as a table, one row per log and channel, in the SI units that the column names carry."""
    import pandas as pd

    rows = []
    for finding in report.channels:
        row = asdict(finding)
        row["gaps"] = sum(count for _, count in finding.gaps)
        row["dead_spans"] = sum(stop - start for start, stop in finding.dead_spans)
        row["messages"] = " ".join(finding.messages)
        rows.append(row)
    table = pd.DataFrame(rows, columns=list(ChannelFinding.__dataclass_fields__))
    return table.rename(columns={"gaps": "gap_rows", "dead_spans": "dead_s"})


def screened(channel: Channel, of_log: Sequence[Channel] = ()) -> Channel | None:
    """A channel without the defects that it shows beside the others `of_log`: None where it cannot be used."""
    item = _examine(channel, of_log)
    return None if item.rejected else item.channel


def _check_log(
    log: Log, vehicle: Vehicle, bump_speed: float | None, falling: frozenset[int], at_rest: bool = True
) -> tuple[Log, list[ChannelFinding], list[str]]:
    messages = list(log.messages)
    others = [check_auxiliary(log, c, bump_speed is not None) for c in log.auxiliary]
    log = replace(log, auxiliary=tuple(channel for channel, _ in others if channel is not None))
    of_others = [finding for _, finding in others]
    if not log.channels:
        return log, of_others, messages
    clocks = _timings(log, messages)
    checks = [_examine(channel, log.channels) for channel in log.channels]
    clock = min(clocks, key=lambda c: c.rate_hz)
    rows = min(channel.time_s.size for channel in log.channels)
    span_s = max(float(channel.time_s[-1] - channel.time_s[0]) for channel in log.channels)
    what = None
    if rows < FEWEST_SAMPLES:
        what = f"holds {rows} samples, expected at least {FEWEST_SAMPLES}"
    elif clock.rate_hz < SLOWEST_HZ:
        what = f"is sampled at {clock.rate_hz:.3g} Hz, expected at least {SLOWEST_HZ:g} Hz"
    elif span_s < SHORTEST_S:
        what = f"is {span_s:.2g} s long, expected at least {SHORTEST_S:g} s"
    if what is not None:
        for item in checks:
            item.messages.append(f"the log {what}; the motion of the body cannot be seen in it.")
            item.rejected = True
    else:
        _judge_together(log, checks, vehicle, bump_speed, falling, messages, at_rest)
    findings = [*(_finding(log, item, timing) for item, timing in zip(checks, clocks, strict=True)), *of_others]
    kept = tuple(item.channel for item in checks if not item.rejected)
    return replace(log, channels=kept, messages=tuple(messages)), findings, messages


def _timings(log: Log, messages: list[str]) -> list[defects.Timing]:
    """Timing of every channel's clock, and what is to be said about it."""
    timings: list[defects.Timing] = []
    times = [channel.time_s for channel in log.channels]
    first = [next(j for j, other in enumerate(times) if np.array_equal(other, time)) for time in times]
    several = any(first)
    for i, (channel, j) in enumerate(zip(log.channels, first, strict=True)):
        if j < i:
            timings.append(timings[j])
            continue
        time = channel.time_s
        step = float(np.median(np.diff(time))) if several and time.size > 1 else log.sample_interval_s
        clock = defects.timing(time, step)
        timings.append(clock)
        where = f"{log.file}, '{shorten(channel.sensor.column)}'" if several else log.file
        if clock.gaps:
            lost = sum(count for _, count in clock.gaps)
            at = ", ".join(f"{count} at {start:.3f} s" for start, count in clock.gaps[:3])
            more = ", ..." if len(clock.gaps) > 3 else ""
            messages.append(f"{where}: {lost} rows are missing ({at}{more}); the time stamps show where.")
        if clock.jitter_s > JITTER_SHARE * step:
            messages.append(
                f"{where}: the time stamps depart by up to {1e3 * clock.jitter_s:.3g} ms from even steps; they are "
                "used as they are."
            )
    return timings


def _examine(channel: Channel, of_log: Sequence[Channel]) -> _ChannelCheck:
    """Defects that the channel shows beside the others `of_log`; times of spans in seconds of the log."""
    whole, rows = parted(channel)
    value, censored = whole.value.copy(), whole.censored.copy()
    time = whole.time_s
    messages: list[str] = []
    missing = int(np.sum(~np.isfinite(channel.value)))
    finite = value[np.isfinite(value)]
    item = _ChannelCheck(channel, missing, None, (), None, None, messages)
    if finite.size == 0:
        messages.append("the column is empty.")
        item.rejected = True
        return item
    unit_scale = channel.sensor.unit_in_si
    shown = channel.sensor.unit
    if np.max(np.abs(finite)) > LARGEST:
        messages.append(
            f"the reading reaches {np.max(np.abs(finite)) / unit_scale:.3g} {shown}, which is no measurement."
        )
        item.rejected = True
        return item
    if np.ptp(finite) == 0.0:
        messages.append(f"the reading does not change from {finite[0] / unit_scale:.4g} {shown}: the sensor is dead.")
        item.rejected = True
        return item
    item.clip_level = _mark_clipping(channel, value, censored, messages, unit_scale)
    dead, at_rest = defects.dead_spans(time, value, censored, [c for c in of_log if c is not channel])
    held = defects.held_spans(value, channel.sensor.full_scale, at_rest)
    spans = [
        (a, b, "does not change") for a, b in (*dead, *(h for h in held if not any(c <= h[0] < d for c, d in dead)))
    ]
    spans += [(a, b, "is lost") for a, b in defects.lost_spans(time, value)]
    for a, b, what in sorted(spans):
        value[a:b] = np.nan
        censored[a:b] = 0
        end = f"to {time[b - 1]:.3f} s" if b < time.size else "to the end"
        messages.append(f"the reading {what} from {time[a]:.3f} s {end}; that span is left out.")
    item.dead = tuple((float(time[a]), float(time[b - 1])) for a, b, _ in sorted(spans))
    at = defects.spikes(value)
    if at.size:
        value[at] = np.nan
        censored[at] = 0
        plural = "s" if at.size > 1 else ""
        messages.append(
            f"{at.size} isolated spike{plural} (the first at {time[at[0]]:.3f} s) {'were' if plural else 'was'} left "
            "out."
        )
        if at.size > SPIKY_SHARE * value.size:
            messages.append(
                "spikes come so often that the connection must be loose; repair it or leave the sensor out."
            )
            item.rejected = True
    scattered = missing - sum(b - a for a, b in defects.lost_spans(time, channel.value))
    if scattered:
        messages.append(f"{scattered} single reading{'s are' if scattered > 1 else ' is'} missing.")
    if np.sum(np.isfinite(value)) < FEWEST_SAMPLES <= value.size:
        messages.append(f"fewer than {FEWEST_SAMPLES} readings remain.")
        item.rejected = True
    item.channel = replace(channel, value=value[rows], censored=censored[rows])
    return item


def _mark_clipping(
    channel: Channel, value: np.ndarray, censored: np.ndarray, messages: list[str], unit_scale: float
) -> float | None:
    unit = channel.sensor.unit
    level = channel.sensor.full_scale if censored.any() else None
    if not censored.any():
        level = mark_clipped(value, censored)
        if level is not None:
            declared = channel.sensor.full_scale
            against = "" if declared is None else f", far below its range of {declared / unit_scale:.4g} {unit}"
            # Two or three readings in a row at full scale are seen only where the full scale is known.
            scale = f"{level / unit_scale:.4g}"
            declare = f" If {scale} {unit} is its full scale, add range = {scale} to its entry in [sensors]."
            messages.append(
                f"{int(np.sum(censored != 0))} samples are clipped at {scale} {unit}{against}; they are used as bounds."
                f"{declare if declared is None else ''}"
            )
    else:
        messages.append(
            f"{int(np.sum(censored != 0))} sample{'s reach' if np.sum(censored != 0) > 1 else ' reaches'} the range of "
            f"{level / unit_scale:.4g} {unit}; they are used as bounds."  # type: ignore[operator]
        )
    return level


def _judge_together(
    log: Log,
    checks: Sequence[_ChannelCheck],
    vehicle: Vehicle,
    bump_speed: float | None,
    falling: frozenset[int],
    messages: list[str],
    at_rest: bool,
) -> None:
    alive = [item for item in checks if not item.rejected]
    copies = copied_columns([item.channel for item in alive])
    for item in alive:
        if item.channel.sensor.column in copies:
            _add_suspicion(item, Suspicion(copies[item.channel.sensor.column], True))
    alive = [item for item in alive if not item.rejected]
    starts = defects.motion_starts([item.channel for item in alive])
    start = defects.motion_start(starts)
    if at_rest and start is None and alive:
        messages.append(f"{log.file}: the truck moves from the first sample on, so the level at rest cannot be read.")
    rests = {}
    for item, channel_start in zip(alive, starts, strict=True):
        quiet = defects.quiet_readings(item.channel, start, channel_start)
        item.rest_level, item.noise = defects.rest_of(quiet)
        rests[item.channel.sensor.column] = (
            float(np.nanmedian(item.channel.value)) if item.rest_level is None else item.rest_level
        )
        _judge_noise(item, quiet, start)
    alive = [item for item in alive if not item.rejected]
    for item in alive:
        # A plank compresses the suspension until the wheels fall off it.
        on_plank = bump_speed is None and item.channel.sensor.kind == "suspension_deflection"
        shifted = None if on_plank else defects.level_shift(item.channel, item.rest_level, item.noise)
        if shifted is not None:
            sensor = item.channel.sensor
            item.messages.append(
                f"its level at the end differs by {shifted / sensor.unit_in_si:.3g} {sensor.unit} from that at the "
                "start: the sensor drifts, or its mount has slipped; check it, its readings are used."
            )
    channels = [item.channel for item in alive]
    suspected = suspicions(log, channels, vehicle, rests, bump_speed, falling)
    of_rates = pitch_rate_suspicions(log, channels, vehicle, frozenset(suspected))
    for item in alive:
        column = item.channel.sensor.column
        for suspicion in (*suspected.get(column, ()), *of_rates.get(column, ())):
            _add_suspicion(item, suspicion)


def _judge_noise(item: _ChannelCheck, quiet: np.ndarray, start_s: float | None) -> None:
    if item.rest_level is None or item.noise is None:
        return
    # What the truck did meanwhile, the channel may have missed.
    if any(end - begin > HIDES_S and end > (start_s or 0.0) for begin, end in unseen(item.channel, HOP_HZ)):
        return
    departures = np.abs(item.channel.value - item.rest_level)
    peak = float(np.nanmax(departures))
    # Readings and averages of them: twice as many chances for noise.
    largest = noise_peak(2 * int(np.isfinite(departures).sum()))
    if peak < item.noise * largest and not defects.responds(item.channel, quiet, largest):
        item.messages.append("the reading shows noise only, no response to the test.")
        item.rejected = True
    elif item.noise > NOISY * peak:
        item.messages.append(f"the noise is {100.0 * item.noise / peak:.0f} % of the largest reading.")


def noise_peak(readings: int) -> float:
    """Largest departure, in rms, of n `readings` of normal noise in all but a share of records.

    The share is p = :data:`NO_RESPONSE`: 1 - (1 - p)^(1/n) = 2 (1 - Phi(z)), Phi the normal distribution.
    """
    return float(-ndtri(-np.expm1(np.log1p(-NO_RESPONSE) / readings) / 2.0))


def _add_suspicion(item: _ChannelCheck, suspicion: Suspicion) -> None:
    if suspicion.sentence not in item.messages:
        item.messages.append(suspicion.sentence)
    item.rejected = item.rejected or suspicion.rejected


def _finding(log: Log, item: _ChannelCheck, clock: defects.Timing) -> ChannelFinding:
    channel = item.channel
    finite = channel.value[np.isfinite(channel.value)]
    base = item.rest_level if item.rest_level is not None else (float(np.median(finite)) if finite.size else 0.0)
    verdict: Verdict = "rejected" if item.rejected else "usable" if item.messages else "good"
    return ChannelFinding(
        file=log.file,
        column=channel.sensor.column,
        kind=channel.sensor.kind,
        si_unit=channel.sensor.si_unit,
        samples=int(finite.size),
        rate_hz=clock.rate_hz,
        jitter_s=clock.jitter_s,
        missing=item.missing,
        gaps=clock.gaps,
        clipped=int(np.sum(channel.censored != 0)),
        clip_level=item.clip_level,
        dead_spans=item.dead,
        rest_level=item.rest_level,
        noise_rms=item.noise,
        peak=float(np.max(np.abs(finite - base))) if finite.size else None,
        verdict=verdict,
        messages=tuple(item.messages),
    )


def _not_yet_used(tests: Sequence[PlankDrop | BumpRun]) -> list[str]:
    """Sentences about sensors that no stage uses but this check."""
    columns: dict[str, dict[str, None]] = {}
    for channel in (c for test in tests for c in test.log.auxiliary if c.sensor.kind not in _USED):
        columns.setdefault(channel.sensor.kind.replace("_", " "), {})[f"'{shorten(channel.sensor.column)}'"] = None
    return [
        f"The {kind} of {', '.join(list(names)[:_NAMED])} is read and checked, but estimates do not use it"
        f"{': it is sampled more slowly than the other sensors' if kind == 'pitch rate' else ''}."
        for kind, names in columns.items()
    ]


def _rejections(findings: Sequence[ChannelFinding]) -> list[str]:
    """One sentence per column and cause, however many logs share it."""
    logs: dict[tuple[str, str], list[str]] = {}
    for finding in findings:
        if finding.verdict == "rejected":
            logs.setdefault((finding.column, finding.messages[-1]), []).append(finding.file)
    result = []
    for (column, sentence), files in logs.items():
        where = files[0] if len(files) == 1 else f"{files[0]} and {len(files) - 1} more logs"
        result.append(f"{where}: the channel '{shorten(column)}' is rejected: {sentence}")
    return result
