"""Child process that reads files whose libraries cannot be bounded: LAZ (laspy), PLY (plyfile), OpenCRG (pycrg).

It is run as a script and imports nothing of this package.  From standard input come one line of JSON, the task, and
the content of the file; to standard output go one line of JSON, the answer, and an array as .npy.  What a hostile file
makes a library do ends here: memory and processor time are limited before a byte of it is read.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import sys
import tempfile
from collections.abc import Callable
from typing import Any, BinaryIO

import numpy as np


def read_las(stream: BinaryIO, request: dict[str, Any]) -> tuple[dict[str, Any], np.ndarray]:
    """Coordinates (n, 3) of a LAS or LAZ file, in its unit."""
    import laspy

    with laspy.open(stream) as reader:
        if reader.header.point_count > request["most_points"]:
            return {"points": int(reader.header.point_count)}, np.empty((0, 3))
        cloud = reader.read()
    return {}, np.column_stack([np.asarray(getattr(cloud, axis), dtype=np.float64) for axis in "xyz"])


def read_ply(stream: BinaryIO, request: dict[str, Any]) -> tuple[dict[str, Any], np.ndarray]:
    """Coordinates (n, 3) of the vertices of a PLY file, in its unit; `names` are those of x, y and z."""
    from plyfile import PlyData

    vertex = PlyData.read(stream, mmap=False)["vertex"].data
    return {}, np.column_stack([np.asarray(vertex[name], dtype=np.float64) for name in request["names"]])


def read_crg(stream: BinaryIO, request: dict[str, Any]) -> tuple[dict[str, Any], np.ndarray]:
    """Heights (n,) of the long section `lateral_m` beside the reference line, with the surface's range and step."""
    import pycrg

    with tempfile.TemporaryDirectory() as folder:
        # The library takes a path; this file holds the bytes that were hashed.
        path = os.path.join(folder, "surface.crg")
        with open(path, "wb") as copy:
            copy.write(stream.read())
        with pycrg.DataSet.open(path, check=True) as surface:
            (first, last), (right, left) = surface.u_range(), surface.v_range()
            step, _ = surface.increments()
            answer = {"right": right, "left": left, "step": step}
            if not right - 1e-9 <= request["lateral_m"] <= left + 1e-9:
                return answer, np.empty(0)
            # The sum of a damaged increment could ask for any number of stations.
            count = min(round((last - first) / step), request["most_stations"]) + 1 if step > 0.0 else 0
            station = step * np.arange(count)
            with surface.create_contact_point() as point:
                heights = point.uv_to_z_many(first + station, request["lateral_m"])
    return answer, np.asarray(heights, dtype=np.float64)


TASKS: dict[str, tuple[str, Callable[[BinaryIO, dict[str, Any]], tuple[dict[str, Any], np.ndarray]]]] = {
    "las": ("laspy", read_las),
    "ply": ("plyfile", read_ply),
    "crg": ("pycrg", read_crg),
}


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
            resource.setrlimit(which, (value, value))


def main() -> None:
    """Read one file and answer."""
    request = json.loads(sys.stdin.buffer.readline())
    module, task = TASKS[request["task"]]
    array = np.empty(0)
    try:
        __import__(module)
        limit_process(request["memory_bytes"], request["seconds"])
        answer, array = task(io.BytesIO(sys.stdin.buffer.read()), request)
    except MemoryError:
        answer = {"error": "memory"}
    except ImportError as error:
        answer = {"error": "missing", "text": str(error)[:300]}
    # A library meets arbitrary bytes: whatever it stumbles over is the file's fault.
    except Exception as error:
        answer = {"error": type(error).__name__, "text": str(error)[:1000]}
    sys.stdout.buffer.write(json.dumps(answer).encode() + b"\n")
    np.save(sys.stdout.buffer, array, allow_pickle=False)


if __name__ == "__main__":
    main()
