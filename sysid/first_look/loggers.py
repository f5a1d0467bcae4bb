"""Logs of one run by several loggers: names that differ in one word, and columns of other sensors."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.first_look.features import Threes
from sysid.first_look.file_words import path_says
from sysid.first_look.records import LoggerGuess, SeenLog
from sysid.first_look.vocabulary import folded

#: Words that people call loggers by: with the same columns in both logs nothing else tells loggers from repeats.
_LOGGER_WORDS = re.compile(
    r"logger|daq|box|trailer|tractor|truck|semi|zug|auflieg|anhaeng|tracteur|remorque|master|slave"
)
#: Share of columns that logs of two loggers may have in common, such as a common signal.
_COMMON_COLUMNS = 0.34
_LENGTHS = 3.0
#: Logs of a clock that runs on begin later and later; of one that starts anew, all at about the same stamp [s].
_RUNS_ON_S = 1.0


@dataclass(frozen=True)
class LoggersSeen:
    """Loggers, the first one the reference, and by the first one's log the logs of all."""

    loggers: tuple[LoggerGuess, ...]
    files: Mapping[str, Mapping[str, str]]


def find_loggers(logs: Sequence[SeenLog]) -> LoggersSeen | None:
    """Which logs are of the same runs; None where one logger wrote all.

    Two logs are of one run where their paths differ in one word, without numbers, that says neither load case nor test,
    and their columns are others, or the same under words that people call loggers by.
    """
    runs = [log for log in logs if log.said.kind != "plank_drop"]
    groups: dict[str, dict[str, SeenLog]] = {}
    for log in runs:
        for word, rest in _variants(log.file):
            groups.setdefault(rest, {}).setdefault(word, log)
    pairs: Counter[tuple[str, ...]] = Counter()
    for members in groups.values():
        if len(members) > 1 and _of_one_run(members):
            pairs[tuple(sorted(members))] += 1
    if not pairs:
        return None
    words, count = pairs.most_common(1)[0]
    if count < 2:
        return None
    of_runs = [m for m in groups.values() if tuple(sorted(m)) == words and _of_one_run(m)]
    # The logger of most columns is the reference: it tells most of what happened.
    order = sorted(words, key=lambda w: (-len(of_runs[0][w].columns), w))
    names = {w: w or "first" for w in order}
    loggers = tuple(_guess(names[w], [m[w] for m in of_runs]) for w in order)
    return LoggersSeen(loggers, {m[order[0]].file: {names[w]: m[w].file for w in order} for m in of_runs})


def _variants(path: str) -> list[tuple[str, str]]:
    """Words of a path with the rest of it, and the whole of it under no word."""
    plain = folded(path)
    result = [("", re.sub(r"[^a-z0-9/.]+", "_", plain))]
    for match in re.finditer(r"(?<![a-z0-9])[a-z]+(?![a-z0-9])", plain.rsplit(".", 1)[0]):
        word = match[0]
        said = path_says(f"{word}.csv")
        if said.load is None and said.kind is None:
            rest = f"{plain[: match.start()]}_{plain[match.end() :]}"
            rest = re.sub(r"[^a-z0-9/.]+", "_", rest)
            result.append((word, re.sub(r"(?<=/)_+/|^_*/|(?:(?<=/)|^)_+|_+(?=[/.]|$)", "", rest)))
    return result


def _of_one_run(members: Mapping[str, SeenLog]) -> bool:
    logs = list(members.values())
    if len({log.file for log in logs}) < len(logs):
        return False
    lengths = [log.duration_s for log in logs]
    if min(lengths) <= 0.0 or max(lengths) > _LENGTHS * min(lengths):
        return False
    sets = [set(log.columns) for log in logs]
    common = max(len(a & b) / min(len(a), len(b)) for i, a in enumerate(sets) for b in sets[i + 1 :])
    return common <= _COMMON_COLUMNS or all(not w or _LOGGER_WORDS.search(w) for w in members)


def _guess(name: str, logs: Sequence[SeenLog]) -> LoggerGuess:
    starts = np.array([log.start_s for log in logs])
    rate = float(np.median([log.rate_hz for log in logs]))
    return LoggerGuess(name, rate, bool(np.ptp(starts) > _RUNS_ON_S))


def joined_logs(
    logs: Sequence[SeenLog], fits: Mapping[str, Threes], seen: LoggersSeen
) -> tuple[list[SeenLog], dict[str, Threes], dict[str, tuple[str, str]]]:
    """Logs with the columns of all loggers of a run as one, and by such a column its logger and its name there.

    Columns of the other loggers that have a name of the first one get their logger's name in front.  When they arrive
    is left out: their clocks are not those of the first one.
    """
    by_file = {log.file: log for log in logs}
    first = seen.loggers[0].name
    taken = {c for files in seen.files.values() for c in by_file[files[first]].columns}
    joined: dict[str, SeenLog] = {}
    others: set[str] = set()
    places: dict[str, tuple[str, str]] = {}
    fits = dict(fits)
    for file, files in seen.files.items():
        looks = list(by_file[file].looks)
        for name, other in files.items():
            if name == first:
                continue
            others.add(other)
            renamed = {c: f"{name} {c}" if c in taken else c for c in by_file[other].columns}
            places |= {new: (name, old) for old, new in renamed.items()}
            looks += [replace(x, name=renamed[x.name], arrival_s=None) for x in by_file[other].looks]
            if other in fits:
                # Threes of another logger count under the name of its own log.
                fits[other] = replace(fits[other], names=tuple(renamed[n] for n in fits[other].names))
        joined[file] = replace(by_file[file], looks=tuple(looks))
    kept = [joined.get(log.file, log) for log in logs if log.file not in others]
    return kept, fits, places
