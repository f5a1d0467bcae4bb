"""Files that are run when they are read: only from folders that nobody but their owner can write to.

Whoever can write to a folder of compiled code, or to one above it, can put own code into every later run.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import stat
from pathlib import Path

#: Read, written and run by the owner alone.
PRIVATE_MODE = 0o700
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


class NotPrivateError(Exception):
    """Why a file or folder is not used, in one sentence without its end."""


def private_folder(path: Path) -> Path:
    """The real path of a folder that only this user can write to, made with mode 0700 if there is none.

    Symbolic links are followed first, so that what is looked at is what is used later.  Folders above it may belong to
    the system too; they may be open to a group that has no other member, and to all where only owners may rename (as
    in /tmp).

    Raises
    ------
    NotPrivateError
        If the folder or one above it belongs to another user or can be written by others.
    OSError
        If it cannot be made.
    """
    for folder in reversed([path, *path.parents]):
        if not folder.is_dir():
            folder.mkdir(mode=PRIVATE_MODE, exist_ok=True)
    real = Path(os.path.realpath(path))
    problem = _problem(real, os.lstat(real))
    for above in real.parents:
        problem = problem or _problem_above(above, os.lstat(above))
    if problem is not None:
        raise NotPrivateError(problem)
    return real


def check_owner_of_all(folder: Path) -> None:
    """Refuse a folder in which another user has put a file while that was possible.

    Raises
    ------
    NotPrivateError
        If a file or folder in it belongs to another user.
    """
    user = _user()
    with os.scandir(folder) as entries:
        for entry in entries:
            # Another process may take its own files away meanwhile.
            with contextlib.suppress(FileNotFoundError):
                if user is not None and entry.stat(follow_symlinks=False).st_uid != user:
                    raise NotPrivateError(f"{entry.path} belongs to another user")


def write_private(file: Path, content: bytes) -> None:
    """Write a file into a private folder, with mode 0700 and its sha256 beside it."""
    for name, data in ((file.name, content), (f"{file.name}.sha256", _digest(content))):
        descriptor = os.open(file.with_name(name), os.O_WRONLY | os.O_CREAT | os.O_EXCL, PRIVATE_MODE)
        with open(descriptor, "wb") as out:
            out.write(data)


def check_private(file: Path) -> None:
    """Refuse a file of a private folder that is not what this user has written there.

    Raises
    ------
    NotPrivateError
        If it or its folder is a link, belongs to another user or can be written by others, or if its content is not
        that of its sha256.
    OSError
        If it or its sha256 cannot be read.
    """
    _check(file.parent)
    content, digest = _read(file), _read(file.with_name(f"{file.name}.sha256"))
    if _digest(content) != digest:
        raise NotPrivateError(f"{file} is not what its sha256 says")


def check_as_private_as(code: Path, file: Path) -> None:
    """Refuse a file below a folder of installed code that people can change who cannot change that code.

    `code` is a file of it that runs already.  What an administrator has installed belongs to root, in a shared
    environment to a colleague or a group: whoever can change the code need not change this file.

    Raises
    ------
    NotPrivateError
        If the file or its folder belongs to another than root, this user or the owner of the code, or can be written
        by a group or by all where the code cannot.
    OSError
        If one of them cannot be read.
    """
    user, known = _user(), os.stat(code)
    for path in (file, file.parent) if user is not None else ():
        status = os.stat(path)
        if status.st_uid not in (0, user, known.st_uid):
            raise NotPrivateError(f"{path} belongs to another user")
        open_to = status.st_mode & _OTHERS_WRITE
        if open_to & ~known.st_mode or (open_to & stat.S_IWGRP and status.st_gid != known.st_gid):
            raise NotPrivateError(f"{path} can be written by others (mode {stat.S_IMODE(status.st_mode):o})")


def _check(path: Path) -> None:
    status = os.lstat(path)
    problem = f"{path} is a symbolic link" if stat.S_ISLNK(status.st_mode) else _problem(path, status)
    if problem is not None:
        raise NotPrivateError(problem)


def _read(file: Path) -> bytes:
    _check(file)
    return file.read_bytes()


def _digest(content: bytes) -> bytes:
    return (hashlib.sha256(content).hexdigest() + "\n").encode("ascii")


def _user() -> int | None:
    """This process's user, None where files have no such owners (Windows)."""
    return os.geteuid() if hasattr(os, "geteuid") else None


def _problem(path: Path, status: os.stat_result) -> str | None:
    user = _user()
    if user is None:
        return None
    if status.st_uid != user:
        return f"{path} belongs to another user"
    if status.st_mode & _OTHERS_WRITE:
        return f"{path} can be written by others (mode {stat.S_IMODE(status.st_mode):o})"
    return None


def _problem_above(path: Path, status: os.stat_result) -> str | None:
    user = _user()
    if user is None:
        return None
    if status.st_uid not in (0, user):
        return f"{path} belongs to another user"
    others = stat.S_IWOTH if _own_group(status.st_gid, user) else _OTHERS_WRITE
    if status.st_mode & others and not status.st_mode & stat.S_ISVTX:
        return f"{path} can be written by others (mode {stat.S_IMODE(status.st_mode):o})"
    return None


def _own_group(group: int, user: int) -> bool:
    """Whether a group is the private one of this user, as many systems make one for everybody."""
    try:
        import grp
        import pwd

        person, members = pwd.getpwuid(user), grp.getgrgid(group)
    except (ImportError, KeyError):
        return False
    return person.pw_gid == group and person.pw_name == members.gr_name and set(members.gr_mem) <= {person.pw_name}
