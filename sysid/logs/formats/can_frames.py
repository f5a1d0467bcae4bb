"""Frames of a CAN log, by python-can: BLF and ASC, with what the library would leave out in silence."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, BinaryIO

from sysid import limits
from sysid.logs.file_channels import RefusedError

#: Frames of a log: half an hour of a full bus.
_MOST_FRAMES = limits.LOG_ROWS
_RELATIVE = re.compile(r"\s*base\s+\w+\s+timestamps\s+relative", re.IGNORECASE)
_STAMPED = re.compile(r"\s*(-?\d+\.\d+)(\s.*)", re.DOTALL)
#: A line with a direction holds a frame; others are statistics, triggers and remarks.
_FRAME = re.compile(r"\s(Rx|Tx)\s")
#: A request to send is followed by the frame that was sent.
_REQUEST = re.compile(r"\sTxRq\s")


@dataclass
class Frames:
    """Frames of one identifier, bus and direction: stamps [s] and data."""

    time_s: list[float] = field(default_factory=list)
    data: list[bytes] = field(default_factory=list)


@dataclass(frozen=True, order=True)
class Address:
    """Where frames come from: identifier, whether it has 29 bits, number of the bus from 0 (-1: not said)."""

    identifier: int
    extended: bool
    bus: int


def read_frames(stream: BinaryIO, messages: list[str]) -> dict[Address, list[tuple[str, Frames]]]:
    """Data frames by their address, with a direction where those sent and those received differ.

    Parameters
    ----------
    stream : a BLF or ASC file.
    messages : receives what was left out.

    Raises
    ------
    RefusedError
        If there are too many frames, or the file is cut.
    """
    found: dict[Address, tuple[Frames, Frames]] = {}
    errors = remote = 0
    for count, (time_s, message) in enumerate(_messages(stream, messages)):
        if count >= _MOST_FRAMES:
            raise RefusedError(f"has more than {_MOST_FRAMES} frames; cut it to the time of the test")
        if message.is_error_frame or message.is_remote_frame:
            errors += bool(message.is_error_frame)
            remote += not message.is_error_frame
            continue
        bus = message.channel if isinstance(message.channel, int) else -1
        address = Address(message.arbitration_id, bool(message.is_extended_id), bus)
        one = found.setdefault(address, (Frames(), Frames()))[0 if message.is_rx else 1]
        one.time_s.append(time_s)
        one.data.append(bytes(message.data))
    if errors or remote:
        messages.append(f"{errors} error frames and {remote} remote frames hold no signals; they are left out")
    return {address: _directions(*both) for address, both in sorted(found.items())}


def _messages(stream: BinaryIO, messages: list[str]) -> Iterator[tuple[float, Any]]:
    """Stamp [s] and frame, in the order of the file."""
    import can

    head = stream.read(4)
    size = stream.seek(0, io.SEEK_END)
    stream.seek(0)
    if head == b"LOGG":
        reader = can.BLFReader(stream)
        if reader.file_size > size:
            raise RefusedError("is a BLF file that ends before its data do; copy or export it again")
        for message in reader:
            yield float(message.timestamp), message
        return
    text = _AscText(stream)
    for message in can.ASCReader(text, relative_timestamp=True):
        text.understood()
        yield message.timestamp - text.shift_s, message
    text.understood(last=True)
    if text.unknown:
        messages.append(
            f"{text.unknown} lines with frames were not understood, the first is line {text.first_unknown}; they are "
            "missing"
        )


class _AscText(io.TextIOWrapper):
    """Lines of an ASC file as python-can reads them all: stamps that count from the start, none of them negative.

    `unknown` counts lines with frames that it did not understand; `shift_s` is to be subtracted from the stamps.
    """

    def __init__(self, stream: BinaryIO) -> None:
        super().__init__(stream, encoding="utf-8", errors="replace")
        self.shift_s = 0.0
        self.unknown = 0
        self.first_unknown = 0
        self._number = 0
        self._now_s: float | None = None
        self._relative = False
        self._started = False
        self._pending = False
        self._kept = ""

    def understood(self, last: bool = False) -> None:
        """The line before gave a frame; with `last` there is no further line."""
        if last:
            self._count()
        self._pending = False

    def _count(self) -> None:
        if self._pending:
            self.unknown += 1
            self.first_unknown = self.first_unknown or self._number
        self._pending = False

    def __next__(self) -> str:  # type: ignore[override]
        if self._kept:
            line, self._kept = self._kept, ""
            return line
        self._count()
        line = super().__next__()
        self._number += 1
        stamped = _STAMPED.match(line)
        if stamped is None:
            self._relative = self._relative or (not self._started and _RELATIVE.match(line) is not None)
            return line
        line = self._from_start(line, float(stamped[1]), stamped[2])
        self._pending = _FRAME.search(line) is not None
        if not self._started:
            # The library takes the first line that it does not know as the end of the header.
            self._started = True
            self._kept = line
            return "\n"
        return line

    def _from_start(self, line: str, stamp_s: float, rest: str) -> str:
        if self._relative:
            stamp_s = self._now_s = (self._now_s or 0.0) + stamp_s
        if not self._started and stamp_s < 0.0:
            self.shift_s = float(math.ceil(-stamp_s))
        if _REQUEST.search(rest):
            return "\n"
        return f"{stamp_s + self.shift_s:.9f}{rest}" if self._relative or self.shift_s else line


def _directions(received: Frames, sent: Frames) -> list[tuple[str, Frames]]:
    """Frames with their direction, empty where there is one: frames that were sent and received again are one."""
    if not received.data or not sent.data:
        return [("", received if received.data else sent)]
    fewer, more = sorted((received, sent), key=lambda one: len(one.data))
    if _repeat(fewer, more):
        return [("", more)]
    return [("received", received), ("sent", sent)]


def _repeat(fewer: Frames, more: Frames) -> bool:
    """Whether every frame stands among others with the same data, nearer than half of their usual step."""
    steps = sorted(b - a for a, b in zip(more.time_s, more.time_s[1:], strict=False))
    near_s = 0.5 * steps[len(steps) // 2] if steps else math.inf
    place = found = 0
    for time_s, data in zip(fewer.time_s, fewer.data, strict=True):
        while place < len(more.data) and more.time_s[place] < time_s - near_s:
            place += 1
        same = next(
            (k for k in range(place, len(more.data)) if more.time_s[k] > time_s + near_s or more.data[k] == data),
            len(more.data),
        )
        if same < len(more.data) and more.time_s[same] <= time_s + near_s:
            place, found = same + 1, found + 1
        elif more.time_s[0] <= time_s <= more.time_s[-1]:
            return False
    return 2 * found > len(fewer.data)
