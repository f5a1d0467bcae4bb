"""Readings that stand twice: two columns of one log, or one log under two names, also trimmed, scaled or resampled.

The noise of sensors at rest never repeats: two logs in which it does are one record.  For noises a, b of unit size that
are independent and white, z(tau) = sum_t a(t) b(t + tau) / sqrt(sum_t a(t)^2 b(t + tau)^2) has unit variance at every
shift; colour and tones widen the spread of all z, a copy raises one of them far above it, whatever its scale.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from itertools import combinations

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from sysid.campaign.records import BumpRun, Channel, Log, PlankDrop
from sysid.campaign.zero_phase import band_passed
from sysid.wording import shorten

#: Band of the noise that is compared, as part of half the rate: below it the road and idling repeat.
_BAND = (0.25, 0.7)
#: Times the largest that as many independent z reach, sqrt(2 ln n): 0.95 on pairs of logs of simulated trucks; trimmed,
#: resampled and scaled copies, and those with as much noise again, reach 1.9 to 9.
COPIED = 1.3
#: Readings, channels and logs that are compared at most; least common rest [s], and blocks for its level [s].
_READINGS, _CHANNELS, _LOGS, _LEAST_S, _BLOCK_S = 16384, 6, 300, 0.4, 0.1
#: A block is at rest whose level is at most this multiple of that of the quietest fifth.
_AT_REST, _QUIET = 2.0, 0.2
#: Share of its readings that a channel must have.
_SEEN = 0.8
#: Spread of normal numbers over the median of their sizes.
_OF_MEDIAN = 1.4826


def copied_columns(channels: Sequence[Channel]) -> dict[str, str]:
    """Columns of one log with the same readings as another of their kind: column to a sentence about it."""
    sentences: dict[str, str] = {}
    first: dict[tuple[str, bytes], str] = {}
    for channel in channels:
        mark = _mark(channel)
        if mark is None:
            continue
        other = first.setdefault((channel.sensor.kind, mark), channel.sensor.column)
        if other != channel.sensor.column:
            sentence = (
                f"'{shorten(other)}' and '{shorten(channel.sensor.column)}' hold the same readings: one is a copy of "
                "the other; export the log again, or remove the wrong one."
            )
            sentences[other] = sentences[channel.sensor.column] = sentence
    return sentences


def copied_logs(tests: Sequence[PlankDrop | BumpRun]) -> list[str]:
    """Sentences about logs of different names that hold the same readings."""
    first: dict[bytes, Log] = {}
    said = []
    others: list[Log] = []
    for test in tests:
        marks = [mark for channel in test.log.channels if (mark := _mark(channel)) is not None]
        if not marks:
            continue
        other = first.setdefault(b"".join(marks), test.log)
        if other is test.log and test.log.file not in {log.file for log in others}:
            others.append(test.log)
        if other.file != test.log.file:
            said.append(
                f"{shorten(test.log.file, 100)} holds the same readings as {shorten(other.file, 100)}: one is a copy "
                "of the other under a wrong name; find the missing log, or remove the entry."
            )
    return [*dict.fromkeys(said), *_near_copies(others)]


def _near_copies(logs: Sequence[Log]) -> list[str]:
    """Sentences about logs with the same noise, of which none is an exact copy of another."""
    by_columns: dict[tuple[str, ...], list[Log]] = defaultdict(list)
    for log in logs[:_LOGS]:
        by_columns[tuple(sorted(c.sensor.column for c in log.channels))].append(log)
    said = []
    for columns, alike in by_columns.items():
        if len(alike) < 2 or not columns:
            continue
        step = max(log.sample_interval_s for log in alike)
        found = [(log, noise) for log in alike if (noise := _noise(log, columns[:_CHANNELS], step)) is not None]
        size = next_fast_len(2 * max((noise.shape[1] for _, noise in found), default=1), real=True)
        spectra = [(log, rfft(noise, size), rfft(noise**2, size)) for log, noise in found]
        limit = COPIED * float(np.sqrt(2.0 * np.log(size * max(1, len(spectra) ** 2))))
        for (one, a, a_square), (other, b, b_square) in combinations(spectra, 2):
            if _agreement(a, a_square, b, b_square, size, round(_LEAST_S / step)) > limit:
                said.append(
                    f"{shorten(other.file, 100)} and {shorten(one.file, 100)} are one record: the noise of their "
                    "sensors at rest is the same, which no two tests share. One is a changed copy of the other, or "
                    "both are cut from one log and overlap; remove one, or find the missing log."
                )
    return said


def _agreement(
    a: np.ndarray, a_square: np.ndarray, b: np.ndarray, b_square: np.ndarray, size: int, least: int
) -> float:
    """The largest |z| over all shifts with `least` common readings at rest, as a multiple of their usual size.

    The spectra (channels, F) are those of both noises, and of their squares.
    """
    products = irfft((a.conj() * b).sum(axis=0), size)
    squares = irfft((a_square.conj() * b_square).sum(axis=0), size)
    common = squares > least * len(a)
    if np.count_nonzero(common) < 2 * least:
        return 0.0
    z = np.abs(products[common]) / np.sqrt(squares[common])
    return float(np.max(z) / (_OF_MEDIAN * np.median(z)))


def _noise(log: Log, columns: Sequence[str], step_s: float) -> np.ndarray | None:
    """Noise (channels, n) of a log every `step_s` where all its channels are at rest, of unit size, else 0.

    None where too little of it is.
    """
    by_name = {c.sensor.column: c for c in log.channels}
    begin = min(float(c.time_s[0]) for c in log.channels)
    end = max(float(c.time_s[-1]) for c in log.channels)
    block = max(4, round(_BLOCK_S / step_s))
    count = min(int((end - begin) / step_s) + 1, _READINGS) // block * block
    if count < 10 * block:
        return None
    time = begin + step_s * np.arange(count)
    rows, quiet = [], np.ones(count // block, bool)
    for column in columns:
        channel = by_name[column]
        good = np.isfinite(channel.value)
        if np.count_nonzero(good) < _SEEN * good.size:
            return None
        value = np.interp(time, channel.time_s[good], channel.value[good])
        noise = band_passed(value, 3, *_BAND)
        level = np.sqrt(np.mean(noise.reshape(-1, block) ** 2, axis=1))
        usual = float(np.quantile(level, _QUIET))
        # Held readings and records without noise say nothing.
        if usual <= 1e-9 * float(np.max(np.abs(value - value.mean()))):
            return None
        quiet &= level <= _AT_REST * usual
        rows.append(noise / np.repeat(np.maximum(level, usual), block))
    if np.count_nonzero(quiet) * block * step_s < _LEAST_S:
        return None
    at_rest = np.repeat(quiet, block)
    # Every frequency counts alike, so that a tone, as of idling, is one of many.
    spectra = rfft(np.array(rows) * at_rest)
    frequency = np.linspace(0.0, 1.0, spectra.shape[1])
    spectra *= ((frequency > _BAND[0]) & (frequency < _BAND[1])) / np.maximum(np.abs(spectra), 1e-300)
    white = irfft(spectra, count) * at_rest
    return np.asarray(white / np.sqrt(np.mean(white[:, at_rest] ** 2, axis=1, keepdims=True)))


def _mark(channel: Channel) -> bytes | None:
    """What only equal readings share; None where a column says too little to be told from another one."""
    good = np.isfinite(channel.value)
    if good.sum() < 50 or np.unique(channel.value[good]).size < 20:
        return None
    return np.ascontiguousarray(channel.value).tobytes()
