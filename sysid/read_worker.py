"""Child process in which libraries read files that cannot be bounded otherwise: clouds, road surfaces, binary logs.

It is run as a script and imports of this package only the function that it is told.  From standard input come one line
of JSON, the request, and the content of the file; to standard output go one line of JSON, the answer, and arrays as
.npy one behind the other.  What a hostile file makes a library do ends here: memory and processor time are limited
before a byte of it is read.

With the number of a socket as its argument it is the parent of such processes instead: it imports libraries once, and
forks a process for each file, which meets the limits as above and nothing of the files before it.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import json
import os
import select
import signal
import socket
import sys
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

#: Seconds without a file after which the parent of readers ends, so that its memory does not add to that of others.
IDLE_S = 10.0


class Pipe:
    """A stream that can only be written: NumPy asks real files for their position, which a pipe has not."""

    def __init__(self, descriptor: int):
        self.stream = os.fdopen(descriptor, "wb")

    def write(self, data: Any) -> int:
        """Write bytes."""
        return self.stream.write(data)


def limit_process(memory_bytes: int, seconds: float) -> None:
    """Limit memory beyond what is in use and processor time, where the system knows such limits."""
    try:
        import resource
    except ImportError:  # Windows: the parent limits the time
        return
    wanted = {resource.RLIMIT_CPU: int(seconds) + 1, resource.RLIMIT_CORE: 0}
    with contextlib.suppress(OSError, ValueError), open("/proc/self/statm", encoding="ascii") as stream:
        wanted[resource.RLIMIT_AS] = int(stream.read().split()[0]) * resource.getpagesize() + memory_bytes
    for which, value in wanted.items():
        # A limit that is stricter already stays.
        with contextlib.suppress(OSError, ValueError):
            hard = resource.getrlimit(which)[1]
            value = value if hard == resource.RLIM_INFINITY else min(value, hard)
            # A process at its hard limit of time is killed without the signal that tells the parent why.
            above = value + 2 if which == resource.RLIMIT_CPU else value
            resource.setrlimit(which, (value, above if hard == resource.RLIM_INFINITY else min(above, hard)))


def function_of(file: str, name: str) -> Callable[..., tuple[dict[str, Any], list[np.ndarray]]]:
    """The function `name` of the module in `file`.

    Raises
    ------
    ImportError
        If there is no such module.
    """
    specification = importlib.util.spec_from_file_location("reader_in_child", file)
    if specification is None or specification.loader is None:
        raise ImportError(f"no module in {file}")
    module = importlib.util.module_from_spec(specification)
    sys.modules[specification.name] = module
    specification.loader.exec_module(module)
    task: Callable[..., tuple[dict[str, Any], list[np.ndarray]]] = getattr(module, name)
    return task


def main() -> None:
    """Read one file and answer."""
    # What a library prints must not stand among the answers.
    answers = Pipe(os.dup(sys.stdout.fileno()))
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    warnings.simplefilter("ignore")
    request = json.loads(sys.stdin.buffer.readline())
    arrays: list[np.ndarray] = []
    try:
        task = function_of(request["file"], request["function"])
        for library in request["libraries"]:
            importlib.import_module(library)
        limit_process(request["memory_bytes"], request["seconds"])
        answer, arrays = task(io.BytesIO(sys.stdin.buffer.read()), request)
    except MemoryError:
        answer = {"error": "memory"}
    except ImportError as error:
        answer = {"error": "missing", "text": str(error)[:300]}
    # A library meets arbitrary bytes: whatever it stumbles over is the file's fault, also what it derives from
    # BaseException, as panics of Rust are.
    except BaseException as error:
        answer = {"error": type(error).__name__, "text": str(error)[:1000]}
    answers.write(json.dumps({**answer, "arrays": len(arrays)}).encode() + b"\n")
    for array in arrays:
        np.save(answers, array, allow_pickle=False)
    answers.stream.close()


def serve(descriptor: int) -> None:
    """Fork a process for each file that is sent, until nobody is left who sends or nothing came for a while.

    A message on the socket is a JSON list of modules to import before; with it come three descriptors: standard input
    and standard output of the process, and where to write how it ended (as of `os.waitpid`) once it has.
    """
    orders = socket.socket(fileno=descriptor)
    ends: dict[int, int] = {}
    woken, wake = os.pipe()
    os.set_blocking(wake, False)
    signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
    signal.signal(signal.SIGCHLD, lambda number, frame: None)
    while True:
        ready, _, _ = select.select([orders.fileno(), woken], [], [], None if ends else IDLE_S)
        if not ready:
            return
        if woken in ready:
            os.read(woken, 4096)
            for process in list(ends):
                done, status = os.waitpid(process, os.WNOHANG)
                if done:
                    os.write(ends[process], str(status).encode())
                    os.close(ends.pop(process))
        if orders.fileno() in ready:
            message, descriptors, _, _ = socket.recv_fds(orders, 1 << 16, 3)
            if not message:
                return
            given, taken, end = descriptors
            for module in json.loads(message):
                # The process that needs it says what is wrong with it.
                with contextlib.suppress(Exception):
                    importlib.import_module(module)
            try:
                process = os.fork()
            except OSError:
                # An end without a number: the file was not read.
                process = -1
                os.close(end)
            if process == 0:
                try:
                    signal.set_wakeup_fd(-1)
                    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                    os.dup2(given, 0)
                    os.dup2(taken, 1)
                    orders.close()
                    for other in (given, taken, end, woken, wake, *ends.values()):
                        os.close(other)
                    main()
                finally:
                    os._exit(0)
            if process > 0:
                ends[process] = end
            os.close(given)
            os.close(taken)


if __name__ == "__main__":
    # Last in the path: modules of the package must not hide others.
    sys.path.append(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
    if len(sys.argv) > 1:
        serve(int(sys.argv[1]))
    else:
        main()
