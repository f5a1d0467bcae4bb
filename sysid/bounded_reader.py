"""Starts the child process that reads what cannot be bounded, and turns its end into an answer or a sentence."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from types import CodeType
from typing import Any, BinaryIO, Protocol

import numpy as np

from sysid import limits
from sysid.errors import DataRejectedError

_WORKER = Path(__file__).with_name("read_worker.py")
#: Bytes of an answer: names and units of the channels of a log take a few kilobytes.
_LONGEST_ANSWER = 1 << 20


class ChildFunction(Protocol):
    """A plain function that reads a stream as a request says: answer for JSON, and arrays."""

    __name__: str
    __code__: CodeType

    def __call__(self, stream: BinaryIO, request: dict[str, Any], /) -> tuple[dict[str, Any], list[np.ndarray]]: ...


def read_in_child(
    function: ChildFunction, data: bytes, label: str, libraries: Sequence[str], **request: Any
) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Let a function read the content of a file in a child process.

    Parameters
    ----------
    function : function (stream, request) -> (answer, arrays) of a module that imports little: the child loads it by its
        file.
    data : content of the file.
    label : name of the file, which begins every sentence.
    libraries : modules that the child loads before its memory is limited.
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
        "root": str(_WORKER.parents[1]),
        "libraries": list(libraries),
        "memory_bytes": limits.READER_BYTES,
        "seconds": seconds,
        **request,
    }
    # A new interpreter, not a fork: threads of JAX do not survive a fork.  -P: the folder of the script holds modules
    # of this package whose names must not hide others.
    command = [sys.executable, "-P", str(_WORKER)]
    # Every thread of the algebra library would take address space of its own.
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            command,
            input=json.dumps(order).encode() + b"\n" + data,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=limits.READER_WAIT_S,
            env=environment,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise _endless(label, limits.READER_WAIT_S) from None
    except OSError as error:
        raise DataRejectedError(
            f"{label} cannot be read: no process for its reader can be started ({error.strerror})."
        ) from None
    if done.returncode == -getattr(signal, "SIGXCPU", 0) != 0:
        raise _endless(label, seconds)
    line, _, rest = done.stdout.partition(b"\n")
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


def _endless(label: str, seconds: float) -> DataRejectedError:
    return DataRejectedError(f"{label} takes longer than {seconds:.0f} s to read; export it again, or thin it.")
