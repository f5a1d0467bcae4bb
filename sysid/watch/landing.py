"""Files that land in a folder: complete or still written, replaced, renamed, removed; and copies of them to work on."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from sysid import limits
from sysid.files import read_json, remove, write_bytes, write_text
from sysid.first_look.folder import names_so_far
from sysid.logs.input_file import FileRefusedError, read_file_inside
from sysid.wording import shorten

#: How long size and time stamp of a file stay as they are before it counts as complete [s].
SETTLED_S = 1.0
#: A log whose time stamp is this much before one that came earlier shows a clock that was set back [s].
SET_BACK_S = 60.0
_STATE = "files.json"


@dataclass(frozen=True)
class Stamp:
    """Size and time of the last change of a file, as the file system says them."""

    size: int
    changed_ns: int


@dataclass(frozen=True)
class FolderLook:
    """What lies in a folder: complete files, those that are still written, sentences about unusable names."""

    complete: Mapping[str, Stamp]
    growing: Mapping[str, Stamp]
    messages: tuple[str, ...]


class GrowingFolder:
    """A folder that is looked at again and again.

    A file is complete when it holds something and neither size nor time stamp have changed for :data:`SETTLED_S`, by
    the clock of this machine: what the logger's clock says plays no part.
    """

    def __init__(self, folder: Path, clock: Callable[[], float] = time.monotonic):
        self.folder = folder
        self._clock = clock
        self._since: dict[str, tuple[Stamp, float]] = {}

    def look(self) -> FolderLook:
        """What lies there now.

        Raises
        ------
        CampaignError
            If the folder is not there, or holds more than a campaign has.
        """
        names, messages = names_so_far(self.folder)
        complete, growing, since = {}, {}, {}
        now = self._clock()
        for name in names:
            try:
                found = os.stat(self.folder / name)
            except OSError:
                continue
            stamp = Stamp(found.st_size, found.st_mtime_ns)
            before, first = self._since.get(name, (None, now))
            first = first if before == stamp else now
            since[name] = (stamp, first)
            if stamp.size and now - first >= SETTLED_S:
                complete[name] = stamp
            else:
                growing[name] = stamp
        self._since = since
        return FolderLook(complete, growing, tuple(messages))


@dataclass(frozen=True)
class Landing:
    """A file that is new, was replaced by another content, renamed or removed; `before` is the name it had.

    `remark` is a sentence about it, or empty.
    """

    name: str
    how: Literal["new", "replaced", "renamed", "gone"]
    before: str = ""
    remark: str = ""


@dataclass(frozen=True)
class _Copy:
    size: int
    changed_ns: int
    sha256: str


class Copies:
    """Copies of the complete files of a folder, which no logger changes; what is known of them survives a restart.

    Parameters
    ----------
    output : folder for everything that is written; the copies stand in ``campaign/`` below it.
    """

    def __init__(self, output: Path):
        self.folder = output / "campaign"
        self._state = output / _STATE
        self._files = _copies(read_json(self._state))

    @property
    def sha256(self) -> Mapping[str, str]:
        """Hash of every copied file by its name."""
        return {name: copy.sha256 for name, copy in self._files.items()}

    def take(self, source: Path, look: FolderLook) -> tuple[Landing, ...]:
        """Copy what is complete and new, and forget what is gone; the changes by name.

        Raises
        ------
        OSError
            If the copies cannot be written.
        """
        before = dict(self._files)
        read: dict[str, Landing] = {}
        for name, stamp in look.complete.items():
            known = before.get(name)
            if known is not None and (known.size, known.changed_ns) == (stamp.size, stamp.changed_ns):
                continue
            try:
                content = read_file_inside(source, name, limits.LOG_BYTES)
            except FileRefusedError as error:
                if error.kind == "size":
                    megabytes = limits.LOG_BYTES / 1e6
                    read[name] = Landing(name, "new", remark=f"it has more than {megabytes:.0f} MB and is not read.")
                continue
            except OSError:
                # Renamed, removed or locked meanwhile: the next look tells.
                continue
            if len(content.data) != stamp.size:
                continue
            self._files[name] = _Copy(stamp.size, stamp.changed_ns, content.sha256)
            if known is not None and known.sha256 == content.sha256:
                continue
            # In the order in which they landed.
            self._files[name] = self._files.pop(name)
            write_bytes(self.folder / name, content.data)
            read[name] = Landing(name, "new" if known is None else "replaced", remark=_set_back(stamp, before))
        # A file under a new name keeps its size and its time stamp: the old one goes when the new one is complete.
        moving = {(stamp.size, stamp.changed_ns) for stamp in look.growing.values()}
        gone = [
            name
            for name, copy in before.items()
            if name not in look.complete and name not in look.growing and (copy.size, copy.changed_ns) not in moving
        ]
        for name in gone:
            content_of = self._files.pop(name).sha256
            remove(self.folder / name)
            again = next((n for n, new in read.items() if new.how == "new" and self._sha(n) == content_of), None)
            if again is None:
                read[name] = Landing(name, "gone")
            else:
                read[again] = Landing(again, "renamed", name)
        if self._files != before:
            write_text(self._state, json.dumps({name: asdict(copy) for name, copy in self._files.items()}))
        return tuple(read[name] for name in sorted(read))

    def _sha(self, name: str) -> str | None:
        return self._files[name].sha256 if name in self._files else None


def _set_back(stamp: Stamp, before: Mapping[str, _Copy]) -> str:
    """A sentence where a file that came last carries an earlier time than those before it."""
    newest = max(before, key=lambda n: before[n].changed_ns, default=None)
    if newest is None or before[newest].changed_ns - stamp.changed_ns < SET_BACK_S * 1e9:
        return ""
    said = time.strftime("%Y-%m-%d %H:%M", time.gmtime(stamp.changed_ns * 1e-9))
    return (
        f"its time stamp ({said} UTC) is earlier than that of {shorten(newest, 100)}, which came before it: the clock "
        "of the logger was set back, or this is an older file; what was measured is not affected."
    )


def _copies(stored: Mapping[str, Any]) -> dict[str, _Copy]:
    try:
        return {str(name): _Copy(int(c["size"]), int(c["changed_ns"]), str(c["sha256"])) for name, c in stored.items()}
    except (KeyError, TypeError, ValueError):
        return {}
