"""TDMS (LabVIEW, FlexLogger), by npTDMS: waveforms with their own start and step, or a time channel in the group."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from functools import partial
from typing import Any, BinaryIO

import numpy as np

from sysid.logs.by_library import library_format
from sysid.logs.file_channels import FileChannel, RefusedError
from sysid.logs.formats.tdms_waveforms import Waveforms
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
    waveforms = Waveforms()
    file = TdmsFile.open(stream)
    channels = [channel for group in file.groups() for channel in group.channels()]
    if any(word in line.lower() for line in complaints.lines for word in ("incomplete", "cropping", "less data")):
        raise RefusedError("is a TDMS file that ends before its data do; copy or export it again")
    for channel, time in zip(channels, waveforms.stamps(file, channels), strict=True):
        yield FileChannel(
            channel.name,
            len(channel),
            partial(_load, channel, complaints),
            channel.group_name,
            time,
            "time of the waveform",
        )


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
