"""One writer per folder: a lock of the operating system, which a killed process does not leave behind."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType

from sysid.errors import OutputError
from sysid.files import LinkRefusedError, is_plain, make_folder

LOCK_NAME = ".lock"


class FolderInUseError(OutputError):
    """Another process is writing to the folder."""


class FolderLock:
    """Exclusive right to write to a folder; entering it again within the same object is free.

    Readers need no lock: every file in such a folder is replaced at once or only appended to.

    Raises
    ------
    FolderInUseError
        On entering, if another process holds the right.
    OutputError
        If the folder cannot be written.
    """

    def __init__(self, folder: Path):
        # The reader of a report need not load it.
        from filelock import FileLock

        self._folder = Path(folder)
        self._lock = FileLock(self._folder / LOCK_NAME, timeout=0, thread_local=False)

    def __enter__(self) -> FolderLock:
        from filelock import Timeout

        try:
            make_folder(self._folder)
            # The lock is opened by its path: a link of its name, or a pipe, is no lock.
            if os.path.lexists(self._folder / LOCK_NAME) and not is_plain(self._folder / LOCK_NAME):
                raise LinkRefusedError(f"{LOCK_NAME} in {self._folder.name}/ is no plain file; remove it.")
            self._lock.acquire()
        except Timeout as error:
            raise FolderInUseError(
                f"Another process is writing to {self._folder.name}/; wait until it has ended, or choose another "
                "folder with --output."
            ) from error
        except OSError as error:
            raise cannot_write(self._folder, error) from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._lock.release()


@contextmanager
def writing_to(folder: Path) -> Iterator[None]:
    """While it lasts files are written into a folder; OutputError where that is not possible."""
    try:
        yield
    except OSError as error:
        raise cannot_write(folder, error) from error


def cannot_write(folder: Path, error: OSError, kept: str = "") -> OutputError:
    """What to tell a user whose folder cannot be written; `kept` says what is safe."""
    reason = error.strerror or str(error)
    return OutputError(
        f"{folder.name}/ cannot be written ({reason}){kept}; free some space or choose another folder with --output."
    )
