"""MDF 3 and 4 (ASAM), by asammdf: every channel with the master channel of its own group, nothing is interpolated."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any, BinaryIO

import numpy as np

from sysid.logs.by_library import library_format
from sysid.logs.file_channels import FileChannel, RefusedError, axis_seconds

#: Synchronisation types of a master channel (MDF 4.1, channel block, cn_sync_type); with 0 its name has to say it.
_AXES = {1: "time", 2: "angle", 3: "distance", 4: "index"}
#: Flag of a channel without any valid sample.
_ALL_INVALID = 1
#: Flag of a channel group whose master stands in another one (MDF 4.2).
_REMOTE_MASTER = 1 << 3


def channels_of(stream: BinaryIO, request: dict[str, Any]) -> Iterator[FileChannel]:
    """Channels of all groups but their masters."""
    import logging

    from asammdf import MDF

    logging.disable(logging.CRITICAL)
    file: Any = MDF(stream)  # type: ignore[arg-type]
    for number, group in enumerate(file.groups):
        label = getattr(group.channel_group, "acq_name", "") or f"group {number}"
        master = file.masters_db.get(number)
        time = partial(_time, file, number, label)
        for place, channel in enumerate(group.channels):
            if place != master:
                yield FileChannel(
                    channel.name,
                    int(group.channel_group.cycles_nr),
                    partial(_load, file, number, place),
                    label,
                    time,
                    f"time of {label}",
                    place=number,
                )


def _load(file: Any, number: int, place: int) -> tuple[np.ndarray, str | None]:
    """Values of one channel on the clock of its group: the library would leave out those that are marked as invalid."""
    channel = file.groups[number].channels[place]
    values, invalid = file.get(group=number, index=place, samples_only=True, ignore_invalidation_bits=True)
    if values.ndim != 1 or values.dtype.names:
        raise RefusedError(
            f"has an array in the channel '{channel.name[:60]}', expected single numbers; choose another"
        )
    if getattr(channel, "flags", 0) & _ALL_INVALID:
        invalid = np.ones(values.size, bool)
    return (values if invalid is None else np.ma.MaskedArray(values, np.asarray(invalid, bool))), _unit(channel)


def _unit(channel: Any) -> str | None:
    return (channel.conversion and channel.conversion.unit) or getattr(channel, "unit", None)


def _time(file: Any, number: int, label: str) -> np.ndarray:
    """Stamps [s] of a group, from the group that has its master.

    Raises
    ------
    RefusedError
        If there is no master, for which the library would count rows, or it is not time.
    """
    own = file.groups[number].channel_group
    owner = own.cg_master_index if getattr(own, "flags", 0) & _REMOTE_MASTER else number
    place = file.masters_db.get(owner)
    if place is None:
        raise RefusedError(f"has no channel of time in the group '{label[:60]}'; export it again with its time")
    master = file.groups[owner].channels[place]
    factor = axis_seconds(_AXES.get(getattr(master, "sync_type", 1), str(master.name)), _unit(master), label)
    return np.asarray(file.get_master(number), np.float64) * factor


FORMAT = library_format(
    "mdf",
    "an MDF file",
    __name__,
    suffixes=(".mf4", ".mdf", ".dat"),
    recognises=lambda head: head.startswith((b"MDF ", b"UnFinMF")),
    libraries=("asammdf",),
    extra="mdf",
)
