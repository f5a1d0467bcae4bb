"""TDMS (LabVIEW, FlexLogger), by npTDMS: waveforms with their own start and step, or a time channel in the group."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import Any, BinaryIO

import numpy as np

from sysid.logs.by_library import library_format
from sysid.logs.selection import FileChannel, RefusedError, even_time

#: Scalings that the library knows; others it leaves out with a line in its log, which would pass raw counts as values.
_UNSCALED = ("scale", "scaling")


class _Complaints(logging.Handler):
    """Keeps what the library only logs."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(record.getMessage())


def channels_of(stream: BinaryIO, request: dict[str, Any]) -> Iterator[FileChannel]:
    """Channels of all groups; starts of waveforms are counted from the earliest one of the file.

    Raises
    ------
    RefusedError
        If the file ends before its data do.
    """
    from nptdms import TdmsFile

    complaints = _Complaints()
    log = logging.getLogger("nptdms")
    log.handlers, log.propagate = [complaints], False
    file = TdmsFile.open(stream)
    channels = [channel for group in file.groups() for channel in group.channels()]
    starts = [_start(channel) for channel in channels]
    known = [start for start in starts if start is not None]
    if any(word in line.lower() for line in complaints.lines for word in ("incomplete", "cropping", "less data")):
        raise RefusedError("is a TDMS file that ends before its data do; copy or export it again")
    for channel, start in zip(channels, starts, strict=True):
        offset = 0.0 if start is None else float((start - min(known)) / np.timedelta64(1, "ns")) * 1e-9
        yield _file_channel(channel, offset, complaints)


def _start(channel: Any) -> np.datetime64 | None:
    start = channel.properties.get("wf_start_time")
    return start if isinstance(start, np.datetime64) and not np.isnat(start) and start.astype("i8") else None


def _file_channel(channel: Any, offset_s: float, complaints: _Complaints) -> FileChannel:
    properties = channel.properties
    step = properties.get("wf_increment")
    length = len(channel)

    def load() -> tuple[np.ndarray, str | None]:
        complaints.lines.clear()
        values = channel[:]
        if any(word in line.lower() for line in complaints.lines for word in _UNSCALED):
            raise RefusedError(
                f"has the channel '{channel.name[:60]}' in raw counts with a scaling that cannot be applied "
                f"({complaints.lines[0][:80]}); export it with its scaling applied"
            )
        if len(values) != length:
            raise RefusedError("is a TDMS file that ends before its data do; copy or export it again")
        return np.asarray(values), properties.get("unit_string") or properties.get("NI_UnitDescription")

    time = None
    if isinstance(step, (int, float)) and step:
        start = offset_s + float(properties.get("wf_start_offset", 0.0) or 0.0)
        time = even_time(start, float(step), length)
        return FileChannel(channel.name, length, load, channel.group_name, time, f"waveform {start!r} {step!r}")
    return FileChannel(channel.name, length, load, channel.group_name)


FORMAT = library_format(
    "tdms",
    "a TDMS file",
    __name__,
    suffixes=(".tdms",),
    recognises=lambda head: head.startswith(b"TDSm"),
    libraries=("nptdms",),
    extra="tdms",
)
