"""Files that are either complete or absent: written beside the target, flushed to the disk, then renamed."""

from __future__ import annotations

import errno
import json
import os
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from sysid import limits
from sysid.errors import OutputError

#: How the name of a file begins that is being written; a killed process may leave one behind.
UNFINISHED = ".writing-"
#: Pauses [s] before a file that a reader holds open is replaced again: only Windows refuses that.
_PAUSES_S = (0.01, 0.1, 1.0)
#: What a file system says that cannot flush folders, such as the shared folders of VirtualBox and some of networks.
_NOT_FLUSHED = (errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP)
_ALWAYS = getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
#: The last part of a path is no link; a pipe does not keep who opens it waiting, and a terminal does not become ours.
_PLAIN = _ALWAYS | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0)
_STEPWISE = {os.open, os.mkdir, os.unlink, os.rename} <= os.supports_dir_fd and hasattr(os, "O_DIRECTORY")
#: Folders of results, as absolute paths: a stranger may have sent them, so no link below them is followed.
_KEPT_INSIDE: set[str] = set()


class LinkRefusedError(OutputError):
    """A part of a path below a folder of results is a link, or no folder where one must be."""


class _Place:
    """An open folder; names in it are reached without looking at its path again, where the system can do that."""

    def __init__(self, folder: Path, descriptor: int | None):
        self._folder, self.descriptor = folder, descriptor

    def at(self, name: str) -> str:
        """What the functions of `os` take, with `dir_fd`, for a name in the folder."""
        return name if self.descriptor is not None else os.path.join(self._folder, name)

    def flush(self) -> None:
        """The new name is on the disk too, where the system can say so."""
        if self.descriptor is None:
            return
        try:
            os.fsync(self.descriptor)
        except OSError as error:
            # The file is in its place already.
            if error.errno not in _NOT_FLUSHED:
                raise


def keep_inside(folder: str | Path) -> None:
    """From now on, nothing below a folder of results is read or written through a link.

    How the folder itself is reached is the user's own affair.
    """
    _KEPT_INSIDE.add(os.path.abspath(folder))


def _trusted(folder: str) -> str:
    """The part of an absolute path that the user named: down to the first folder of results, else all of it."""
    above = folder
    found = folder
    while True:
        if above in _KEPT_INSIDE:
            found = above
        parent = os.path.dirname(above)
        if parent == above:
            return found
        above = parent


@contextmanager
def _place(folder: Path, make: bool = False) -> Iterator[_Place]:
    """Open a folder part by part without following links below what the user named; `make` what is missing.

    Raises
    ------
    LinkRefusedError
        If a part is a link or no folder.
    OSError
        If it cannot be opened or made.
    """
    whole = os.path.abspath(folder)
    root = _trusted(whole)
    if make:
        os.makedirs(root, exist_ok=True)
    parts = Path(whole).relative_to(root).parts
    if not _STEPWISE:
        at = Path(root)
        for part in parts:
            at /= part
            if make:
                at.mkdir(exist_ok=True)
            if at.is_symlink() or (hasattr(at, "is_junction") and at.is_junction()):
                raise _refused(root, part)
        yield _Place(Path(whole), None)
        return
    descriptor = os.open(root, os.O_RDONLY | os.O_DIRECTORY | _ALWAYS)
    try:
        for part in parts:
            if make:
                with suppress(FileExistsError):
                    os.mkdir(part, dir_fd=descriptor)
            try:
                below = os.open(part, os.O_RDONLY | os.O_DIRECTORY | _PLAIN, dir_fd=descriptor)
            except OSError as error:
                if error.errno in (errno.ELOOP, errno.ENOTDIR, errno.EMLINK):
                    raise _refused(root, part) from None
                raise
            os.close(descriptor)
            descriptor = below
        yield _Place(Path(whole), descriptor)
    finally:
        os.close(descriptor)


def _refused(root: str, part: str) -> LinkRefusedError:
    return LinkRefusedError(
        f"{part} in {os.path.basename(root)}/ is a link or no folder, and results are not kept through links; remove "
        "it, or choose another folder with --output."
    )


def make_folder(folder: Path) -> None:
    """Make a folder and those above it, if they are missing; LinkRefusedError or OSError where that is not possible."""
    with _place(folder, make=True):
        pass


