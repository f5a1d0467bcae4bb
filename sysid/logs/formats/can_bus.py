"""Logs of a CAN bus (BLF and ASC of Vector), by python-can; its signals by cantools with a database (DBC).

A frame is data with the moment at which it was on the bus; which signals are in it says the database.  Every message
has its own clock, the stamps of its frames; nothing is interpolated.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from functools import partial
from typing import Any, BinaryIO

import numpy as np

from sysid import limits
from sysid.logs.by_library import library_format
from sysid.logs.selection import FileChannel, RefusedError

#: Frames of a log: half an hour of a full bus.
_MOST_FRAMES = limits.LOG_ROWS
#: Messages of SAE J1939 are known by their group, whoever sends them: priority and source stand beside it in the
#: identifier.  From this format byte on they are sent to everybody.
_BROADCAST = 240


class _Frames:
    """Frames of one identifier: stamps [s] and data."""

    def __init__(self) -> None:
        self.time_s: list[float] = []
        self.data: list[bytes] = []


def channels_of(stream: BinaryIO, request: dict[str, Any]) -> Iterator[FileChannel]:
    """Signals of all messages that the database knows, one group per message and sender.

    Raises
    ------
    RefusedError
        If there is no database, or it knows none of the frames.
    """
    if not request.get("database"):
        raise RefusedError(
            "is a log of a CAN bus, whose signals take a database; name its DBC file by can_database in campaign.toml"
        )
    database = _database(request["database"])
    known = {(m.frame_id, bool(m.is_extended_frame)): m for m in database.messages}
    groups = {_group(m.frame_id): m for m in database.messages if m.is_extended_frame}
    groups.pop(None, None)
    frames = _frames(_messages(stream))
    known_frames = []
    for (identifier, extended), one in sorted(frames.items()):
        message = known.get((identifier, extended)) or (groups.get(_group(identifier)) if extended else None)
        if message is not None:
            known_frames.append((identifier, message, one))
    if not known_frames:
        raise RefusedError("has no frame of a message in its CAN database; check that the DBC file is that of this bus")
    names = [message.name for _, message, _ in known_frames]
    for identifier, message, one in known_frames:
        several = names.count(message.name) > 1
        label = f"{message.name} {identifier:X}" if several else str(message.name)
        decoded: list[dict[str, np.ndarray]] = []
        for signal in message.signals:
            yield FileChannel(
                signal.name,
                len(one.time_s),
                partial(_load, message, signal, one, decoded),
                label,
                partial(np.asarray, one.time_s, np.float64),
                f"frames of {label}",
            )


def _database(text: str) -> Any:
    import cantools

    try:
        return cantools.database.load_string(text, "dbc", strict=False)
    except Exception as error:
        reason = str(error).strip().partition("\n")[0][:100]
        raise RefusedError(f"has a CAN database that cannot be read ({reason}); export the DBC file again") from None


def _group(identifier: int) -> int | None:
    """Number of the parameter group of a 29-bit identifier that is sent to everybody (SAE J1939-21), else None."""
    return (identifier >> 8) & 0x3FFFF if (identifier >> 16) & 0xFF >= _BROADCAST else None


def _messages(stream: BinaryIO) -> Any:
    """Frames in the order of the file, BLF or ASC."""
    import can

    head = stream.read(4)
    stream.seek(0)
    if head == b"LOGG":
        return can.BLFReader(stream)
    return can.ASCReader(io.TextIOWrapper(stream, encoding="utf-8", errors="replace"), relative_timestamp=True)


def _frames(messages: Iterable[Any]) -> dict[tuple[int, bool], _Frames]:
    """Data frames by identifier and whether it has 29 bits."""
    frames: dict[tuple[int, bool], _Frames] = {}
    for count, message in enumerate(messages):
        if count >= _MOST_FRAMES:
            raise RefusedError(f"has more than {_MOST_FRAMES} frames; cut it to the time of the test")
        if message.is_error_frame or message.is_remote_frame:
            continue
        one = frames.setdefault((message.arbitration_id, bool(message.is_extended_id)), _Frames())
        one.time_s.append(float(message.timestamp))
        one.data.append(bytes(message.data))
    return frames


def _load(message: Any, signal: Any, frames: _Frames, decoded: list[dict[str, np.ndarray]]) -> tuple[np.ndarray, str]:
    """Values of one signal and their unit, NaN in frames that do not hold it."""
    if not decoded:
        decoded.append(_decoded(message, frames))
    return decoded[0][signal.name], signal.unit or ""


def _decoded(message: Any, frames: _Frames) -> dict[str, np.ndarray]:
    values = {signal.name: np.full(len(frames.data), np.nan) for signal in message.signals}
    for row, data in enumerate(frames.data):
        try:
            numbers = message.decode(data, decode_choices=False, allow_truncated=True)
        except Exception:
            # A frame that is too short, or of a multiplexer that the database has not, holds nothing.
            continue
        for name, number in numbers.items():
            values[name][row] = float(number)
    return values


FORMAT = library_format(
    "can",
    "a log of a CAN bus",
    __name__,
    suffixes=(".blf", ".asc"),
    recognises=lambda head: head.startswith(b"LOGG") or (head.startswith(b"date ") and b"\nbase " in head[:200]),
    libraries=("can", "cantools"),
    extra="can",
)
