"""Starts the child process that reads what cannot be bounded, and turns its end into an answer or a sentence.

Every file has a process of its own.  On Linux it is forked by one that has loaded the libraries (:class:`_Server`):
loading them takes a second, reading a log some milliseconds.
"""

from __future__ import annotations

import atexit
import errno
import io
import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from types import CodeType
from typing import Any, BinaryIO, Protocol

import numpy as np

from sysid import limits
from sysid.errors import DataRejectedError

_WORKER = Path(__file__).with_name("read_worker.py")
#: Whether one process can load the libraries and fork another for each file. Elsewhere every file begins with loading.
_FORKS = sys.platform == "linux"
#: Bytes of an answer: names and units of the channels of a log take a few kilobytes.
_LONGEST_ANSWER = 1 << 20


class ChildFunction(Protocol):
    """A plain function that reads a stream as a request says: answer for JSON, and arrays."""

    __name__: str
    __code__: CodeType

    def __call__(self, stream: BinaryIO, request: dict[str, Any], /) -> tuple[dict[str, Any], list[np.ndarray]]: ...


def read_in_child(
    function: ChildFunction,
    data: bytes,
    label: str,
    libraries: Sequence[str],
    *,
    modules: Sequence[str] = (),
    **request: Any,
) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Let a function read the content of a file in a child process.

    Parameters
    ----------
    function : function (stream, request) -> (answer, arrays) of a module that imports little: the child loads it by its
        file.
    data : content of the file.
    label : name of the file, which begins every sentence.
    libraries : modules that the child loads before its memory is limited.
    modules : further modules that it takes, which are loaded once for many files where the system can do that.
    request : what else the function takes.

    Returns
    -------
    answer, arrays
        What the function says; `answer` holds ``error`` and ``text``, and there are no arrays, where the library
        refused the file.

    Raises
    ------
    DataRejectedError
        If reading takes more memory or time than `sysid.limits` allows, or the library ends the process.
    """
    seconds = limits.reader_seconds(len(data))
    order = {
        "file": function.__code__.co_filename,
        "function": function.__name__,
        "libraries": list(libraries),
        "memory_bytes": limits.READER_BYTES,
        "seconds": seconds,
        **request,
    }
    content = json.dumps(order).encode() + b"\n" + data
    try:
        output, code = _forked(content, [*libraries, *modules]) if _FORKS else _started(content)
    except TimeoutError:
        raise _endless(label, limits.READER_WAIT_S) from None
    except OSError as error:
        raise DataRejectedError(
            f"{label} cannot be read: no process for its reader can be started ({error.strerror})."
        ) from None
    if code == -getattr(signal, "SIGXCPU", 0) != 0:
        raise _endless(label, seconds)
    line, _, rest = output.partition(b"\n")
    try:
        answer = dict(json.loads(line[:_LONGEST_ANSWER]))
        stream = io.BytesIO(rest)
        arrays = [np.load(stream, allow_pickle=False) for _ in range(answer.pop("arrays"))]
    except (ValueError, EOFError, TypeError, KeyError):
        raise DataRejectedError(f"{label} is damaged: its reader gave up; export it again.") from None
    if answer.get("error") == "memory":
        raise DataRejectedError(
            f"{label} takes more than {limits.READER_BYTES / 1e6:.0f} MB of memory to read; export it again or thin it."
        )
    return answer, arrays


def _command(*arguments: str) -> list[str]:
    # A new interpreter, not a fork of this process: threads of JAX do not survive a fork.  -P: the folder of the script
    # holds modules of this package whose names must not hide others.
    return [sys.executable, "-P", str(_WORKER), *arguments]


def _environment() -> dict[str, str]:
    # Every thread of the algebra library would take address space of its own.
    return {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


def _started(content: bytes) -> tuple[bytes, int]:
    """What a new process says to a content, and its exit code; it loads its libraries anew."""
    try:
        done = subprocess.run(
            _command(),
            input=content,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=limits.READER_WAIT_S,
            env=_environment(),
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise TimeoutError from None
    return done.stdout, done.returncode


def _forked(content: bytes, modules: Sequence[str]) -> tuple[bytes, int]:
    """What a process that the server forks says to a content, and its exit code.

    A server that is not there any more (nothing to do for a while, ended by somebody) is replaced once.
    """
    for _ in range(2):
        with _Kept.lock:
            if _Kept.server is None or _Kept.server.owner != os.getpid():
                _Kept.server = _Server()
            server = _Kept.server
        try:
            output, end = server.answer(content, modules)
        except BaseException as error:
            _end(server)
            if isinstance(error, BrokenPipeError | ConnectionResetError):
                continue
            raise
        if end:
            return output, os.waitstatus_to_exitcode(int(end))
        _end(server)
    raise OSError(errno.ECHILD, os.strerror(errno.ECHILD))


class _Server:
    """The process that has loaded libraries and forks another one for each file (:func:`sysid.read_worker.serve`)."""

    def __init__(self) -> None:
        self.owner = os.getpid()
        self._orders, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs, ExitStack() as failure:
            failure.callback(self._orders.close)
            self._process = subprocess.Popen(
                _command(str(theirs.fileno())),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                env=_environment(),
                # A group of its own: with it end the processes that it has forked.
                start_new_session=True,
            )
            failure.pop_all()

    def answer(self, content: bytes, modules: Sequence[str]) -> tuple[bytes, bytes]:
        """What a new process says to a content, and how it ended as a number of `os.waitpid`; empty if nobody knows.

        Raises
        ------
        TimeoutError
            If it has not ended in time.
        OSError
            If the server is not there any more, or there are no descriptors left.
        """
        ours, theirs = [], []
        try:
            for written_here in (True, False, False):
                read, write = os.pipe()
                ours.append(write if written_here else read)
                theirs.append(read if written_here else write)
            socket.send_fds(self._orders, [json.dumps(modules).encode()], theirs)
            while theirs:
                os.close(theirs.pop())
            threading.Thread(target=_write, args=(os.dup(ours[0]), content), daemon=True).start()
            os.close(ours.pop(0))
            until = time.monotonic() + limits.READER_WAIT_S
            return _read(ours[0], until), _read(ours[1], until)
        finally:
            for descriptor in ours + theirs:
                os.close(descriptor)

    def end(self) -> None:
        """End it and all that it has forked."""
        self._orders.close()
        if self.owner == os.getpid():
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()


class _Kept:
    """The server of this process, None while there is none."""

    server: _Server | None = None
    lock = threading.Lock()


def _end(server: _Server) -> None:
    with _Kept.lock:
        if _Kept.server is server:
            _Kept.server = None
    server.end()


@atexit.register
def end_readers() -> None:
    """End the process that forks others, if there is one; what they used then counts as used by children."""
    if _Kept.server is not None:
        _end(_Kept.server)


def _write(descriptor: int, content: bytes) -> None:
    # Who does not read any more has said why.
    with suppress(OSError), open(descriptor, "wb", buffering=0) as stream:
        left = memoryview(content)
        while left:
            left = left[stream.write(left) :]


def _read(descriptor: int, until_s: float) -> bytes:
    """All that comes before the end of a pipe, if that is before a time of the monotonic clock."""
    pieces: list[bytes] = []
    poll = select.poll()
    poll.register(descriptor)
    while poll.poll(1e3 * max(0.0, until_s - time.monotonic())):
        piece = os.read(descriptor, 1 << 20)
        if not piece:
            return b"".join(pieces)
        pieces.append(piece)
    raise TimeoutError


def _endless(label: str, seconds: float) -> DataRejectedError:
    return DataRejectedError(f"{label} takes longer than {seconds:.0f} s to read; export it again, or thin it.")
