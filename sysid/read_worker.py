"""Child process in which libraries read files that cannot be bounded otherwise: clouds, road surfaces, binary logs.

It is run as a script and imports of this package only the function that it is told.  From standard input come one line
of JSON, the request, and the content of the file; to standard output go one line of JSON, the answer, and arrays as
.npy one behind the other.  What a hostile file makes a library do ends here: memory and processor time are limited
before a byte of it is read.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import json
import os
import sys
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np


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


def function_of(file: str, name: str, root: str) -> Callable[..., tuple[dict[str, Any], list[np.ndarray]]]:
    """The function `name` of the module in `file`, which may import what lies below `root`.

    Raises
    ------
    ImportError
        If there is no such module.
    """
    # Last in the path: modules of the package must not hide others.
    sys.path.append(root)
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
        task = function_of(request["file"], request["function"], request["root"])
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


if __name__ == "__main__":
    main()
