"""All columns of numbers of one log, whatever its format and however its columns are named."""

from __future__ import annotations

from dataclasses import dataclass

from sysid.errors import DataRejectedError
from sysid.first_look.folder import FolderFile
from sysid.first_look.text_heads import TIME_WORDS
from sysid.logs.channels import LogRequest, RawChannel
from sysid.logs.registry import read_channels
from sysid.wording import shorten


@dataclass(frozen=True)
class LogColumns:
    """What a log holds: `channels` by name, and how it is written where that has to be said in a campaign file.

    `time` is the name of the column of time where it is no usual one; `text` are columns that hold no numbers.
    """

    file: str
    title: str
    channels: tuple[RawChannel, ...]
    time: str | None = None
    units_row: bool = False
    text: tuple[str, ...] = ()


def read_columns_of(file: FolderFile) -> LogColumns:
    """All columns of numbers of a log.

    Raises
    ------
    CampaignError
        If the package that reads its format is not installed.
    DataRejectedError
        If it cannot be read, or has no column of time.
    """
    return _text(file) if file.head is not None else _other_format(file)


def _text(file: FolderFile) -> LogColumns:
    label, head = shorten(file.name, 100), file.head
    assert head is not None
    if head.time is None:
        shown = ", ".join(f"'{shorten(n, 30)}'" for n in head.names[:4])
        raise DataRejectedError(f"{label} has no column of time (found {shown}); it is no log.")
    wanted = tuple(dict.fromkeys(n for n in head.numbers if n != head.time))
    if not wanted:
        raise DataRejectedError(f"{label} has no column of numbers beside '{shorten(head.time)}'; it is left out.")
    request = LogRequest(wanted, head.guessed_time, head.units_row)
    content = read_channels(file.content, label, request)
    text = tuple(n for n in head.names if n not in head.numbers and n != head.time)
    return LogColumns(file.name, file.title, content.channels, head.guessed_time, head.units_row, text)


def _other_format(file: FolderFile) -> LogColumns:
    label = shorten(file.name, 100)
    try:
        content = read_channels(file.content, label, LogRequest((), everything=True))
        time = None
    except DataRejectedError:
        names = read_channels(file.content, label, LogRequest(())).names
        time = next((n for n in names if TIME_WORDS.match(n.casefold())), None)
        if time is None:
            raise
        content = read_channels(file.content, label, LogRequest((), time=time, everything=True))
    if not content.channels:
        raise DataRejectedError(f"{label} has no channels of numbers; it is left out.")
    return LogColumns(file.name, file.title, content.channels, time)
