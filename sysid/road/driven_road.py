"""Heights of a road to be driven: of a class, measured, several one behind the other, with a bump or a hole on it."""

from __future__ import annotations

import numpy as np

from sysid.arrays import Stations
from sysid.campaign.roads import RoadCourse
from sysid.road.named_shapes import named_shape
from sysid.road.roughness import TRACK_M, class_road

#: Distance of the stations [m] of a road with a bump or a hole on it.
_EDGED_STEP_M = 0.005


def course_heights(course: RoadCourse, realisation: int, track_m: float = TRACK_M) -> tuple[Stations, np.ndarray]:
    """Stations (n,) from 0 and heights (tracks, n) of one realisation of a road [m].

    Parts follow each other without a step: each begins at the height at which the one before ends.  A bump lies on both
    tracks, on top of the roughness; a hole is cut into it.
    """
    if course.parts:
        station, height = _joined([course_heights(part, realisation, track_m) for part in course.parts])
    elif course.roughness is not None:
        station, height = class_road(course.roughness, course.length_m, course.seed + realisation, track_m=track_m)
    else:
        assert course.height_m is not None
        height = np.atleast_2d(course.height_m)
        station = course.step_m * np.arange(height.shape[1])
    if course.obstacle is None:
        return station, height
    bump = named_shape(course.obstacle)
    fine = np.arange(0.0, station[-1] + 1e-9, min(_EDGED_STEP_M, station[1] - station[0]))
    along = fine - course.obstacle_at_m
    # Its profile starts where it is a millimetre high, which may be behind its foot.
    foot = float(bump.station_m[max(int(np.flatnonzero(bump.height_m)[0]) - 1, 0)])
    added = np.interp(along, bump.station_m - foot, bump.height_m, left=0.0, right=0.0)
    rough = np.array([np.interp(fine, station, track) for track in height])
    return fine, rough + (-added if course.sunken else added)


def _joined(parts: list[tuple[Stations, np.ndarray]]) -> tuple[Stations, np.ndarray]:
    """Parts one behind the other on the stations of the finest, each track going on where it ended."""
    step = min(float(station[1] - station[0]) for station, _ in parts)
    tracks = max(len(height) for _, height in parts)
    ends = np.cumsum([0.0, *(float(station[-1]) for station, _ in parts)])
    grid = np.arange(0.0, ends[-1] + 1e-9, step)
    height = np.zeros((tracks, grid.size))
    level = np.zeros(tracks)
    for (station, part), begin, end in zip(parts, ends[:-1], ends[1:], strict=True):
        both = np.broadcast_to(part, (tracks, part.shape[1]))
        inside = (grid >= begin) & (grid <= end)
        for k in range(tracks):
            height[k, inside] = level[k] + np.interp(grid[inside] - begin, station, both[k]) - both[k, 0]
        level = level + both[:, -1] - both[:, 0]
    return grid, height
