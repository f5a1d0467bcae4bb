"""All columns of numbers of one log, whatever its format and however its columns are named."""

from __future__ import annotations

from dataclasses import dataclass

from sysid.errors import DataRejectedError
from sysid.first_look.folder import FolderFile
from sysid.first_look.text_heads import TIME_WORDS, text_head
from sysid.logs.channels import LogContent, LogRequest, RawChannel
from sysid.logs.input_file import InputFile
from sysid.logs.registry import format_of, read_channels
from sysid.wording import shorten


@dataclass(frozen=True)
class LogColumns:
    """What a log holds: `channels` by name.

    `time` is its column of time where a campaign file has to say it;
    `text` are columns that hold no numbers, `messages` what is to be said about reading it.
    """

    file: str
    title: str
    channels: tuple[RawChannel, ...]
    time: str | None = None
    text: tuple[str, ...] = ()
    messages: tuple[str, ...] = ()


def read_everything(file: InputFile, label: str) -> tuple[LogContent, str | None]:
    """All channels of numbers of a log, and the name of its column of time where a campaign file has to say it.

    Raises
    ------
    CampaignError
        If the package that reads its format is not installed.
    DataRejectedError
        If it cannot be read, or has no column of time.
    """
    try:
        return read_channels(file, label, LogRequest((), everything=True)), None
    except DataRejectedError:
        time = _time_of(file, label)
        if time is None:
            raise
    return read_channels(file, label, LogRequest((), time=time, everything=True)), time


def _time_of(file: InputFile, label: str) -> str | None:
    """The column that is the time by a word in its name, or in a text by its even steps; None where no file says one.

    Raises
    ------
    DataRejectedError
        If a text has no such column.
    """
    known = format_of(file)
    if known.name == "csv":
        head = text_head(file.data)
        if head is not None and head.time is None:
            shown = ", ".join(f"'{shorten(n, 30)}'" for n in head.names[:4])
            raise DataRejectedError(f"{label} has no column of time (found {shown}); it is no log.")
        return head.time if head is not None else None
    names = known.read(file, label, LogRequest(())).names
    return next((n for n in names if TIME_WORDS.match(n.casefold())), None)


def read_columns_of(file: FolderFile) -> LogColumns:
    """All columns of numbers of a log.

    Raises
    ------
    CampaignError
        If the package that reads its format is not installed.
    DataRejectedError
        If it cannot be read, has no column of time, or no numbers beside it.
    """
    label = shorten(file.name, 100)
    content, time = read_everything(file.content, label)
    if not content.channels:
        raise DataRejectedError(f"{label} has no channels of numbers beside its time; it is left out.")
    read = {c.name for c in content.channels} | {c.clock.name for c in content.channels}
    text = tuple(n for n in content.names if n not in read) if file.head is not None else ()
    return LogColumns(file.name, file.title, content.channels, time, text, (*content.messages, *content.left_out))
