"""Formats that a library reads: the library runs in a child process, and its answer becomes channels or a sentence."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from sysid.bounded_reader import read_in_child
from sysid.errors import CampaignError, DataRejectedError
from sysid.logs.channels import Clock, LogContent, LogFormat, LogRequest, RawChannel
from sysid.logs.child import read_channels
from sysid.logs.input_file import InputFile
from sysid.wording import shorten

#: How Python shows an object that is no text; libraries put the stream that they read into their messages.
_OBJECT = re.compile(r"['\"]?<[\w.]+ object at 0x[0-9a-fA-F]+>['\"]?")


def library_format(
    name: str,
    title: str,
    module: str,
    *,
    suffixes: tuple[str, ...],
    recognises: Callable[[bytes], bool],
    libraries: tuple[str, ...],
    extra: str | None,
) -> LogFormat:
    """A format whose module has a function `channels_of` (stream, request) that lists what a file has.

    The other arguments are members of :class:`~sysid.logs.channels.LogFormat`; `module` is the name of the module.
    """

    def read(file: InputFile, label: str, request: LogRequest) -> LogContent:
        _check_installed(label, title, libraries, extra)
        answer, arrays = read_in_child(
            read_channels,
            file.data,
            label,
            libraries,
            modules=("sysid.logs.selection", module),
            module=module,
            wanted=request.wanted,
            time=request.time,
            units_row=request.units_row,
            everything=request.everything,
            database=request.database,
        )
        return _content(answer, arrays, label, title)

    return LogFormat(name, title, suffixes, recognises, read, libraries, extra)


def installed(libraries: tuple[str, ...]) -> bool:
    """Whether all modules of a format are there; none is imported."""
    return all(_spec(library) for library in libraries)


def _spec(library: str) -> bool:
    try:
        return importlib.util.find_spec(library) is not None
    except (ImportError, ValueError):
        return False


def _check_installed(label: str, title: str, libraries: tuple[str, ...], extra: str | None) -> None:
    missing = [library for library in libraries if not _spec(library)]
    if missing:
        package = f"'truck-sysid[{extra}]'" if extra else missing[0]
        raise CampaignError(
            f"{label} is {title}, which takes the package {missing[0]} to read; python -m pip install {package}, or "
            "export the log as CSV."
        )


def _content(answer: dict[str, Any], arrays: list[np.ndarray], label: str, title: str) -> LogContent:
    if "refused" in answer:
        raise DataRejectedError(f"{label} {shorten(answer['refused'], 400)}.")
    if answer.get("error") == "missing":
        reason = shorten(str(answer.get("text", "")), 120)
        raise CampaignError(f"{label} is {title}, whose reader cannot be loaded ({reason}); install it again.")
    if "error" in answer:
        reason = shorten(_OBJECT.sub("it", str(answer.get("text", "")).strip().partition("\n")[0]).strip(" ."), 120)
        raise DataRejectedError(
            f"{label} cannot be read as {title} ({reason or answer['error']}); it is damaged or cut short: copy or "
            "export it again."
        )
    try:
        clocks = [Clock(c["name"], arrays[i], c["first_row"]) for i, c in enumerate(answer["clocks"])]
        values = arrays[len(clocks) :]
        channels = tuple(
            RawChannel(wanted, clocks[c["clock"]], v, c["unit"], c["path"])
            for c, wanted, v in zip(answer["channels"], answer["wanted"], values, strict=True)
        )
        messages = tuple(f"{label}: {shorten(said, 400)}." for said in answer["messages"])
        left_out = tuple(f"{label} {shorten(said, 400)}." for said in answer["left_out"])
        return LogContent(channels, tuple(answer["names"]), messages, left_out)
    except (KeyError, IndexError, TypeError, ValueError):
        raise DataRejectedError(f"{label} is damaged: its reader gave up; export it again.") from None
