"""What the quality check says of one log, and what all logs together say about each other."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from sysid.bookkeeping.check import check_bookkeeping
from sysid.campaign.findings import ChannelFinding, QualityReport
from sysid.campaign.inputs.logs import NO_COLUMN
from sysid.campaign.quality.check import check_quality
from sysid.campaign.read import read_campaign
from sysid.campaign.records import BumpRun, Campaign, Scan
from sysid.errors import DataRejectedError, SysidError
from sysid.known_results import KnownResults
from sysid.road.point_cloud import read_point_cloud
from sysid.road.profile_files import bump_from_file
from sysid.road.road_profile import ScanAnalysis
from sysid.road.scan import analyse_scan
from sysid.watch.records import Answer
from sysid.wording import shorten

#: Repeats whose motion differs by more than this factor were not driven alike.
UNLIKE = 1.3
_FILE = "campaign.toml"
#: Channels of one log that are named.
_NAMED = 6


@dataclass(frozen=True)
class LogCheck:
    """What one log says by itself: an answer, why, what else to know; whether it can be part of a campaign."""

    answer: Answer
    reasons: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    readable: bool = True


@dataclass(frozen=True)
class DayCheck:
    """What all logs say together.

    `sentences` are about what does not fit together; `speed_m_s` the measured speed of every run by its log, with the
    `listed_m_s` one; `refused` says why nothing was compared, or is empty.
    """

    sentences: tuple[str, ...] = ()
    listed_m_s: Mapping[str, float] = field(default_factory=dict)
    speed_m_s: Mapping[str, float] = field(default_factory=dict)
    refused: str = ""


def check_log(campaign: Path, name: str, unfinished: bool, guessed: bool = False) -> LogCheck:
    """Read one log of a campaign and check it by itself.

    Parameters
    ----------
    campaign : the campaign file; name : of the log; unfinished : whether values or files are missing that stages need.
    guessed : whether vehicle and sensors are guesses: what contradicts them is then no fault of the log.
    """
    try:
        read = read_campaign(campaign, only={name}, unfinished=unfinished)
        tests = (*read.plank_drops, *read.bump_runs, *read.road_drives)
        if not tests:
            return LogCheck("look", ("what it is is not known yet, so it was not checked.",))
        report = check_quality(read)[1]
    except DataRejectedError as error:
        return LogCheck("repeat", (str(error),), readable=False)
    except SysidError as error:
        return LogCheck("look", (str(error),), readable=False)
    if guessed:
        report = _without_remedies_in_the_file(report)
    rejected = [f for f in report.channels if f.verdict == "rejected"]
    reasons = [*_of_channels(rejected), *report.left_out]
    answer: Answer = "repeat" if reasons else "good"
    said = {message for f in report.channels for message in f.messages}
    # A channel that fell silent on the way will be silent in the next run too.
    silent = [f for f in report.channels if f.verdict == "usable" and f.dead_spans]
    reasons += _of_channels(silent)
    notes = _of_channels([f for f in report.channels if f.verdict == "usable" and f not in silent])
    about = (m for m in report.messages if name in m and m not in report.left_out)
    about = (m.removeprefix(f"{name}: ") for m in about if not any(inner in m for inner in said))
    others = [m for m in about if "more such channel" not in m]
    absent = [m for m in others if m.endswith(NO_COLUMN)]
    reasons += absent
    notes += [m for m in others if m not in absent]
    return LogCheck("look" if answer == "good" and (silent or absent) else answer, tuple(reasons), tuple(notes))


def _without_remedies_in_the_file(report: QualityReport) -> QualityReport:
    """The report without what asks to correct the campaign file, and without runs that contradict it."""
    channels = [replace(f, messages=tuple(m for m in f.messages if _FILE not in m)) for f in report.channels]
    kept = tuple(replace(f, verdict="good") if not f.messages else f for f in channels)
    messages = tuple(m for m in report.messages if _FILE not in m and m not in report.left_out)
    return replace(report, channels=kept, messages=messages, left_out=())


def _of_channels(findings: Sequence[ChannelFinding]) -> list[str]:
    """One sentence for every message, with the columns of which it is said."""
    columns: dict[str, list[str]] = {}
    for finding in findings:
        for message in finding.messages or ("it is rejected.",):
            columns.setdefault(message, []).append(finding.column)
    shown = {m: ", ".join(map(shorten, c[:_NAMED])) + (", ..." if len(c) > _NAMED else "") for m, c in columns.items()}
    return [f"{names}: {message}" for message, names in shown.items()]


class KnownScans:
    """Analyses of the scans of a day, each made once."""

    def __init__(self) -> None:
        self._made: dict[tuple[object, ...], ScanAnalysis] = {}

    def of(self, read: Campaign) -> Callable[[Scan], ScanAnalysis]:
        """The analysis of the scans of a campaign."""

        def analyse(scan: Scan) -> ScanAnalysis:
            key = (scan.file, read.input_sha256.get(scan.file), scan.heading_rad, scan.name)
            if key not in self._made:
                self._made = {k: v for k, v in self._made.items() if k[0] != scan.file}
                self._made[key] = analyse_scan(scan)
            return self._made[key]

        return analyse


def check_day(campaign: Path, unfinished: bool, scans: KnownScans, known: KnownResults | None = None) -> DayCheck:
    """Compare all logs of a campaign with each other, with its list and with its scans.

    Parameters
    ----------
    campaign : the campaign file; unfinished : whether values are missing, without which logs are not compared.
    known : what was found in logs before; what is found now is added, and what was not needed is forgotten.
    """
    known = known or KnownResults()
    if unfinished:
        return DayCheck()
    try:
        read = read_campaign(campaign, point_cloud_reader=read_point_cloud, profile_reader=bump_from_file)
        cleaned, _ = check_quality(read, known)
        report = check_bookkeeping(cleaned, read, scans.of(read), known)
        known.forget_unused()
    except SysidError as error:
        return DayCheck(refused=str(error))
    repeats = unlike_repeats(cleaned.bump_runs)
    return DayCheck(
        tuple(dict.fromkeys((*report.left_out, *report.contradictions, *repeats))),
        {s.file: s.listed_m_s for s in report.speeds},
        {s.file: s.measured_m_s for s in report.speeds if s.measured_m_s is not None},
    )


def unlike_repeats(runs: Sequence[BumpRun]) -> list[str]:
    """Sentences about runs that move far more or less than the others of their load case, bump and speed.

    A run is as strong as the root of the integral of the squared motion of its channels is; two runs are compared by
    the median over the channels that both have. Of two alone nobody can tell which one is odd: both are named.
    """
    groups: dict[tuple[object, ...], list[BumpRun]] = {}
    for run in runs:
        groups.setdefault((run.load_case, run.bump, round(run.nominal_speed_m_s, 2)), []).append(run)
    said = []
    for group in groups.values():
        strengths = [_strengths(run) for run in group]
        logs = [[_log_ratio(mine, other) for other in strengths if other is not mine] for mine in strengths]
        off = [float(np.median(of_run)) if of_run else 0.0 for of_run in logs]
        if not off or max(map(abs, off)) < np.log(UNLIKE):
            continue
        # Of two, the later one is compared with the earlier one.
        odd = max(range(len(group)), key=lambda i: (round(abs(off[i]), 9), i))
        others = ", ".join([shorten(run.log.file, 100) for i, run in enumerate(group) if i != odd][:3])
        said.append(
            f"{shorten(group[odd].log.file, 100)} moves {np.exp(off[odd]):.2f} times as much as {others} "
            "at the same load case and speed: another bump, another track over it, or another load."
        )
    return said


def _strengths(run: BumpRun) -> dict[str, float]:
    found = {}
    for channel in run.log.channels:
        good = np.isfinite(channel.value)
        time_s, value = channel.time_s[good], channel.value[good]
        if value.size > 1:
            moved = value - np.median(value)
            found[channel.sensor.column] = float(np.sqrt(np.sum(moved[1:] ** 2 * np.diff(time_s))))
    return found


def _log_ratio(first: Mapping[str, float], second: Mapping[str, float]) -> float:
    both = [np.log(first[c] / second[c]) for c in first if first[c] > 0.0 and second.get(c, 0.0) > 0.0]
    return float(np.median(both)) if both else 0.0


def alike(sentence: str) -> str:
    """A sentence without its numbers: the same is said again with others when more logs are there."""
    return re.sub(r"\d+(?:\.\d+)?(?:e[-+]\d+)?", "#", sentence)
