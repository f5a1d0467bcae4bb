"""What libraries read of LAZ (laspy), PLY (plyfile) and OpenCRG (pycrg) files; meant for a child process.

The module imports nothing of this package, so that the child loads the library alone.
"""

from __future__ import annotations

import os
import tempfile
from typing import Any, BinaryIO

import numpy as np


def read_las(stream: BinaryIO, request: dict[str, Any]) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Coordinates (n, 3) of a LAS or LAZ file, in its unit."""
    import laspy

    with laspy.open(stream) as reader:
        if reader.header.point_count > request["most_points"]:
            return {"points": int(reader.header.point_count)}, [np.empty((0, 3))]
        cloud = reader.read()
    return {}, [np.column_stack([np.asarray(getattr(cloud, axis), dtype=np.float64) for axis in "xyz"])]


def read_ply(stream: BinaryIO, request: dict[str, Any]) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Coordinates (n, 3) of the vertices of a PLY file, in its unit; `names` are those of x, y and z."""
    from plyfile import PlyData

    vertex = PlyData.read(stream, mmap=False)["vertex"].data
    return {}, [np.column_stack([np.asarray(vertex[name], dtype=np.float64) for name in request["names"]])]


def read_crg(stream: BinaryIO, request: dict[str, Any]) -> tuple[dict[str, Any], list[np.ndarray]]:
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
                return answer, [np.empty(0)]
            # The sum of a damaged increment could ask for any number of stations.
            count = min(round((last - first) / step), request["most_stations"]) + 1 if step > 0.0 else 0
            station = step * np.arange(count)
            with surface.create_contact_point() as point:
                heights = point.uv_to_z_many(first + station, request["lateral_m"])
    return answer, [np.asarray(heights, dtype=np.float64)]
