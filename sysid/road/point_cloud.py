"""Laser point clouds from CSV, XYZ, PLY and LAS files, in metres."""

from __future__ import annotations

import re
from pathlib import Path
from types import MappingProxyType

import laspy
import numpy as np
from plyfile import PlyData

from sysid.errors import DataRejectedError
from sysid.road.text_cloud import read_text_cloud

# Lengths in which scanners write; anything else is converted before it comes here.
UNIT_IN_M = MappingProxyType(
    {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "inch": 0.0254, "ft": 0.3048}
)
MAX_FILE_BYTES = 200_000_000
MAX_POINTS = 4_000_000
_REMEDY_SIZE = "crop the cloud to a few metres around the bump or thin it"


def read_point_cloud(path: Path, unit: str = "m") -> np.ndarray:
    """Read a point cloud and return its points (n, 3) float64 in metres.

    Text files (CSV, XYZ, TXT, PTS: comma, semicolon, tab or space, decimal point or comma, with a header naming x, y
    and z in any order or without one), PLY (ASCII and binary) and LAS (LAZ where a decompressor is installed) are told
    apart by their content.  Further columns are ignored; rows without three finite numbers are dropped (see
    :func:`read_point_cloud_counted`).  `unit` is the unit of the file: m, dm, cm, mm, um, in, ft.
    Raises DataRejectedError (one sentence: file, row, remedy) for anything that cannot be read.
    """
    return read_point_cloud_counted(path, unit)[0]


def read_point_cloud_counted(path: Path, unit: str = "m") -> tuple[np.ndarray, int]:
    """Read a point cloud as :func:`read_point_cloud` and return its points (n, 3) [m] and the number of rows dropped.

    Raises
    ------
    DataRejectedError
        If the unit is not known, the file is missing, too large or no point cloud, or fewer than half of its points
        have three finite numbers.
    """
    path = Path(path)
    if unit not in UNIT_IN_M:
        raise DataRejectedError(
            f"Scan {path.name}: unit '{unit}' is not known; give one of {', '.join(UNIT_IN_M)} in the campaign file."
        )
    magic = _check_file(path)
    if magic.startswith(b"ply"):
        raw = _read_ply(path)
    elif magic.startswith(b"LASF"):
        raw = _read_las(path)
    else:
        raw = read_text_cloud(path, unit, MAX_POINTS)
    finite = np.isfinite(raw).all(axis=1)
    kept = int(np.count_nonzero(finite))
    dropped = int(raw.shape[0]) - kept
    if kept == 0:
        raise DataRejectedError(f"Scan {path.name} holds no point with three numbers; check the export of the scanner.")
    if dropped > kept:
        raise DataRejectedError(
            f"Scan {path.name}: {dropped} of {raw.shape[0]} points have a missing coordinate; "
            "export the cloud again with x, y and z of every point."
        )
    points = raw if dropped == 0 else raw[finite]
    return np.ascontiguousarray(points, dtype=np.float64) * UNIT_IN_M[unit], dropped


def _check_file(path: Path) -> bytes:
    """Return the first bytes of a file that exists, is a plain file and is not too large."""
    try:
        if path.is_dir():
            raise DataRejectedError(f"Scan {path.name} is a folder; name the point-cloud file in it.")
        size = path.stat().st_size
        if not path.is_file():
            raise DataRejectedError(f"Scan {path.name} is not a plain file; name a point-cloud file.")
        if size > MAX_FILE_BYTES:
            raise DataRejectedError(
                f"Scan {path.name} has {size / 1e6:.0f} MB, more than the {MAX_FILE_BYTES / 1e6:.0f} MB that are read; "
                f"{_REMEDY_SIZE}."
            )
        with path.open("rb") as stream:
            magic = stream.read(4)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise DataRejectedError(f"Scan {path.name} cannot be opened ({reason}); check its name and rights.") from error
    if not magic:
        raise DataRejectedError(f"Scan {path.name} is empty; export it again.")
    return magic


def _read_ply(path: Path) -> np.ndarray:
    _check_ply_header(path)
    try:
        vertex = PlyData.read(str(path), mmap=False)["vertex"].data
        names = {str(name).lower(): name for name in vertex.dtype.names}
        missing = [axis for axis in "xyz" if axis not in names]
        if missing:
            raise DataRejectedError(
                f"Scan {path.name}: the PLY vertices have no property {', '.join(missing)}; export x, y and z."
            )
        return np.column_stack([np.asarray(vertex[names[axis]], dtype=np.float64) for axis in "xyz"])
    except DataRejectedError:
        raise
    # The parser meets arbitrary bytes: whatever it stumbles over means the same to the user.
    except Exception as error:
        raise DataRejectedError(
            f"Scan {path.name} is not a readable PLY file ({_first_line(error)}); export it again."
        ) from error


def _check_ply_header(path: Path) -> None:
    # plyfile allocates by the counts of the header: a count that the file cannot hold must not get that far.
    with path.open("rb") as stream:
        head = stream.read(65536)
    header = head.split(b"end_header", 1)[0].decode("ascii", errors="replace")
    if b"end_header" not in head:
        raise DataRejectedError(f"Scan {path.name} is a PLY file without the end of its header; export it again.")
    counts = {name: int(count[:18]) for name, count in re.findall(r"^\s*element\s+(\S+)\s+(\d+)", header, re.MULTILINE)}
    size = path.stat().st_size
    if "vertex" not in counts:
        raise DataRejectedError(f"Scan {path.name} is a PLY file without vertices; export the points.")
    if sum(counts.values()) > size:
        raise DataRejectedError(
            f"Scan {path.name} promises {sum(counts.values())} PLY elements but has only {size} bytes; export it again."
        )
    _check_count(path, counts["vertex"])


def _read_las(path: Path) -> np.ndarray:
    try:
        with laspy.open(str(path)) as reader:
            header = reader.header
            _check_count(path, header.point_count)
            stored = header.offset_to_point_data + header.point_count * header.point_format.size
            if not header.are_points_compressed and stored > path.stat().st_size:
                raise DataRejectedError(
                    f"Scan {path.name} promises {header.point_count} points but is cut short; copy or export it again."
                )
            cloud = reader.read()
            return np.column_stack([np.asarray(getattr(cloud, axis), dtype=np.float64) for axis in "xyz"])
    except DataRejectedError:
        raise
    except Exception as error:
        text = _first_line(error)
        if "backend" in text.lower():
            raise DataRejectedError(
                f"Scan {path.name} is compressed (LAZ) and no decompressor is installed; "
                "install 'lazrs' or export the cloud as LAS."
            ) from error
        raise DataRejectedError(f"Scan {path.name} is not a readable LAS file ({text}); export it again.") from error


def _check_count(path: Path, count: int) -> None:
    if count > MAX_POINTS:
        raise DataRejectedError(
            f"Scan {path.name} has {count} points, more than the {MAX_POINTS} that are read; {_REMEDY_SIZE}."
        )
    if count == 0:
        raise DataRejectedError(f"Scan {path.name} holds no points; check the export of the scanner.")


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0][:160] if lines else type(error).__name__
