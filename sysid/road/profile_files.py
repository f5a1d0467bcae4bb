"""Profiles of bumps and of rough roads from files: columns of text, ERD, or a long section of an OpenCRG surface.

OpenCRG files (ASAM OpenCRG 1.2, chapter 6: sections $ROAD_CRG and $KD_DEFINITION, payload LRFI, LDFI, KRBI or KDBI) are
read by pycrg, which holds ASAM's own C library: slope, banking and the modifiers of the file are applied there.  It
runs in a child process with limits on memory and time.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d

from sysid import limits
from sysid.bounded_reader import read_in_child
from sysid.campaign.records import BumpShape
from sysid.campaign.requests import START_HEIGHT_M
from sysid.campaign.roads import RoadCourse
from sysid.campaign.units import length_in_m
from sysid.errors import CampaignError, DataRejectedError
from sysid.logs.input_file import FileRefusedError, InputFile, read_file
from sysid.logs.text_table import TextTable, open_table
from sysid.road.cloud_libraries import read_crg
from sysid.road.erd_file import MARK as ERD_MARK
from sysid.road.erd_file import read_erd
from sysid.road.named_shapes import named_shape
from sysid.wording import joined_words, shorten

#: Bytes in which the mark of an OpenCRG file is looked for.
_HEAD_BYTES = 1 << 20
_STATION, _HEIGHT = "station_m", "height_m"
#: Heights of one track, or of both.
_TRACKS = (("height",), ("left_height", "right_height"))
#: Names of the columns, with or without a unit.
_COLUMN = re.compile(r"(station|(?:left_|right_)?height)(?:_(\w+)|\s*[\[(]([^\])]*)[\])])?", re.IGNORECASE)
#: Stations of measured roads are no nearer and no further apart than this [m] in the model.
_FINEST_M, _COARSEST_M = 0.005, 0.05
#: Grades and hills are no roughness: on longer roads [m] than this a mean with Gaussian weights of the standard
#: deviation [m] is taken out, which leaves 98 % of the longest wave of ISO 8608; of shorter roads the line through both
#: ends.
_LONG_M, _SMOOTHED_M = 300.0, 40.0
#: Largest distance of two heights of a road, and largest height after that [m].
_LARGEST_GAP_M = 1.0
_ROUGH_HEIGHT_M = 1.0
#: Units of the channels of OpenCRG other than long sections, in their spellings.
_STANDARD = dict.fromkeys(("m", "meter", "metre", "rad", "m/m", "-", "1"), 1.0)


def bump_from_file(path: Path | InputFile, lateral_m: float = 0.0, name: str | None = None) -> BumpShape:
    """Bump along the direction of travel in a file, as heights above the road at stations [m].

    Text has the columns ``station_m`` and ``height_m``, or ``left_height_m`` and ``right_height_m``; of two tracks
    the mean is taken. From an OpenCRG surface, the heights along the reference line, or `lateral_m` [m] to its left,
    are taken in the direction of increasing u. The straight line through the first and
    the last of them is subtracted, because the model drives on level road. `name` of the file for people, by default
    without folder. `path` may be a file that has been read already.

    Raises
    ------
    DataRejectedError
        If the file cannot be read, or holds no bump; one sentence with the file's name.
    """
    label, station, tracks = _heights(path, lateral_m, name)
    # The planar vehicle feels the mean of both tracks.
    height = tracks.mean(axis=0)
    if station.size > limits.PROFILE_STATIONS or np.ptp(station) > limits.PROFILE_LENGTH_M:
        raise DataRejectedError(
            f"{label}: the profile has {station.size} stations on {np.ptp(station):g} m, more than the "
            f"{limits.PROFILE_STATIONS} and {limits.PROFILE_LENGTH_M:g} m that are read; cut it to the bump."
        )
    if not START_HEIGHT_M < height.max() <= limits.PROFILE_HEIGHT_M:
        raise DataRejectedError(
            f"{label}: the profile rises by {height.max():.4g} m at most; a bump rises by more than "
            f"{START_HEIGHT_M:g} m and no more than {limits.PROFILE_HEIGHT_M:g} m."
        )
    shape = BumpShape("points", station_m=tuple(station), heights_m=tuple(height), source=label)
    try:
        named_shape(shape)
    except CampaignError as error:
        raise DataRejectedError(str(error)) from None
    return shape


def road_from_file(
    path: Path | InputFile, lateral_m: float = 0.0, name: str | None = None, length_m: float | None = None
) -> RoadCourse:
    """Rough road in a file, read as :func:`bump_from_file` reads a bump; it need not begin and end on level road.

    Parameters
    ----------
    length_m : of the road from its first station on [m], None for all of it.

    Raises
    ------
    DataRejectedError
        If the file cannot be read, or holds no road; one sentence with the file's name.
    """
    label, station, height = _heights(path, lateral_m, name)
    backward = np.flatnonzero(~(np.diff(station) > 0.0))
    if station.size < 3 or backward.size:
        where = f" (row {backward[0] + 2} of the data)" if backward.size else ""
        raise DataRejectedError(f"{label}: stations must increase along the road{where}, three or more; sort the rows.")
    station, steps = station - station[0], np.diff(station)
    if length_m is not None and length_m > station[-1]:
        raise DataRejectedError(
            f"{label} is {station[-1]:g} m long, and {length_m:g} m are asked for; shorten --length."
        )
    length = float(station[-1]) if length_m is None else length_m
    step = float(np.clip(np.median(steps), _FINEST_M, _COARSEST_M))
    count = int(length / step + 1e-6) + 1
    if length > limits.ROAD_LENGTH_M or count > limits.ROAD_STATIONS or count < 3:
        raise DataRejectedError(
            f"{label} is {length:g} m long; roads of {3 * step:g} m to {limits.ROAD_LENGTH_M:g} m are predicted: give "
            "stations in metres, or a --length."
        )
    if (gap := float(steps.max())) > _LARGEST_GAP_M:
        at = float(station[int(np.argmax(steps))])
        raise DataRejectedError(
            f"{label}: there is no height over {gap:.3g} m behind station {at:.6g} m; at most {_LARGEST_GAP_M:g} m."
        )
    grid = step * np.arange(count)
    height = np.array([_without_grade(grid, np.interp(grid, station, track)) for track in height])
    if (highest := float(np.abs(height).max())) > _ROUGH_HEIGHT_M:
        raise DataRejectedError(
            f"{label}: heights depart by {highest:.3g} m from the grade of the road, more than {_ROUGH_HEIGHT_M:g} m; "
            "give heights in metres."
        )
    return RoadCourse(float(grid[-1]), step_m=step, height_m=height, source=label)


def _without_grade(station_m: np.ndarray, height_m: np.ndarray) -> np.ndarray:
    """Heights without the grade and the hills of a road, zero at its start."""
    line = height_m[0] + (height_m[-1] - height_m[0]) * station_m / station_m[-1]
    free = height_m - line
    if station_m[-1] <= _LONG_M:
        return np.asarray(free)
    # Turned about its ends the road goes on as it came: there nothing is bent.
    width = _SMOOTHED_M / (station_m[1] - station_m[0])
    reach = min(int(4 * width), free.size - 1)
    longer = np.concatenate([-free[reach:0:-1], free, -free[-2 : -reach - 2 : -1]])
    return np.asarray(free - gaussian_filter1d(longer, width, truncate=4.0)[reach : reach + free.size])


def _heights(path: Path | InputFile, lateral_m: float, name: str | None) -> tuple[str, np.ndarray, np.ndarray]:
    """Name for people, stations (n,) and heights (tracks, n) [m] of a profile; of a surface, along one line."""
    label = shorten(path.name if name is None else name)
    source = _content(path, label)
    if source.suffix.lower() == ".crg" or b"$KD_DEFINITION" in source.data[:_HEAD_BYTES].upper():
        station, height = _long_section(source, label, lateral_m)
        return f"{label}, v = {lateral_m:g} m", station, height[None]
    if source.data.startswith(ERD_MARK):
        return label, *read_erd(source, label)
    if source.suffix.lower() == ".ppf":
        raise DataRejectedError(
            f"{label} is a PPF file (ASTM E2560, binary), which is not read; save it from ProVAL as ERD or as text."
        )
    return label, *_columns(source, label)


def _content(path: Path | InputFile, label: str) -> InputFile:
    if isinstance(path, InputFile):
        return path
    most = limits.PROFILE_BYTES / 1e6
    try:
        return read_file(path, limits.PROFILE_BYTES)
    except FileRefusedError as error:
        reason = "is not a plain file; name a profile or an OpenCRG file"
        if error.kind == "size":
            reason = f"has {error.size / 1e6:.0f} MB, more than the {most:.0f} MB that are read; cut it to the bump"
        elif error.kind == "changed":
            reason = "changed while it was read; start again when it is complete"
        raise DataRejectedError(f"{label} {reason}.") from None
    except FileNotFoundError:
        raise DataRejectedError(f"{label} is not a plain file; name a profile or an OpenCRG file.") from None
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or "no valid path"
        raise DataRejectedError(f"{label} cannot be opened ({why}); check its name and rights.") from None


def _columns(source: InputFile, label: str) -> tuple[np.ndarray, np.ndarray]:
    """Stations (n,) and heights (tracks, n) [m] of a table, in the units of its names or of a row of units."""

    def named(name: str) -> str | None:
        match = _COLUMN.fullmatch(name.strip())
        return match[1].casefold() if match is not None else None

    try:
        table = open_table(source, label, (), lambda name: named(name) is not None)
    except DataRejectedError as error:
        if not any(words in str(error) for words in ("campaign.toml", "column of time")):
            raise
        # The reader of tables looks for the columns of a campaign.
        raise DataRejectedError(f"{label} has no columns {_STATION} and {_HEIGHT}; a profile needs both.") from None
    places: dict[str, int] = {}
    for place, name in enumerate(table.names):
        if (quantity := named(name)) is not None:
            if quantity in places:
                raise DataRejectedError(f"{label} has several columns of {quantity}; keep one of them.")
            places[quantity] = place
    wanted = next((names for names in _TRACKS if all(name in places for name in names)), None)
    for quantity, name in (("station", _STATION), ("height", _HEIGHT)):
        if quantity not in places and (quantity == "station" or wanted is None):
            raise DataRejectedError(f"{label} has no column {name}; a profile needs {_STATION} and {_HEIGHT}.")
    assert wanted is not None
    if len(places) > 1 + len(wanted):
        raise DataRejectedError(f"{label} has heights of one track and of sides; keep height, or left and right.")
    columns = table.read(list(places.values()))
    for place in places.values():
        missing = np.flatnonzero(~np.isfinite(columns[place]))
        if missing.size:
            row = table.layout.first_row + int(missing[0])
            raise DataRejectedError(
                f"{label}, row {row}: {table.names[place]} is missing; every station needs a height."
            )
    station, *height = (columns[places[q]] * _unit_of(table, places[q], label) for q in ("station", *wanted))
    return station, np.array(height)


def _unit_of(table: TextTable, place: int, label: str) -> float:
    """Metres in the unit of a column, by its name and the row of units."""
    name = table.names[place]
    match = _COLUMN.fullmatch(name.strip())
    units = {u for u in ((match[2] or match[3]) if match is not None else None, table.unit(place)) if u}
    factors = {length_in_m(unit) for unit in units}
    factor = factors.pop() if len(factors) == 1 else None
    if factor is None:
        said = f"is in {joined_words(sorted(shorten(u, 20) for u in units))}" if units else "has no unit"
        raise DataRejectedError(
            f"{label}: the column '{shorten(name)}' {said}; name the columns {_STATION} and {_HEIGHT}."
        )
    return factor


def _long_section(source: InputFile, label: str, lateral_m: float) -> tuple[np.ndarray, np.ndarray]:
    if not _installed("pycrg"):
        raise CampaignError(
            f"{label} is an OpenCRG file, which takes the package pycrg to read; python -m pip install pycrg."
        )
    if re.search(rb"\$ROAD_CRG_FILE", source.data, re.IGNORECASE):
        raise DataRejectedError(f"{label} refers to another OpenCRG file; name that file itself.")
    most = limits.PROFILE_STATIONS
    surface, arrays = read_in_child(read_crg, source.data, label, ["pycrg"], lateral_m=lateral_m, most_stations=most)
    if "error" in surface:
        raise DataRejectedError(f"{label} cannot be read as OpenCRG: {_reason(str(surface.get('text', '')))}.")
    right, left, height = surface["right"], surface["left"], arrays[0]
    if not right - 1e-9 <= lateral_m <= left + 1e-9:
        raise DataRejectedError(
            f"{label} reaches from v = {right:g} to {left:g} m, and v = {lateral_m:g} m lies outside; choose another "
            "--lateral."
        )
    if height.size < 3 or not np.isfinite(height).all() or surface["missing"]:
        where = f" ({surface['missing']} cross sections lack a cell there, the first at u = {surface['hole']:g} m)"
        raise DataRejectedError(
            f"{label} has no height everywhere along v = {lateral_m:g} m{where if surface['missing'] else ''}; choose "
            "another --lateral or cut the file to the bump."
        )
    height = height * _metres(surface["units"], label)
    station = surface["step"] * np.arange(height.size)
    return station, height - height[0] - (height[-1] - height[0]) * station / station[-1]


def _metres(channels: Sequence[Sequence[str]], label: str) -> float:
    """Metres in the unit of the long sections, which the library takes as metres, as every other unit of the standard.

    Raises
    ------
    DataRejectedError
        If long sections have several units or one that is no length, or another channel has not that of the standard.
    """
    sections = {unit.strip() for name, unit in channels if name.strip().lower().startswith("long section")}
    others = [(n, u.strip()) for n, u in channels if not n.strip().lower().startswith("long section")]
    factor = length_in_m(next(iter(sections))) if len(sections) == 1 else None
    strange = next(((n, u) for n, u in others if u and _STANDARD.get(u.casefold(), 0.0) != 1.0), None)
    # Slope, banking and height of the reference line add to the heights.
    added = any(word in n.casefold() for n, _ in others for word in ("slope", "bank", "line z"))
    if factor is None or strange is not None or (factor != 1.0 and added):
        said = f"long sections in {joined_words(sorted(shorten(unit, 20) or 'no unit' for unit in sections))}"
        if strange is not None:
            said = f"'{shorten(strange[0].strip(), 40)}' in {shorten(strange[1], 20)}"
        raise DataRejectedError(f"{label} has {said}; OpenCRG wants m, rad and m/m: write the file again in these.")
    return factor


def _installed(package: str) -> bool:
    try:
        return importlib.util.find_spec(package) is not None
    except (ImportError, ValueError):
        return False


def _reason(text: str) -> str:
    """The message of the C library, without the names of its functions and of the copy that it read."""
    text = text.partition("(")[2].rpartition(")")[0] or text
    text = text.rpartition("; ")[2].partition(": ")[2] or text
    text = re.sub(r"( in )?<?[^\s<>]*surface\.crg>?", "", text)
    return shorten(text.strip(" .") or "it is damaged", 120)