def write_bytes(path: Path, content: bytes) -> None:
    """Write `content` to `path`, complete or not at all; the folder is created if absent.

    Whatever stops the writer (full disk, kill), `path` keeps its previous content.  A link of that name is replaced,
    not followed.  Others may read the file as far as the user's umask lets them.

    Raises
    ------
    LinkRefusedError
        If a folder below that of the results is a link.
    OSError
        If the folder cannot be written.
    """
    path = Path(path)
    with _place(path.parent, make=True) as place:
        name = f"{UNFINISHED}{os.urandom(8).hex()}{path.suffix}"
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | _PLAIN
        try:
            with open(os.open(place.at(name), flags, 0o666, dir_fd=place.descriptor), "wb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            _replace(place, name, path.name)
        finally:
            with suppress(FileNotFoundError):
                os.unlink(place.at(name), dir_fd=place.descriptor)
        place.flush()


def write_text(path: Path, text: str) -> None:
    """Write `text` to `path` as UTF-8 with the line ends it has, complete or not at all."""
    write_bytes(path, text.encode("utf-8", errors="backslashreplace"))


@contextmanager
def appended(path: Path) -> Iterator[BinaryIO]:
    """A plain file to whose end is written; OSError or LinkRefusedError where it is none or cannot be written."""
    with _place(path.parent, make=True) as place:
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | _PLAIN
        with open(os.open(place.at(path.name), flags, 0o666, dir_fd=place.descriptor), "ab") as stream:
            if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
                raise OSError(errno.EINVAL, f"{path.name} is no plain file")
            yield stream


def remove(path: Path) -> None:
    """Remove a file, or the link in its place, if there is one; OSError where that is not possible."""
    with suppress(FileNotFoundError), _place(path.parent) as place:
        os.unlink(place.at(path.name), dir_fd=place.descriptor)


def is_plain(path: Path) -> bool:
    """Whether there is a plain file of that name."""
    try:
        with _place(path.parent) as place:
            return stat.S_ISREG(os.lstat(place.at(path.name), dir_fd=place.descriptor).st_mode)
    except (OSError, ValueError, LinkRefusedError):
        return False


def read_bytes(path: Path, most: int = limits.RESULT_BYTES) -> bytes | None:
    """The content of a plain file of at most `most` bytes; None where there is none that can be read.

    A pipe, which would wait for a writer, a folder and a link are no plain files.
    """
    try:
        with _place(path.parent) as place:
            # Where the system cannot refuse links while it opens, they are looked for first.
            if not stat.S_ISREG(os.lstat(place.at(path.name), dir_fd=place.descriptor).st_mode):
                return None
            with open(os.open(place.at(path.name), os.O_RDONLY | _PLAIN, dir_fd=place.descriptor), "rb") as stream:
                status = os.fstat(stream.fileno())
                if not stat.S_ISREG(status.st_mode) or status.st_size > most:
                    return None
                content = stream.read(status.st_size + 1)
                return content if len(content) <= most else None
    except (OSError, ValueError, LinkRefusedError):
        return None


def read_json(path: Path) -> dict[str, Any]:
    """The table in a JSON file; empty where there is none or it cannot be read."""
    return json_table(read_bytes(path) or b"")


def json_table(content: bytes) -> dict[str, Any]:
    """The table in the content of a JSON file; empty where it is none."""
    try:
        document = json.loads(content)
    except (ValueError, RecursionError):
        return {}
    return document if isinstance(document, dict) else {}


def remove_unfinished(folder: Path, depth: int = 0) -> None:
    """Remove what killed processes left half-written in a folder that no other process writes to.

    Folders below it are looked into down to `depth`.
    """
    with (
        suppress(FileNotFoundError, LinkRefusedError),
        _place(folder) as place,
        os.scandir(folder if place.descriptor is None else place.descriptor) as entries,
    ):
        for entry in list(entries):
            if entry.is_dir(follow_symlinks=False):
                if depth > 0:
                    remove_unfinished(folder / entry.name, depth - 1)
            elif entry.name.startswith(UNFINISHED):
                with suppress(FileNotFoundError):
                    os.unlink(place.at(entry.name), dir_fd=place.descriptor)


def _replace(place: _Place, source: str, target: str) -> None:
    for pause in (*_PAUSES_S, None):
        try:
            os.replace(place.at(source), place.at(target), src_dir_fd=place.descriptor, dst_dir_fd=place.descriptor)
            return
        except PermissionError:
            if os.name != "nt" or pause is None:
                raise
            time.sleep(pause)
