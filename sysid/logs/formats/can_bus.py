"""Logs of a CAN bus (BLF and ASC of Vector), by python-can; its signals by cantools with a database (DBC).

A frame is data with the moment at which it was on the bus; which signals are in it says the database.  Every message
has its own clock, the stamps of its frames; nothing is interpolated.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from functools import partial
from typing import Any, BinaryIO

import numpy as np

from sysid.logs.by_library import library_format
from sysid.logs.file_channels import FileChannel, RefusedError
from sysid.logs.formats.can_frames import Frames, read_frames

#: Messages of SAE J1939 are known by their group, whoever sends them: priority and source stand beside it in the
#: identifier.  From this format byte on they are sent to everybody.
_BROADCAST = 240
#: Names of values, in a database, of a signal that is not there.
_NOT_THERE = re.compile(
    r"not.?av|n/?a\b|\bsna\b|error|invalid|undef|fault|not.?valid|fehler|ung(ü|ue)ltig", re.IGNORECASE
)
#: Largest first byte of a number in SAE J1939-71; above it stand errors and "not available".
_J1939_LARGEST = 0xFA
_INVALID = "outside the range of the database, marked as not available,"


def channels_of(stream: BinaryIO, request: dict[str, Any]) -> Iterator[FileChannel]:
    """Signals of all messages that the database knows, one group per message, sender and bus.

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
    found = []
    senders, buses = defaultdict(set), defaultdict(set)
    for address, directions in read_frames(stream, request["messages"]).items():
        key = address.identifier, address.extended
        message = known.get(key) or (groups.get(_group(address.identifier)) if address.extended else None)
        if message is not None:
            found += [(address, message, direction, one) for direction, one in directions]
            senders[message.name].add(key)
            buses[message.name].add(address.bus)
    if not found:
        raise RefusedError("has no frame of a message in its CAN database; check that the DBC file is that of this bus")
    for address, message, direction, one in found:
        label = str(message.name)
        label += f" {address.identifier:X}" if len(senders[message.name]) > 1 else ""
        label += f" CAN {address.bus + 1}" if len(buses[message.name]) > 1 else ""
        label += f" {direction}" if direction else ""
        decoded: list[dict[str, np.ndarray]] = []
        time = partial(np.asarray, one.time_s, np.float64)
        for signal in message.signals:
            yield FileChannel(
                signal.name,
                len(one.time_s),
                partial(_load, message, signal, one, decoded),
                label,
                time,
                f"frames of {label}",
                place=(address, direction),
                invalid=_INVALID,
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


def _load(
    message: Any, signal: Any, frames: Frames, decoded: list[dict[str, np.ndarray]]
) -> tuple[np.ndarray, str | None]:
    """Values of one signal and their unit, NaN in frames that do not hold it, masked where it is not there."""
    if not decoded:
        decoded.append(_raw(message, frames))
    raw = decoded[0][signal.name]
    values = raw * float(signal.scale) + float(signal.offset)
    rounding = 0.5 * abs(float(signal.scale))
    with np.errstate(invalid="ignore"):
        invalid = np.isin(
            raw, [number for number, name in (signal.choices or {}).items() if _NOT_THERE.search(str(name))]
        )
        if signal.minimum is not None:
            invalid |= values < float(signal.minimum) - rounding
        if signal.maximum is not None:
            invalid |= values > float(signal.maximum) + rounding
        if message.protocol == "j1939" and not signal.is_signed and not signal.is_float and signal.length % 8 == 0:
            invalid |= raw >= (_J1939_LARGEST + 1) << (signal.length - 8)
    return np.ma.MaskedArray(values, invalid), signal.unit


def _raw(message: Any, frames: Frames) -> dict[str, np.ndarray]:
    """Numbers of all signals of a message as they stand in its frames."""
    columns: dict[str, list[float]] = {signal.name: [] for signal in message.signals}
    for data in frames.data:
        try:
            numbers = message.decode(data, decode_choices=False, scaling=False, allow_truncated=True)
        except Exception:
            # A frame that is too short, or of a multiplexer that the database has not, holds nothing.
            numbers = {}
        for name, column in columns.items():
            column.append(numbers.get(name, np.nan))
    return {name: np.array(column, np.float64) for name, column in columns.items()}


FORMAT = library_format(
    "can",
    "a log of a CAN bus",
    __name__,
    suffixes=(".blf", ".asc"),
    recognises=lambda head: head.startswith(b"LOGG") or (head.startswith(b"date ") and b"\nbase " in head[:200]),
    libraries=("can", "cantools"),
    extra="can",
)
