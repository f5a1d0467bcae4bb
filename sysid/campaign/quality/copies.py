"""Readings that stand twice: two columns of one log, or one log under two names."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.campaign.records import BumpRun, Channel, Log, PlankDrop
from sysid.wording import shorten


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
    for test in tests:
        marks = [mark for channel in test.log.channels if (mark := _mark(channel)) is not None]
        if not marks:
            continue
        other = first.setdefault(b"".join(marks), test.log)
        if other.file != test.log.file:
            said.append(
                f"{shorten(test.log.file, 100)} holds the same readings as {shorten(other.file, 100)}: one is a copy "
                "of the other under a wrong name; find the missing log, or remove the entry."
            )
    return list(dict.fromkeys(said))


def _mark(channel: Channel) -> bytes | None:
    """What only equal readings share; None where a column says too little to be told from another one."""
    good = np.isfinite(channel.value)
    if good.sum() < 50 or np.unique(channel.value[good]).size < 20:
        return None
    return np.ascontiguousarray(channel.value).tobytes()
