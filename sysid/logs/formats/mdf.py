"""MDF 3 and 4 (ASAM), by asammdf: every channel with the master channel of its own group, nothing is interpolated."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, BinaryIO

import numpy as np

from sysid.logs.by_library import library_format
from sysid.logs.selection import FileChannel, RefusedError


def channels_of(stream: BinaryIO, request: dict[str, Any]) -> Iterator[FileChannel]:
    """Channels of all groups but their masters."""
    import logging

    from asammdf import MDF

    logging.disable(logging.CRITICAL)
    file: Any = MDF(stream)  # type: ignore[arg-type]
    for number, group in enumerate(file.groups):
        label = getattr(group.channel_group, "acq_name", "") or f"group {number}"
        master = file.masters_db.get(number)
        for place, channel in enumerate(group.channels):
            if place != master:
                yield _file_channel(file, number, place, channel.name, label, int(group.channel_group.cycles_nr))


def _file_channel(file: Any, group: int, place: int, name: str, label: str, length: int) -> FileChannel:
    read: list[Any] = []

    def signal() -> Any:
        if not read:
            read.append(file.get(group=group, index=place))
        return read[0]

    def load() -> tuple[np.ndarray, str | None]:
        values = signal().samples
        if values.ndim != 1 or values.dtype.names:
            raise RefusedError(f"has an array in the channel '{name[:60]}', expected single numbers; choose another")
        return values, signal().unit

    return FileChannel(
        name, length, load, label, lambda: np.asarray(signal().timestamps, np.float64), f"time of {label}"
    )


FORMAT = library_format(
    "mdf",
    "an MDF file",
    __name__,
    suffixes=(".mf4", ".mdf", ".dat"),
    recognises=lambda head: head.startswith((b"MDF ", b"UnFinMF")),
    libraries=("asammdf",),
    extra="mdf",
)
