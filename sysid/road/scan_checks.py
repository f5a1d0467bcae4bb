"""Is this a scan of a speed bump?  Sentences for clouds that are too small, in another unit, turned or upside down."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sysid import limits
from sysid.errors import DataRejectedError
from sysid.road.bump_search import crest_direction, smooth_heights
from sysid.road.road_frame import RoadFrame

if TYPE_CHECKING:
    from sysid.campaign.records import Scan

#: Beyond these a bump is no speed bump or the unit of the file is wrong: extent of the cloud, its width, height and
#: slope of the road (assumptions).
EXTENT_M = (0.3, 200.0)
LEAST_WIDTH_M = 0.1
HEIGHT_M = (0.01, 0.3)
_LARGEST_TILT = 0.3
#: Height that is worth a remark: speed bumps have 50 to 120 mm (general knowledge).
UNUSUAL_HEIGHT_M = 0.15
#: Units that a cloud may have been written in.
_UNITS_M = {"mm": 1e-3, "cm": 1e-2, "in": 0.0254, "ft": 0.3048}


def checked_points(scan: Scan, minimum_points: int) -> tuple[np.ndarray, int]:
    """Return the finite, distinct points (n, 3) [m] of a scan and how many repeated ones were dropped.

    Raises DataRejectedError where number, extent or width are not those of a road with a bump.
    """
    points = np.asarray(scan.points_m, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise DataRejectedError(
            f"Scan {scan.file}: the points have shape {points.shape}; columns x, y and z are expected."
        )
    points, repeated = _distinct(_near_points(points))
    if points.shape[0] < minimum_points:
        raise DataRejectedError(
            f"Scan {scan.file} has {points.shape[0]} points; at least {minimum_points} are needed for a profile: "
            "export the cloud with less thinning."
        )
    if not np.isfinite(scan.heading_rad):
        raise DataRejectedError(
            f"Scan {scan.file}: the heading is not a number; give heading_deg in the campaign file."
        )
    # Stray points far away do not count: the extent is that of the middle 98 %.
    low, high = np.quantile(points[:, :2], [0.01, 0.99], axis=0)
    centred = points[:, :2] - np.median(points[:, :2], axis=0)
    inside = np.all((points[:, :2] >= low) & (points[:, :2] <= high), axis=1)
    width = float(np.sqrt(12 * max(np.linalg.eigvalsh(np.cov(centred[inside].T))[0], 0.0))) if inside.sum() > 2 else 0.0
    extent = float(np.max(high - low))
    if not EXTENT_M[0] <= extent <= EXTENT_M[1]:
        raise DataRejectedError(
            f"Scan {scan.file} is {extent:.4g} m long; between {EXTENT_M[0]:g} and {EXTENT_M[1]:g} m are expected: "
            f"check its unit{unit_hint(extent, 1.0, 40.0)}."
        )
    if width < LEAST_WIDTH_M:
        raise DataRejectedError(
            f"Scan {scan.file} is only {1e3 * width:.0f} mm wide: points on one line show no road plane; scan "
            f"a strip of {LEAST_WIDTH_M:g} m or more, or average several lines."
        )
    return points, repeated


def _near_points(points: np.ndarray) -> np.ndarray:
    """Points with three numbers that do not lie far outside the scan: strays would cost memory for the way to them."""
    points = points[(np.abs(points) <= limits.COORDINATE_M).all(axis=1)]
    if points.shape[0] == 0:
        return points
    near = (np.abs(points - np.median(points, axis=0)) <= 2.0 * EXTENT_M[1]).all(axis=1)
    # Most of them far apart is no scan with strays but another unit, which is said below.
    return points[near] if np.count_nonzero(near) > 0.9 * near.size else points


def _distinct(points: np.ndarray) -> tuple[np.ndarray, int]:
    # Merged exports repeat points, which would pass for independent measurements.  One number per point that only
    # equal points share makes the search one sort.
    order = np.argsort(points @ np.array([1.0, np.sqrt(2.0), np.sqrt(3.0)]), kind="stable")
    repeated = np.flatnonzero((points[order[1:]] == points[order[:-1]]).all(axis=1)) + 1
    if repeated.size == 0:
        return points, 0
    keep = np.ones(points.shape[0], dtype=bool)
    keep[order[repeated]] = False
    return points[keep], int(repeated.size)


def crest_angle(sample: np.ndarray, frame: RoadFrame, noise_m: float, scan: Scan, rejected_rad: float) -> float:
    """Return the angle [rad] by which the heading must turn to be square to the crest line.

    `sample` (n, 3) [m] is a part of the cloud, `frame` its first levelling, `noise_m` its local noise.  Raises
    DataRejectedError where there is no bump, no ridge, or one off the perpendicular by more than `rejected_rad`.
    """
    if np.hypot(frame.grade, frame.camber) > _LARGEST_TILT:
        raise DataRejectedError(
            f"Scan {scan.file}: the road plane is tilted by {100 * np.hypot(frame.grade, frame.camber):.0f} %; "
            "z must point up: check the order of the columns."
        )
    along, across, height = frame.road_coordinates(sample)
    smooth = smooth_heights(along, across, height, neighbours=9 if along.size > 2000 else 5)
    bottom, top = (float(value) for value in np.quantile(smooth, [0.002, 0.998]))
    if -bottom > max(top, HEIGHT_M[0]):
        raise DataRejectedError(
            f"Scan {scan.file} shows a dip of {-1e3 * bottom:.0f} mm and no bump; z must point up: check its sign."
        )
    if top < max(HEIGHT_M[0], 3 * noise_m):
        raise DataRejectedError(
            f"Scan {scan.file} shows no bump: the road is flat within {1e3 * top:.1f} mm (noise "
            f"{1e3 * noise_m:.1f} mm), at least {1e3 * HEIGHT_M[0]:.0f} mm are expected; check that this is "
            "the scan of the bump and its unit."
        )
    if top > HEIGHT_M[1]:
        raise DataRejectedError(
            f"Scan {scan.file} shows a bump of {top:.3g} m, more than {HEIGHT_M[1]:g} m; crop the cloud to the road "
            f"around the bump or check its unit{unit_hint(top, *HEIGHT_M)}."
        )
    crest = crest_direction(along, across, np.where(smooth > 0.25 * top, smooth, 0.0))
    if crest.explained < 0.5:
        raise DataRejectedError(
            f"Scan {scan.file}: what rises from the road is no ridge across the lane; crop the cloud to the bump."
        )
    if abs(crest.angle_rad) > rejected_rad:
        square = np.degrees(frame.heading_rad + crest.angle_rad) % 360
        raise DataRejectedError(
            f"Scan {scan.file}: the crest line of the bump is {abs(np.degrees(crest.angle_rad)):.0f} degrees off the "
            f"perpendicular to heading_deg = {np.degrees(scan.heading_rad) % 360:.1f}; expected is the direction of "
            f"travel, {square:.0f} or {(square + 180) % 360:.0f} for a bump square to the lane."
        )
    return crest.angle_rad


def unit_hint(length_m: float, least_m: float, most_m: float) -> str:
    """Return which unit read as metres would explain a length, as the end of a sentence."""
    guesses = [unit for unit, factor in _UNITS_M.items() if least_m <= length_m * factor <= most_m]
    return f" (the file looks like {' or '.join(guesses)})" if guesses else " in the campaign file"
