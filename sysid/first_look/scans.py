"""What a point cloud shows without its heading, and a profile: size, unit, and the line of the crest."""

from __future__ import annotations

import numpy as np

from sysid.first_look.folder import FolderFile
from sysid.first_look.records import SeenScan
from sysid.road.bump_search import crest_direction, smooth_heights
from sysid.road.point_cloud import read_point_cloud
from sysid.road.profile_files import bump_from_file
from sysid.road.road_frame import level_frame

#: A scan of a bump and the road about it is some metres long: between these [m] nothing is asked.
_USUAL_M = (1.0, 60.0)
_UNITS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2}
_SAMPLE = 12_000
#: Share of the height variance that a ridge explains, and lowest top [m], for its direction to be told.
_RIDGE, _TOP_M = 0.5, 0.02


def seen_scan(file: FolderFile) -> SeenScan:
    """Size, unit and crest of a point cloud.

    Raises
    ------
    DataRejectedError
        If it cannot be read.
    """
    points = read_point_cloud(file.content)
    low, high = np.percentile(points, (1.0, 99.0), axis=0)
    extent = high - low
    longest = float(np.max(extent[:2]))
    unit = next((u for u, f in _UNITS.items() if _USUAL_M[0] <= longest * f <= _USUAL_M[1]), "m")
    sample = points[:: max(1, points.shape[0] // _SAMPLE)] * _UNITS[unit]
    heading = _heading_deg(sample)
    return SeenScan(file.name, file.title, points.shape[0], (float(extent[0]), float(extent[1])), unit, heading)


def seen_profile(file: FolderFile) -> SeenScan:
    """Length and height of a profile that was measured along the road.

    Raises
    ------
    DataRejectedError
        If it cannot be read, or holds no bump.
    """
    shape = bump_from_file(file.content, name=file.name)
    extent = (float(np.ptp(shape.station_m)), float(np.max(shape.heights_m)))
    return SeenScan(file.name, file.title, len(shape.station_m), extent, "m", None, levelled=True)


def _heading_deg(points_m: np.ndarray) -> float | None:
    """Direction across the crest [deg] in [0, 180), None where no ridge stands out of the road."""
    if points_m.shape[0] < 500:
        return None
    try:
        frame, _ = level_frame(points_m, 0.0, np.random.default_rng(0))
        along, across, height = frame.road_coordinates(points_m)
        smooth = smooth_heights(along, across, height, neighbours=9)
        if float(np.quantile(smooth, 0.998)) < _TOP_M:
            return None
        crest = crest_direction(along, across, smooth)
    except np.linalg.LinAlgError:
        return None
    return float(np.degrees(crest.angle_rad)) % 180.0 if crest.explained > _RIDGE else None
