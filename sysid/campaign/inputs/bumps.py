"""Bumps of a campaign: point clouds, and heights that were measured along the road."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from sysid import limits
from sysid.campaign.inputs import paths
from sysid.campaign.inputs.named_files import NamedFiles
from sysid.campaign.records import BumpShape, Scan
from sysid.campaign.roads import RoadCourse
from sysid.campaign.units import angle_rad
from sysid.logs.input_file import InputFile

if TYPE_CHECKING:
    from sysid.campaign.toml.schema import ScanTable

PointCloudReader = Callable[[InputFile, str], np.ndarray]
ProfileReader = Callable[[InputFile, float, str], BumpShape]
RoadReader = Callable[[InputFile, float, str, float | None], RoadCourse]


def read_bumps(
    tables: Mapping[str, ScanTable],
    files: NamedFiles,
    point_cloud_reader: PointCloudReader | None,
    profile_reader: ProfileReader | None,
    tires_m: tuple[float, ...] = (),
) -> dict[str, Scan]:
    """Scan of every bump by its name; without readers none has points or heights.

    Parameters
    ----------
    tires_m : distances of the tires of one side of the truck from its middle.

    Raises
    ------
    CampaignError
        If a file is missing, too large or outside the campaign's folder.
    DataRejectedError
        If a reader cannot read a cloud or a profile.
    """
    result = {}
    for name, table in tables.items():
        key = "scan" if len(tables) == 1 and name == "bump" else f"scan.{name}"
        result[name] = (
            _levelled(name, key, table.profile, files, profile_reader)
            if table.profile is not None
            else _cloud(name, key, table, files, point_cloud_reader, tires_m)
        )
    return result


def _cloud(
    name: str,
    key: str,
    table: ScanTable,
    files: NamedFiles,
    reader: PointCloudReader | None,
    tires_m: tuple[float, ...],
) -> Scan:
    assert table.file is not None
    assert table.heading_deg is not None
    content = files.content(table.file, f"{key}.file", limits.SCAN_BYTES)
    points = np.empty((0, 3)) if reader is None else reader(content, table.unit.replace("µ", "u"))
    return Scan(
        name,
        paths.relative_name(table.file),
        angle_rad(table.heading_deg),
        points,
        heading_within_rad=angle_rad(table.heading_within_deg),
        lateral_m=table.lateral_m,
        tires_m=tires_m,
    )


def _levelled(name: str, key: str, file: str, files: NamedFiles, reader: ProfileReader | None) -> Scan:
    content, label = files.content(file, f"{key}.profile", limits.PROFILE_BYTES), paths.relative_name(file)
    return Scan(name, label, 0.0, np.empty((0, 3)), None if reader is None else reader(content, 0.0, label))
