"""Bump profiles from files: two columns of text, or a long section of an OpenCRG road surface.

OpenCRG files (ASAM OpenCRG 1.2, chapter 6: sections $ROAD_CRG and $KD_DEFINITION, payload LRFI, LDFI, KRBI or KDBI) are
read by pycrg, which holds ASAM's own C library: slope, banking and the modifiers of the file are applied there.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sysid.campaign.records import BumpShape
from sysid.campaign.text_table import read_columns
from sysid.campaign.wording import shorten
from sysid.errors import CampaignError, DataRejectedError
from sysid.road.named_shapes import named_shape
from sysid.road.shapes import START_HEIGHT_M

MAX_FILE_BYTES = 200_000_000
#: Longest and highest profile [m], and most stations of one.
MAX_LENGTH_M = 100.0
MAX_HEIGHT_M = 1.0
MAX_STATIONS = 100_000
_HEAD_BYTES = 1 << 20
_STATION, _HEIGHT = "station_m", "height_m"


def bump_from_file(path: Path, lateral_m: float = 0.0, name: str | None = None) -> BumpShape:
    """Bump along the direction of travel in a file, as heights above the road at stations [m].

    Text has the columns ``station_m`` and ``height_m``.  Of an OpenCRG surface the heights along the reference line, or
    `lateral_m` [m] to its left, are taken in the direction of increasing u, less the straight line through the first
    and the last of them: the model drives on level road.  `name` of the file for people, by default without folder.

    Raises
    ------
    DataRejectedError
        If the file cannot be read, or holds no bump; one sentence with the file's name.
    """
    label = shorten(path.name if name is None else name)
    head = _head(path, label)
    if b"$KD_DEFINITION" in head.upper() or path.suffix.lower() == ".crg":
        station, height = _long_section(path, label, head, lateral_m)
        label += f", v = {lateral_m:g} m"
    else:
        station, height = _columns(path, label)
    if station.size > MAX_STATIONS or np.ptp(station) > MAX_LENGTH_M:
        raise DataRejectedError(
            f"{label}: the profile has {station.size} stations on {np.ptp(station):g} m, more than the {MAX_STATIONS} "
            f"and {MAX_LENGTH_M:g} m that are read; cut it to the bump."
        )
    if not START_HEIGHT_M < height.max() <= MAX_HEIGHT_M:
        raise DataRejectedError(
            f"{label}: the profile rises by {height.max():.4g} m at most; a bump rises by more than "
            f"{START_HEIGHT_M:g} m and no more than {MAX_HEIGHT_M:g} m."
        )
    shape = BumpShape("points", station_m=tuple(station), heights_m=tuple(height), source=label)
    try:
        named_shape(shape)
    except CampaignError as error:
        raise DataRejectedError(str(error)) from None
    return shape


def _head(path: Path, label: str) -> bytes:
    try:
        if not path.is_file():
            raise DataRejectedError(f"{label} is not a plain file; name a profile or an OpenCRG file.")
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            raise DataRejectedError(
                f"{label} has {size / 1e6:.0f} MB, more than the {MAX_FILE_BYTES / 1e6:.0f} MB that are read; cut it "
                "to the bump."
            )
        with path.open("rb") as stream:
            return stream.read(_HEAD_BYTES)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise DataRejectedError(f"{label} cannot be opened ({reason}); check its name and rights.") from None


def _columns(path: Path, label: str) -> tuple[np.ndarray, np.ndarray]:
    try:
        _, columns, first = read_columns(path, label, [_HEIGHT], [_STATION])
    except DataRejectedError as error:
        if "campaign.toml" not in str(error):
            raise
        # The reader of logs looks for the columns of a campaign.
        raise DataRejectedError(f"{label} has no columns {_STATION} and {_HEIGHT}; a profile needs both.") from None
    found = {name.casefold(): values for name, values in columns.items()}
    for name in (_STATION, _HEIGHT):
        if name not in found:
            raise DataRejectedError(f"{label} has no column {name}; a profile needs {_STATION} and {_HEIGHT}.")
        missing = np.flatnonzero(~np.isfinite(found[name]))
        if missing.size:
            raise DataRejectedError(
                f"{label}, row {first + int(missing[0])}: {name} is missing; every station needs a height."
            )
    return found[_STATION], found[_HEIGHT]


def _long_section(path: Path, label: str, head: bytes, lateral_m: float) -> tuple[np.ndarray, np.ndarray]:
    crg = _library(label)
    if b"$ROAD_CRG_FILE" in head.upper():
        raise DataRejectedError(f"{label} refers to another OpenCRG file; name that file itself.")
    try:
        with crg.DataSet.open(path, check=True) as surface:
            (first, last), (right, left) = surface.u_range(), surface.v_range()
            step, _ = surface.increments()
            if not right - 1e-9 <= lateral_m <= left + 1e-9:
                raise DataRejectedError(
                    f"{label} reaches from v = {right:g} to {left:g} m, and v = {lateral_m:g} m lies outside; choose "
                    "another --lateral."
                )
            # The sum of a damaged increment could ask for any number of stations.
            count = min(round((last - first) / step), MAX_STATIONS) + 1 if step > 0.0 else 0
            station = step * np.arange(count)
            with surface.create_contact_point() as point:
                height = np.asarray(point.uv_to_z_many(first + station, lateral_m), dtype=np.float64)
    except (crg.OpenCRGError, ValueError, OverflowError) as error:
        raise DataRejectedError(f"{label} cannot be read as OpenCRG: {_reason(error, path)}.") from None
    if count < 3 or not np.isfinite(height).all():
        raise DataRejectedError(
            f"{label} has no height everywhere along v = {lateral_m:g} m; choose another --lateral or cut the file to "
            "the bump."
        )
    return station, height - height[0] - (height[-1] - height[0]) * station / station[-1]


def _library(label: str) -> Any:
    try:
        import pycrg
    except ImportError:
        raise CampaignError(
            f"{label} is an OpenCRG file, which takes the package pycrg to read; python -m pip install pycrg."
        ) from None
    return pycrg


def _reason(error: Exception, path: Path) -> str:
    """What the C library says, without the names of its functions and the path."""
    text = str(error).partition("(")[2].rpartition(")")[0] or str(error)
    text = text.rpartition("; ")[2].partition(": ")[2] or text
    return shorten(text.replace(f" in <{path}>", "").replace(str(path), path.name).strip(" ."), 120)
