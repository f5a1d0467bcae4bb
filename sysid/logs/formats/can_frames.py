"""Frames of a CAN log, by python-can: BLF and ASC, with what the library would leave out in silence."""

from __future__ import annotations

import io
import math
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, BinaryIO

from sysid import limits
from sysid.logs.file_channels import RefusedError

#: Frames of a log: half an hour of a full bus.
_MOST_FRAMES = limits.LOG_ROWS
_RELATIVE = re.compile(r"\s*base\s+\w+\s+timestamps\s+relative", re.IGNORECASE)
_STAMPED = re.compile(r"\s*(-?\d+\.\d+)(\s.*)", re.DOTALL)


@dataclass
class Frames:
    """Frames of one identifier, bus and direction: stamps [s] and data."""

    time_s: list[float] = field(default_factory=list)
    data: list[bytearray] = field(default_factory=list)

    def extend(self, other: Frames) -> None:
        """Add the frames of another one."""
        self.time_s += other.time_s
        self.data += other.data


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
    import can

    head = stream.read(4)
    size = stream.seek(0, io.SEEK_END)
    stream.seek(0)
    text: Any = None if head == b"LOGG" else _AscText(stream)
    reader: Any = can.BLFReader(stream) if text is None else can.ASCReader(text, relative_timestamp=True)
    if text is None and reader.file_size > size:
        raise RefusedError("is a BLF file that ends before its data do; copy or export it again")
    found: dict[tuple[Any, ...], Frames] = defaultdict(Frames)
    errors = remote = 0
    for count, message in enumerate(reader):
        if count >= _MOST_FRAMES:
            raise RefusedError(f"has more than {_MOST_FRAMES} frames; cut it to the time of the test")
        if text is not None:
            text.pending = ""
        if message.is_error_frame:
            errors += 1
        elif message.is_remote_frame:
            remote += 1
        else:
            one = found[message.arbitration_id, message.is_extended_id, message.channel, message.is_rx]
            one.time_s.append(message.timestamp)
            one.data.append(message.data)
    if errors or remote:
        messages.append(f"{errors} error frames and {remote} remote frames hold no signals; they are left out")
    if text is not None and text.unknown:
        messages.append(
            f"{text.unknown} lines with frames were not understood, the first is line {text.first_unknown}; they are "
            "missing"
        )
    both: dict[Address, tuple[Frames, Frames]] = defaultdict(lambda: (Frames(), Frames()))
    for (identifier, extended, channel, received), one in found.items():
        if text is not None and text.shift_s:
            one.time_s = [time_s - text.shift_s for time_s in one.time_s]
        address = Address(identifier, bool(extended), channel if isinstance(channel, int) else -1)
        both[address][0 if received else 1].extend(one)
    return {address: _directions(*frames) for address, frames in sorted(both.items())}


class _AscText:
    """Lines of an ASC file as python-can reads them all: stamps that count from the start, none of them negative.

    Whoever makes a frame of a line empties `pending`; the others are counted in `unknown`.  `shift_s` is to be
    subtracted from the stamps.
    """

    def __init__(self, stream: BinaryIO) -> None:
        self.shift_s = 0.0
        self.unknown = 0
        self.first_unknown = 0
        self.pending = ""
        self._now_s = 0.0
        self._relative = False
        self._lines = self._generate(io.TextIOWrapper(stream, encoding="utf-8", errors="replace"))

    def __iter__(self) -> Iterator[str]:
        return self._lines

    # What the library takes for a file has these.
    read = write = close = lambda self, *unused: None

    def _generate(self, lines: Iterable[str]) -> Iterator[str]:
        started = False
        for number, line in enumerate(lines, start=1):
            if not started and _STAMPED.match(line) is None:
                self._relative = self._relative or _RELATIVE.match(line) is not None
            elif not started:
                started = True
                self._shift(line)
                # The library takes the first line that it does not know as the end of the header.
                yield "\n"
            if started and (self._relative or self.shift_s):
                line = self._from_start(line)
            # A request to send is followed by the frame that was sent.
            if " TxRq " in line:
                continue
            if " Rx " in line or " Tx " in line:
                self.pending = line
            yield line
            if self.pending:
                self._count(number)

    def _count(self, number: int) -> None:
        """Count a line of which no frame was made, if it has a stamp."""
        if _STAMPED.match(self.pending):
            self.unknown += 1
            self.first_unknown = self.first_unknown or number
        self.pending = ""

    def _shift(self, line: str) -> None:
        stamped = _STAMPED.match(line)
        if stamped is not None and float(stamped[1]) < 0.0:
            self.shift_s = float(math.ceil(-float(stamped[1])))

    def _from_start(self, line: str) -> str:
        stamped = _STAMPED.match(line)
        if stamped is None:
            return line
        stamp_s = float(stamped[1])
        if self._relative:
            stamp_s = self._now_s = self._now_s + stamp_s
        return f"{stamp_s + self.shift_s:.9f}{stamped[2]}"


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
