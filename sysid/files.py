"""Files that are either complete or absent: written beside the target, flushed to the disk, then renamed."""

from __future__ import annotations

import errno
import json
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sysid import limits

#: How the name of a file begins that is being written; a killed process may leave one behind.
UNFINISHED = ".writing-"
#: Pauses [s] before a file that a reader holds open is replaced again: only Windows refuses that.
_PAUSES_S = (0.01, 0.1, 1.0)
#: What a file system says that cannot flush folders, such as the shared folders of VirtualBox and some of networks.
_NOT_FLUSHED = (errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP)


def write_atomically(path: Path, write: Callable[[Path], None]) -> None:
    """Call `write` with a temporary path in the folder of `path`, then rename the result to `path`.

    The folder is created if absent.  Whatever stops the writer (full disk, kill), `path` keeps its previous content.
    Raises OSError if the folder cannot be written.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=UNFINISHED, suffix=path.suffix)
    os.close(handle)
    temporary = Path(name)
    try:
        write(temporary)
        with temporary.open("rb+") as stream:
            os.fsync(stream.fileno())
        # mkstemp makes files that only the owner may read; results are meant to be passed on.
        temporary.chmod(0o644)
        _replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
    _flush_names(path.parent)


def write_bytes(path: Path, content: bytes) -> None:
    """Write `content` to `path`, complete or not at all."""

    def put(temporary: Path) -> None:
        temporary.write_bytes(content)

    write_atomically(path, put)


def write_text(path: Path, text: str) -> None:
    """Write `text` to `path` as UTF-8 with the line ends it has, complete or not at all."""
    write_bytes(path, text.encode("utf-8", errors="backslashreplace"))


def read_bytes(path: Path, most: int = limits.RESULT_BYTES) -> bytes | None:
    """The content of a plain file of at most `most` bytes; None where there is none that can be read.

    A pipe, which would wait for a writer, and a folder are no plain files.
    """
    try:
        return path.read_bytes() if path.is_file() and path.stat().st_size <= most else None
    except OSError:
        return None


def read_json(path: Path) -> dict[str, Any]:
    """The table in a JSON file; empty where there is none or it cannot be read."""
    try:
        document = json.loads(read_bytes(path) or b"")
    except (ValueError, RecursionError):
        return {}
    return document if isinstance(document, dict) else {}


def remove_unfinished(folder: Path, depth: int = 0) -> None:
    """Remove what killed processes left half-written in a folder that no other process writes to.

    Folders below it are looked into down to `depth`.
    """
    for level in range(depth + 1):
        for path in folder.glob(f"{'*/' * level}{UNFINISHED}*"):
            if path.is_file():
                path.unlink(missing_ok=True)


def _replace(source: Path, target: Path) -> None:
    for pause in _PAUSES_S:
        try:
            os.replace(source, target)
            return
        except PermissionError:
            if os.name != "nt":
                raise
            time.sleep(pause)
    os.replace(source, target)


def _flush_names(folder: Path) -> None:
    """The new name is on the disk too, where the system can say so."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        # The file is in its place already.
        if error.errno not in _NOT_FLUSHED:
            raise
    finally:
        os.close(handle)
