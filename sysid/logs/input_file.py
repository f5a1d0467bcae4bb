"""A file that is read once: its hash and its numbers come from the same bytes, and no link leads out of its folder."""

from __future__ import annotations

import hashlib
import os
import stat
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

_FLAGS = os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NONBLOCK", 0)
_NO_FOLLOW = getattr(os, "O_NOFOLLOW", 0)
_STEPWISE = os.open in os.supports_dir_fd and os.stat in os.supports_dir_fd and _NO_FOLLOW != 0


class FileRefusedError(OSError):
    """A file that is not read (`size` in bytes): `kind` ``folder``, ``special``, ``size``, ``changed``, ``link``."""

    def __init__(self, kind: str, size: int = 0):
        super().__init__(f"file refused: {kind}")
        self.kind = kind
        self.size = size


@dataclass(frozen=True)
class InputFile(os.PathLike[str]):
    """Content `data` of the file `path`, as it was when it was read.

    Readers that take a path may use it as one; they then read the file again.
    """

    path: Path
    data: bytes = field(repr=False)

    @property
    def name(self) -> str:
        """Name of the file without its folder."""
        return self.path.name

    @property
    def suffix(self) -> str:
        """Ending of the name, with its dot."""
        return self.path.suffix

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the content as hexadecimal text."""
        return hashlib.sha256(self.data).hexdigest()

    def __fspath__(self) -> str:
        return os.fspath(self.path)


def read_file(path: Path, limit_bytes: int) -> InputFile:
    """Read a file that the user named, through links as well.

    Pipes and devices are refused before they are opened: opening one can block or have effects.

    Raises
    ------
    FileRefusedError
        If it is a folder, no regular file, larger than `limit_bytes`, or changed while it was read.
    OSError
        If it cannot be opened or read.
    """
    _check(os.stat(path), limit_bytes)
    return InputFile(path, _content(os.open(path, _FLAGS), limit_bytes))


def read_file_inside(folder: Path, name: str, limit_bytes: int) -> InputFile:
    """Read the file `name` (relative, forward slashes) below `folder`, which no link may leave.

    Links that stay inside are resolved first; then every part of the path is opened below the one before it without
    following links, so that a link that is put there meanwhile is refused as well.

    Raises
    ------
    FileRefusedError
        As :func:`read_file`; `kind` ``link`` where the path leads out of the folder.
    OSError
        If it cannot be opened or read.
    """
    root = folder.resolve()
    resolved = (folder / name).resolve()
    if not resolved.is_relative_to(root):
        raise FileRefusedError("link")
    path = folder / name
    if not _STEPWISE or resolved == root:
        return InputFile(path, read_file(resolved, limit_bytes).data)
    *parents, last = resolved.relative_to(root).parts
    at = os.open(root, _FLAGS | os.O_DIRECTORY)
    try:
        for part in parents:
            below = os.open(part, _FLAGS | os.O_DIRECTORY | _NO_FOLLOW, dir_fd=at)
            os.close(at)
            at = below
        _check(os.stat(last, dir_fd=at, follow_symlinks=False), limit_bytes)
        return InputFile(path, _content(os.open(last, _FLAGS | _NO_FOLLOW, dir_fd=at), limit_bytes))
    finally:
        os.close(at)


def _check(status: os.stat_result, limit_bytes: int) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise FileRefusedError("folder")
    if not stat.S_ISREG(status.st_mode):
        raise FileRefusedError("special")
    if status.st_size > limit_bytes:
        raise FileRefusedError("size", status.st_size)


def _content(descriptor: int, limit_bytes: int) -> bytes:
    with open(descriptor, "rb") as stream:
        status = os.fstat(descriptor)
        _check(status, limit_bytes)
        # One byte more than there should be: a file that grows is one that is still being written.
        data = stream.read(status.st_size + 1)
    if len(data) != status.st_size:
        raise FileRefusedError("changed", len(data))
    return data
