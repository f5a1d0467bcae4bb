"""What libraries read of LAZ (laspy) and OpenCRG (pycrg) files; meant for a child process.

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


def read_crg(stream: BinaryIO, request: dict[str, Any]) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Heights (n,) of the long section `lateral_m` beside the reference line, with the surface's range and step.

    The answer counts the cross sections in which a cell beside the line is `missing`, the first of them at `hole`, and
    names channels and `units`.
    """
    import pycrg

    with tempfile.TemporaryDirectory() as folder:
        # The library takes a path; this file holds the bytes that were hashed.
        path = os.path.join(folder, "surface.crg")
        with open(path, "wb") as copy:
            copy.write(stream.read())
        with pycrg.DataSet.open(path, check=True) as surface:
            (first, last), (right, left) = surface.u_range(), surface.v_range()
            step, _ = surface.increments()
            answer: dict[str, Any] = {"right": right, "left": left, "step": step, "missing": 0, "hole": 0.0}
            answer["units"] = [[channel.name, channel.unit] for channel in surface.header.channels]
            if not right - 1e-9 <= request["lateral_m"] <= left + 1e-9:
                return answer, [np.empty(0)]
            # The sum of a damaged increment could ask for any number of stations.
            if not step > 0.0 or (last - first) / step > request["most_stations"]:
                return answer, [np.zeros(request["most_stations"] + 1 if step > 0.0 else 0)]
            grid = surface.grid()
            beside = np.interp(request["lateral_m"], grid.v, np.arange(grid.v.size))
            columns = np.unique([int(np.floor(beside + 1e-6)), int(np.ceil(beside - 1e-6))])
            weights = np.ones(1) if columns.size == 1 else np.abs(beside - columns[::-1])
            heights = np.asarray(grid.elevation)[:, columns] @ weights
        # The modifiers that hold where a file names none fill holes from the column beside them.
        with pycrg.DataSet.open(path, apply_modifiers=False) as written:
            holes = np.flatnonzero(np.isnan(np.asarray(written.grid().z)[:, columns]).any(axis=1))
        if holes.size:
            answer |= {"missing": int(holes.size), "hole": float(first + step * holes[0])}
    return answer, [np.asarray(heights, dtype=np.float64)]
