"""Logs of several loggers put on the clock of the first one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.campaign.clocks.axle_arrivals import arrival_lag
from sysid.campaign.clocks.motion import Lag, motion_lag
from sysid.campaign.clocks.sync import sync_lag
from sysid.campaign.inputs.log_sides import join_sides
from sysid.campaign.inputs.logs import make_log
from sysid.campaign.loggers import ClockFinding, ClockMethod, Logger
from sysid.campaign.quality.check import screened
from sysid.campaign.records import BumpRun, Channel, Log
from sysid.campaign.vehicle_records import Vehicle
from sysid.errors import DataRejectedError
from sysid.wording import shorten

#: Above these limits [s] a standard deviation is reported, and the channels are left out. At 30 km/h they are 2 and 8
#: cm of travel, and half a sample and two samples at 200 Hz.
DOUBTFUL_S, USELESS_S = 0.0025, 0.01
#: Departures from a clock that runs on, or from a shared one, that are larger than chance [sd, and s].
SURE, APART_S = 5.0, 0.004
#: How far beyond the declared bounds an offset is searched for, so that it can be reported [s].
_BEYOND_S = 60.0


@dataclass(frozen=True)
class _RunLag:
    """Result of one run for one logger: difference of the first stamps [s] of both logs, and the lag between them."""

    run: int
    log: Log
    start_apart_s: float
    lag: Lag | None
    method: ClockMethod


def on_common_clock(
    runs: Sequence[BumpRun],
    others: Sequence[Mapping[str, Log]],
    loggers: Sequence[Logger],
    vehicle: Vehicle,
) -> tuple[tuple[BumpRun, ...], tuple[ClockFinding, ...]]:
    """Runs with the channels of all loggers on the clock of the first one.

    Stamps are moved, readings stay as they are. The offset of a clock is found in every run from a common signal, else
    from the motion that both loggers record, else from the arrivals of the axles. For a clock that runs on from log to
    log, offset and rate are those of the straight line through all runs.

    Parameters
    ----------
    runs : runs with the log of the first logger.
    others : per run the logs of the other loggers, by their names.
    loggers : all loggers, the first one is the reference.
    vehicle : for places and speeds.

    Raises
    ------
    DataRejectedError
        If an offset or a rate is outside of what is declared.
    """
    findings: list[list[ClockFinding]] = [[] for _ in runs]
    joined = list(runs)
    for logger in loggers[1:]:
        of_runs = [(r, logs[logger.name]) for r, logs in enumerate(others) if logger.name in logs]
        for r, log in of_runs:
            if _is_planned(log) or _is_planned(runs[r].log):
                # A planned log has no clock yet.
                joined[r] = _joined(joined[r], log, _as_declared(runs[r], log, logger))
        lags = [
            _measured_lag(r, runs[r], log, logger, vehicle)
            for r, log in of_runs
            if not (_is_planned(log) or _is_planned(runs[r].log))
        ]
        settled = (
            _continuous_clock(lags, logger, runs)
            if logger.clock == "continuous"
            else _clocks_per_log(lags, logger, runs)
        )
        for one, finding in zip(lags, settled, strict=True):
            findings[one.run].append(finding)
            joined[one.run] = _joined(joined[one.run], one.log, finding)
    return tuple(joined), tuple(finding for of_run in findings for finding in of_run)


def _measured_lag(r: int, run: BumpRun, log: Log, logger: Logger, vehicle: Vehicle) -> _RunLag:
    apart = 0.0 if logger.clock == "per_log" else log.start_time_s - run.log.start_time_s
    # Lags are those between stamps that count from the first one of each log.
    middle, reach = logger.offset_s + apart, logger.offset_within_s + _BEYOND_S
    if run.log.sync is not None and log.sync is not None:
        lag = sync_lag(run.log.sync, log.sync, (middle - reach, middle + reach))
        if lag is not None:
            return _RunLag(r, log, apart, lag, "sync")
    if not log.channels or not run.log.channels:
        # A speed or a pressure alone does not show when the truck meets the bump.
        return _RunLag(r, log, apart, None, "declared")
    first, second = (tuple(s for c in x.channels if (s := screened(c, x.channels)) is not None) for x in (run.log, log))
    by_arrivals = arrival_lag(first, second, vehicle, run)
    near = None
    if by_arrivals is not None:
        near = by_arrivals.lag_s - 5.0 * by_arrivals.sd_s, by_arrivals.lag_s + 5.0 * by_arrivals.sd_s
    lag = motion_lag(first, second, vehicle, near)
    if lag is not None:
        return _RunLag(r, log, apart, lag, "motion")
    return _RunLag(r, log, apart, by_arrivals, "arrivals")


def _clocks_per_log(lags: Sequence[_RunLag], logger: Logger, runs: Sequence[BumpRun]) -> list[ClockFinding]:
    """Clocks that start again with every log, or are shared."""
    result = []
    for one in lags:
        run, lag = runs[one.run], one.lag
        if logger.clock == "shared":
            result.append(_shared(one, logger, run))
            continue
        if lag is None:
            result.append(_without_lag(one, logger, run))
            continue
        _check_bounds(lag.lag_s, lag.sd_s, logger, run, one)
        # The rate acts on both sides of the time at which the offset was found.
        sd = float(np.hypot(lag.sd_s, _half_length(one.log) * logger.rate_within / np.sqrt(3.0)))
        result.append(
            _with_remark(
                ClockFinding(
                    run.log.file, one.log.file, logger.name, one.method, lag.lag_s, sd, lag.at_s,
                    logger.rate, logger.rate_within / np.sqrt(3.0),
                )
            )
        )  # fmt: skip
    return result


def _half_length(log: Log) -> float:
    """Mean distance [s] of the readings of a log from its middle."""
    return 0.25 * log.duration_s


def _shared(one: _RunLag, logger: Logger, run: BumpRun) -> ClockFinding:
    lag = one.lag
    apart = one.start_apart_s
    finding = _as_declared(run, one.log, logger, apart)
    off = 0.0 if lag is None else lag.lag_s - apart
    if lag is not None and abs(off) > max(SURE * lag.sd_s, APART_S):
        sentence = (
            f"{one.log.file}: the clock of the logger '{shorten(logger.name)}' is declared as shared, but the "
            f"{_source(one.method)} shows it {1e3 * off:.1f} ms (standard deviation {1e3 * lag.sd_s:.1f} ms) apart "
            f'from that of {run.log.file}; set clock = "per_log" or "continuous" for this logger.'
        )
        return replace(finding, complaint=sentence)
    return finding


def _as_declared(run: BumpRun, log: Log, logger: Logger, offset_s: float = 0.0) -> ClockFinding:
    return ClockFinding(run.log.file, log.file, logger.name, "declared", offset_s, 0.0, 0.0, 0.0, 0.0)


def _source(method: ClockMethod) -> str:
    return {"sync": "common signal", "motion": "motion that both loggers see"}.get(method, "arrival of the axles")


def _without_lag(one: _RunLag, logger: Logger, run: BumpRun) -> ClockFinding:
    sentence = (
        f"{one.log.file}: the clock of the logger '{shorten(logger.name)}' cannot be compared with that of "
        f"{run.log.file}: neither a common signal nor common motion nor arrivals of axles show its offset; its "
        "channels are left out. Record one signal on both loggers and name it by sync."
    )
    return ClockFinding(
        run.log.file, one.log.file, logger.name, "declared", np.nan, np.inf, 0.0, logger.rate, logger.rate_within,
        complaint=sentence,
    )  # fmt: skip


def _with_remark(finding: ClockFinding) -> ClockFinding:
    """The finding, with a sentence if it is too uncertain."""
    if finding.sd_s <= DOUBTFUL_S:
        return finding
    what = (
        f"{finding.other_file}: the clock of the logger '{shorten(finding.logger)}' is known to "
        f"{1e3 * finding.sd_s:.0f} ms only (standard deviation, by the {_source(finding.method)})"
    )
    remedy = "record one signal on both loggers and name it by sync."
    if finding.sd_s > USELESS_S:
        return replace(finding, complaint=f"{what}; its channels are left out of this run: {remedy}")
    return replace(finding, caution=f"{what}; k and c of its axles may be off by more than their intervals: {remedy}")


def _check_bounds(offset_s: float, sd_s: float, logger: Logger, run: BumpRun, one: _RunLag) -> None:
    off = offset_s - logger.offset_s
    if abs(off) <= logger.offset_within_s + 3.0 * sd_s:
        return
    raise DataRejectedError(
        f"{one.log.file}: the clock of the logger '{shorten(logger.name)}' is {offset_s:.3f} s (standard deviation "
        f"{1e3 * sd_s:.1f} ms, by the {_source(one.method)}) from that of {run.log.file}, and "
        f"offset_s = {logger.offset_s:g} with offset_within_s = {logger.offset_within_s:g} is declared; "
        "check that both are logs of the same run, or correct offset_s."
    )


def _continuous_clock(lags: Sequence[_RunLag], logger: Logger, runs: Sequence[BumpRun]) -> list[ClockFinding]:
    """A clock that runs on: offset and rate from all runs."""
    known = [one for one in lags if one.lag is not None]
    if not known:
        return [_without_lag(one, logger, runs[one.run]) for one in lags]
    when = np.array([one.log.start_time_s + (one.lag.at_s if one.lag else 0.5 * one.log.duration_s) for one in lags])
    usable = np.array([one.lag is not None for one in lags])
    offset = np.array([one.lag.lag_s - one.start_apart_s if one.lag else 0.0 for one in lags])
    sd = np.array([one.lag.sd_s if one.lag else np.inf for one in lags])
    line, covariance, used = _line(when, offset, sd, usable, logger)
    (level, rate), centre = line, float(when[used].mean())
    rate_sd = float(np.sqrt(covariance[1, 1]))
    last = max(known, key=lambda one: one.log.start_time_s)
    if abs(rate - logger.rate) > logger.rate_within + 3.0 * rate_sd:
        raise DataRejectedError(
            f"The clock of the logger '{shorten(logger.name)}' runs {1e6 * rate:.0f} ppm (standard deviation "
            f"{1e6 * rate_sd:.0f} ppm) away from that of the first logger in {int(used.sum())} runs, and at most "
            f"{1e6 * logger.rate_within:g} ppm about {1e6 * logger.rate:g} are declared; correct rate_within_ppm, or "
            'set clock = "per_log" if it is set or restarted between runs.'
        )
    result = []
    for k, one in enumerate(lags):
        run = runs[one.run]
        here = np.array([1.0, when[k] - centre])
        value, value_sd = float(here @ np.array([level, rate])), float(np.sqrt(here @ covariance @ here))
        _check_bounds(value, value_sd, logger, run, replace(one, method=one.method if one.lag else last.method))
        off = offset[k] - value
        if usable[k] and not used[k] and abs(off) > APART_S:
            sentence = (
                f"{one.log.file}: by the {_source(one.method)} the clock of the logger '{shorten(logger.name)}' is "
                f"{1e3 * off:.1f} ms away from a clock that runs on from the other runs; its channels are left "
                'out of this run. Set clock = "per_log" if it is restarted between runs, or check that this is '
                "the log of that run."
            )
        else:
            sentence = ""
        at = when[k] - one.log.start_time_s
        method: ClockMethod = one.method if int(used.sum()) == 1 and usable[k] else "all runs"
        finding = ClockFinding(
            run.log.file, one.log.file, logger.name, method, value + one.start_apart_s, value_sd, float(at), rate,
            rate_sd, complaint=sentence,
        )  # fmt: skip
        result.append(finding if sentence else _with_remark(finding))
    return result


def _line(
    when: np.ndarray, offset: np.ndarray, sd: np.ndarray, usable: np.ndarray, logger: Logger
) -> tuple[tuple[float, float], np.ndarray, np.ndarray]:
    """Level at the middle of the runs and rate, their covariance, and which runs count."""
    used = usable.copy()
    while True:
        centre = when[used].mean()
        design = np.stack([np.ones(int(used.sum())), when[used] - centre], axis=1) / sd[used, None]
        prior = np.array([0.0, 1.0 / (logger.rate_within / np.sqrt(3.0))])
        whole = np.vstack([design, prior])
        target = np.append(offset[used] / sd[used], logger.rate * prior[1])
        covariance = np.linalg.inv(whole.T @ whole)
        level, rate = covariance @ whole.T @ target
        off = np.abs(offset - level - rate * (when - centre))
        wrong = used & (off > np.maximum(SURE * sd, APART_S))
        if used.sum() < 4 or not wrong.any():
            break
        used[int(np.argmax(np.where(wrong, off / sd, 0.0)))] = False
    scatter = float(np.sum((off[used] / sd[used]) ** 2)) / max(int(used.sum()) - 2, 1)
    return (float(level), float(rate)), covariance * max(scatter, 1.0), used


def _joined(run: BumpRun, other: Log, finding: ClockFinding) -> BumpRun:
    """The run with the channels of another log, at the times of the reference."""
    log = run.log
    messages = (*log.messages, *other.messages)
    if finding.complaint:
        return replace(run, log=replace(log, more_files=(*log.more_files, other.file), messages=messages))
    moved = []
    for channel in (*other.channels, *other.auxiliary):
        time = channel.time_s + finding.offset_s + finding.rate * (channel.time_s - finding.at_s)
        # Readings from the time before the reference was started have no counterpart.
        kept = time >= _first_stamp(log) - 0.5 * log.sample_interval_s
        if kept.sum() > 1 or time.size == 1:
            moved.append(Channel(channel.sensor, time[kept], channel.value[kept], channel.censored[kept]))
    said = list(messages)
    channels = join_sides([*log.channels, *log.auxiliary, *moved], log.file, said)
    joined = make_log(log.file, log.sample_interval_s, channels)
    interval = max(log.sample_interval_s, other.sample_interval_s) if other.channels else log.sample_interval_s
    return replace(
        run,
        log=replace(
            log,
            sample_interval_s=interval,
            channels=joined.channels,
            auxiliary=joined.auxiliary,
            more_files=(*log.more_files, other.file),
            messages=tuple(said),
        ),
    )


def _is_planned(log: Log) -> bool:
    """Whether a log is still to be recorded: one blank reading of every sensor."""
    return all(c.time_s.size < 2 for c in (*log.channels, *log.auxiliary))


def _first_stamp(log: Log) -> float:
    return min(float(c.time_s[0]) for c in (*log.channels, *log.auxiliary))
