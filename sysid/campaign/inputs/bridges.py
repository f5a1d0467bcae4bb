"""Bridges of a campaign file, or of a TOML file of their own, with the files that they name."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sysid import limits
from sysid.campaign.bridges import BridgeDescription, GivenLine, GivenModes, LineKind, SupportName, Surface
from sysid.campaign.inputs import paths
from sysid.campaign.inputs.bumps import RoadReader
from sysid.campaign.roads import RoadCourse
from sysid.errors import CampaignError, DataRejectedError
from sysid.logs.input_file import FileRefusedError, InputFile, read_file
from sysid.logs.text_table import open_table
from sysid.wording import shorten

if TYPE_CHECKING:
    from sysid.campaign.toml.schema_bridge import BridgeTable, SurfaceTable

#: Column over which influence lines and mode shapes are given.
_STATION = "station_m"
#: Unit of an influence line by the first word of its name, as it ends that name: moment_midspan_m.
_LINE_NAME = re.compile(r"(moment|shear|deflection)_(.+)_(m|1|m_per_N)", re.IGNORECASE)
_LINE_UNIT = {"moment": "m", "shear": "1", "deflection": "m_per_N"}
_LINE_KIND: dict[str, LineKind] = {"moment": "moment", "shear": "shear", "deflection": "deflection"}
#: File of a bridge that a table names: its key and its name.
Content = Callable[[str, str], InputFile]


def described_bridge(
    name: str, table: BridgeTable, content: Content, road_reader: RoadReader | None
) -> BridgeDescription:
    """A bridge with the influence lines, modes and surface that its table names.

    Parameters
    ----------
    content : reads the file that a key names.

    Raises
    ------
    CampaignError
        If a file is missing.
    DataRejectedError
        If a file has no such columns, or stations that do not increase.
    """
    spans = len(table.spans_m)
    pinned: SupportName = "pinned"

    def per_span(value: float | list[float] | None) -> tuple[float, ...]:
        if value is None:
            return ()
        return tuple(value) if isinstance(value, list) else (value,) * max(spans, 1)

    damping = table.damping_ratio
    lines: tuple[GivenLine, ...] = ()
    modes = None
    if table.influence_lines is not None:
        lines = _lines(content("influence_lines", table.influence_lines))
    if table.mode_shapes is not None:
        file = content("mode_shapes", table.mode_shapes)
        modes = _modes(file, np.array(table.frequencies_hz), np.array(table.modal_masses_kg))
    return BridgeDescription(
        name,
        tuple(table.spans_m),
        tuple(table.supports) or (pinned,) * (spans + 1 if spans else 0),
        per_span(table.bending_stiffness_N_m2),
        per_span(table.mass_kg_m),
        () if damping is None else tuple(damping) if isinstance(damping, list) else (damping,),
        table.followed if spans else 0,
        None if table.sections_m is None else tuple(table.sections_m),
        lines,
        modes,
        None if table.surface is None else _surface(table.surface, content, road_reader),
    )


def bridge_from_file(path: Path, road_reader: RoadReader) -> BridgeDescription:
    """A bridge from a TOML file with the keys of a [bridge.NAME] table; files that it names lie beside it.

    Raises
    ------
    CampaignError
        If the file is wrong, or names one that is missing.
    DataRejectedError
        If a file that it names cannot be used.
    """
    from sysid.campaign.toml.errors import validated
    from sysid.campaign.toml.reading import parse_toml
    from sysid.campaign.toml.schema_bridge import BridgeFile

    label = shorten(path.name)
    try:
        file = read_file(path, limits.CAMPAIGN_BYTES)
    except (FileRefusedError, OSError, ValueError):
        raise CampaignError(f"{label} cannot be read; name a TOML file with the keys of a bridge.") from None
    table = validated(BridgeFile, {"bridge": parse_toml(file.data, label)}, label).bridge

    def content(key: str, name: str) -> InputFile:
        return paths.input_file(path.parent, name, f"{label}: {key}", limits.PROFILE_BYTES)

    return described_bridge(path.stem, table, content, road_reader)


def _surface(table: SurfaceTable, content: Content, road_reader: RoadReader | None) -> Surface:
    if table.file is None:
        return Surface(RoadCourse(0.0, table.roughness, table.seed, table.realisations), 0.0)
    file = content("surface.file", table.file)
    at = table.bridge_at_m or 0.0
    name = paths.relative_name(table.file)
    if road_reader is None:
        return Surface(RoadCourse(0.0, source=name), at)
    course = road_reader(file, table.lateral_m or 0.0, name, None)
    if at > course.length_m:
        raise DataRejectedError(f"{name} is {course.length_m:g} m long; bridge_at_m = {at:g} lies behind its end.")
    return Surface(course, at)


def _columns(file: InputFile) -> tuple[str, np.ndarray, dict[str, np.ndarray]]:
    """Name of a file, its stations (m,) and its other columns by name."""
    label = shorten(file.name)
    # All columns are numbers: whatever stands in the row of the stations' name is a name.
    table = open_table(file, label, (_STATION,), lambda name: True)
    at = table.place(_STATION)
    if at is None:
        raise DataRejectedError(f"{label} has no column {_STATION}, the stations along the bridge in metres.")
    columns = table.read(range(len(table.names)))
    for place, values in columns.items():
        if not np.isfinite(values).all():
            row = table.layout.first_row + int(np.flatnonzero(~np.isfinite(values))[0])
            raise DataRejectedError(f"{label}, row {row}: {shorten(table.names[place])} is missing; fill it in.")
    station = columns[at]
    backward = np.flatnonzero(np.diff(station) < 0.0)
    if station[0] < 0.0:
        raise DataRejectedError(f"{label}: stations begin at {station[0]:g} m; count them from the first support on.")
    if station.size < 3 or backward.size or station[0] == station[-1]:
        where = f" (row {backward[0] + 2} of the data)" if backward.size else ""
        raise DataRejectedError(f"{label}: stations must increase along the bridge{where}, three or more.")
    return label, station, {table.names[place]: values for place, values in columns.items() if place != at}


def _lines(file: InputFile) -> tuple[GivenLine, ...]:
    label, station, columns = _columns(file)
    if not columns:
        raise DataRejectedError(f"{label} has no influence lines beside {_STATION}; give one column for each.")
    found = []
    for name, values in columns.items():
        match = _LINE_NAME.fullmatch(name.strip())
        kind = name.strip().lower().split("_")[0]
        if kind in _LINE_UNIT and (match is None or match[3] != _LINE_UNIT[kind]):
            raise DataRejectedError(
                f"{label}: the column '{shorten(name)}' is an influence line of a {kind}; end its name in the unit of "
                f"the effect of 1 N: {kind}_NAME_{_LINE_UNIT[kind]}."
            )
        if match is None:
            found.append(GivenLine(name.strip(), "other", station, values))
        else:
            found.append(GivenLine(f"{kind} {match[2]}", _LINE_KIND[kind], station, values))
    return tuple(found)


def _modes(file: InputFile, frequency_hz: np.ndarray, modal_mass_kg: np.ndarray) -> GivenModes:
    label, station, columns = _columns(file)
    if len(columns) != frequency_hz.size:
        raise DataRejectedError(
            f"{label} has {len(columns)} columns of shapes beside {_STATION}, and there are {frequency_hz.size} "
            "frequencies; give one column for each, in their order."
        )
    if np.any(np.diff(station) == 0.0):
        raise DataRejectedError(f"{label}: a station stands twice; shapes of modes do not jump.")
    return GivenModes(station, np.stack(list(columns.values()), axis=1), frequency_hz, modal_mass_kg)
