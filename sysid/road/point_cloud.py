"""Laser point clouds from CSV, XYZ, PLY and LAS files, in metres."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np

from sysid import limits
from sysid.campaign.units import LENGTH_IN_M, length_in_m
from sysid.errors import DataRejectedError
from sysid.logs.input_file import FileRefusedError, InputFile, read_file
from sysid.road.las_file import las_points, las_units
from sysid.road.ply_file import ply_points, ply_unit
from sysid.road.text_cloud import read_text_cloud

# Lengths in which scanners write; anything else is converted before it comes here.
UNIT_IN_M = MappingProxyType({**LENGTH_IN_M, "inch": LENGTH_IN_M["in"]})
MAX_POINTS = limits.CLOUD_POINTS


def read_point_cloud(path: Path | InputFile, unit: str = "m") -> np.ndarray:
    """Read a point cloud and return its points (n, 3) float64 in metres.

    The format is found from the content of the file:

    - text (CSV, XYZ, TXT, PTS): comma, semicolon, tab or space, decimal point or comma, with or without a header that
      names x, y and z in any order;
    - PLY (ASCII and binary);
    - LAS (LAZ if a decompressor is installed). Further columns are ignored; rows without three finite numbers below 1e8
      m are dropped (see :func:`read_point_cloud_counted`). `unit` is the unit of the file: m, dm, cm, mm, um, in, ft.
      Raises DataRejectedError (one sentence: file, row, remedy) for anything that cannot be read.
    """
    return read_point_cloud_counted(path, unit)[0]


def read_point_cloud_counted(path: Path | InputFile, unit: str = "m") -> tuple[np.ndarray, int]:
    """Read a point cloud as :func:`read_point_cloud` and return its points (n, 3) [m] and the number of rows dropped.

    Raises
    ------
    DataRejectedError
        If the unit is not known, the file is missing, too large or no point cloud, or fewer than half of its points
        have three finite numbers.
    """
    source = path if isinstance(path, InputFile) else Path(path)
    label = f"Scan {source.name}"
    if unit not in UNIT_IN_M:
        raise DataRejectedError(
            f"{label}: unit '{unit}' is not known; give one of {', '.join(UNIT_IN_M)} in the campaign file."
        )
    data = _content(source, label)
    if data.startswith(b"ply"):
        raw = ply_points(data, label, MAX_POINTS)
        written = ply_unit(data)
        _compare(label, unit, [size for size in [length_in_m(written or "")] if size is not None])
    elif data.startswith(b"LASF"):
        raw = las_points(data, label, MAX_POINTS)
        _compare(label, unit, las_units(data))
    else:
        raw = read_text_cloud(data, label, unit, MAX_POINTS)
    del data
    # Beyond any map there is no point: scanners write such numbers where nothing came back.
    most = limits.COORDINATE_M / UNIT_IN_M[unit]
    usable = np.logical_and.reduce([(column >= -most) & (column <= most) for column in raw.T])
    kept = int(np.count_nonzero(usable))
    dropped = int(raw.shape[0]) - kept
    if kept == 0:
        raise DataRejectedError(f"{label} holds no point with three numbers; check the export of the scanner.")
    if dropped > kept:
        raise DataRejectedError(
            f"{label}: {dropped} of {raw.shape[0]} points have a coordinate that is missing or beyond "
            f"{limits.COORDINATE_M:g} m; export the cloud again with x, y and z of every point."
        )
    points = np.ascontiguousarray(raw if dropped == 0 else raw[usable], dtype=np.float64)
    points *= UNIT_IN_M[unit]
    return points, dropped


def _compare(label: str, unit: str, said_m: Sequence[float]) -> None:
    """Refuse a unit that is none of those [m] that the file names."""
    # A survey foot is a foot to six digits.
    if said_m and all(abs(size / UNIT_IN_M[unit] - 1.0) > 1e-5 for size in said_m):
        named = min(UNIT_IN_M, key=lambda name: abs(UNIT_IN_M[name] / said_m[0] - 1.0))
        raise DataRejectedError(
            f"{label} says that its coordinates are in {named}, but the campaign file says unit = '{unit}'; make them "
            "agree."
        )


def _content(source: Path | InputFile, label: str) -> bytes:
    """Content of a file that exists, is a plain file and is not too large."""
    most = limits.SCAN_BYTES
    try:
        data = (source if isinstance(source, InputFile) else read_file(source, most)).data
    except FileRefusedError as error:
        reason = {
            "folder": "is a folder; name the point-cloud file in it",
            "special": "is not a plain file; name a point-cloud file",
            "size": f"has {error.size / 1e6:.0f} MB, more than the {most / 1e6:.0f} MB that are read; crop the cloud "
            "to a few metres around the bump or thin it",
        }.get(error.kind, "changed while it was read; start again when it is complete")
        raise DataRejectedError(f"{label} {reason}.") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "no valid path"
        raise DataRejectedError(f"{label} cannot be opened ({reason}); check its name and rights.") from error
    if not data:
        raise DataRejectedError(f"{label} is empty; export it again.")
    return data
