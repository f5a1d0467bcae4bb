"""TDMS (LabVIEW, FlexLogger), by npTDMS: waveforms with their own start and step, or a time channel in the group."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from functools import partial
from numbers import Real
from typing import Any, BinaryIO

import numpy as np

from sysid.logs.by_library import library_format
from sysid.logs.file_channels import FileChannel, RefusedError, even_axis, no_time
from sysid.logs.names import decoded

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
    from nptdms.types import String

    # Older programs write the code page of Windows, which the library would replace by question marks.
    String._decode = staticmethod(decoded)
    complaints = _Complaints()
    log = logging.getLogger("nptdms")
    log.handlers, log.propagate = [complaints], False
    file = TdmsFile.open(stream)
    channels = [channel for group in file.groups() for channel in group.channels()]
    if any(word in line.lower() for line in complaints.lines for word in ("incomplete", "cropping", "less data")):
        raise RefusedError("is a TDMS file that ends before its data do; copy or export it again")
    starts = {start for channel in channels if len(channel) and (start := _start(channel)) is not None}
    for channel in channels:
        yield FileChannel(
            channel.name,
            len(channel),
            partial(_load, channel, complaints),
            channel.group_name,
            _waveform(channel, starts),
            "time of the waveform",
        )


def _start(channel: Any) -> np.datetime64 | None:
    start = channel.properties.get("wf_start_time")
    return start if isinstance(start, np.datetime64) and not np.isnat(start) and start.astype("i8") else None


def _waveform(channel: Any, starts: set[np.datetime64]) -> Callable[[], np.ndarray] | None:
    """Stamps [s] of a channel with a step, counted from the earliest start of the file; None without a step."""
    properties, path = channel.properties, f"{channel.group_name}/{channel.name}"
    step = properties.get("wf_increment")
    if not isinstance(step, Real) or not step:
        return None
    start, zero_s = _start(channel), 0.0
    if start is not None:
        zero_s = float((start - min(starts, default=start)) / np.timedelta64(1, "ns")) * 1e-9
    elif len(starts) > 1:
        return no_time(
            RefusedError(
                f"has no wf_start_time for '{path[:60]}', and other channels begin at different times; export it again"
            )
        )
    what, unit = (str(properties.get(key) or "") for key in ("wf_xname", "wf_xunit_string"))
    offset = float(properties.get("wf_start_offset", 0.0) or 0.0)
    stamps: Callable[[], np.ndarray] = even_axis(what, unit, offset, float(step), len(channel), path, zero_s)
    return stamps


def _load(channel: Any, complaints: _Complaints) -> tuple[np.ndarray, str | None]:
    complaints.lines.clear()
    values = channel[:]
    if any(word in line.lower() for line in complaints.lines for word in _UNSCALED):
        raise RefusedError(
            f"has the channel '{channel.name[:60]}' in raw counts with a scaling that cannot be applied "
            f"({complaints.lines[0][:80]}); export it with its scaling applied"
        )
    if len(values) != len(channel):
        raise RefusedError("is a TDMS file that ends before its data do; copy or export it again")
    return np.asarray(values), channel.properties.get("unit_string") or channel.properties.get("NI_UnitDescription")


FORMAT = library_format(
    "tdms",
    "a TDMS file",
    __name__,
    suffixes=(".tdms",),
    recognises=lambda head: head.startswith(b"TDSm"),
    libraries=("nptdms",),
    extra="tdms",
)
