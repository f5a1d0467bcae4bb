"""The road profile found in a laser scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RoadProfile:
    """Smooth profile of one bump along the direction of travel, zero road outside.

    `station_m` (n,) uniformly spaced, starting before the bump at 0; `height_m` (n,) above the fitted road plane, zero
    at both ends; `height_sd_m` (n,) its own standard error.  `start_m` is the first station above 1 mm, the origin of
    every start offset; `length_m` the distance to the last one.
    """

    name: str
    station_m: np.ndarray
    height_m: np.ndarray
    height_sd_m: np.ndarray
    start_m: float
    length_m: float


@dataclass(frozen=True)
class ScanAnalysis:
    """How a point cloud became a profile: plane, outliers, the wheel-track strip and the profile itself.

    `grade` and `camber` are slopes along and across the direction of travel; `strip_station_m`, `strip_height_m` (m,)
    are the points of the wheel track used for the profile (thinned for figures); `cloud_*` a thinned picture of the
    whole scan in road coordinates (along, across, height above the plane).
    """

    profile: RoadProfile
    heading_rad: float
    grade: float
    camber: float
    points: int
    outliers: int
    noise_rms_m: float
    strip_half_width_m: float
    strip_station_m: np.ndarray
    strip_height_m: np.ndarray
    cloud_along_m: np.ndarray
    cloud_across_m: np.ndarray
    cloud_height_m: np.ndarray
    messages: tuple[str, ...] = ()
