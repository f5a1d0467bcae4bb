"""Road coordinates of a scan: along the heading, across it to the left, and above the road plane."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sysid.arrays import Points, PointsByXyz, Stations
from sysid.road.plane import RoadPlane, local_noise_m, refine_plane, search_plane

_PLANE_POINTS = 200_000  # that a plane is fitted to at most


@dataclass(frozen=True)
class RoadFrame:
    """A right-handed frame in the road plane: `heading_rad` counter-clockwise from +x of the scanner.

    `origin_m` (3,) is subtracted from the scanner's coordinates first; `plane` lives in what is left.
    """

    origin_m: np.ndarray
    heading_rad: float
    plane: RoadPlane

    @property
    def grade(self) -> float:
        """Slope of the road along the heading, positive uphill."""
        return float(self.plane.slope_x * np.cos(self.heading_rad) + self.plane.slope_y * np.sin(self.heading_rad))

    @property
    def camber(self) -> float:
        """Slope of the road across the heading, positive where it rises to the left."""
        return float(-self.plane.slope_x * np.sin(self.heading_rad) + self.plane.slope_y * np.cos(self.heading_rad))

    def road_coordinates(self, points_m: PointsByXyz) -> tuple[Points, Points, Points]:
        """Return along, across (left positive) and height above the plane (n,) [m] of points (n, 3) [m]."""
        normal = np.array([-self.plane.slope_x, -self.plane.slope_y, 1.0])
        normal /= np.linalg.norm(normal)
        forward = np.array([np.cos(self.heading_rad), np.sin(self.heading_rad), self.grade])
        forward /= np.linalg.norm(forward)
        axes = np.column_stack([forward, np.cross(normal, forward), normal])
        along, across, height = ((points_m - self.origin_m - [0.0, 0.0, self.plane.level_m]) @ axes).T
        return along, across, height

    def turned(self, angle_rad: float) -> RoadFrame:
        """Return the same frame with its heading turned counter-clockwise by `angle_rad`."""
        return replace(self, heading_rad=self.heading_rad + angle_rad)

    def relevelled(self, points_m: PointsByXyz, flat: Points, noise_m: float) -> RoadFrame:
        """Return the frame with its plane fitted to the points (n, 3) that `flat` (n,) bool marks as road."""
        index = np.flatnonzero(flat)
        if index.size > _PLANE_POINTS:
            index = index[:: index.size // _PLANE_POINTS + 1]
        return replace(self, plane=refine_plane(points_m[index] - self.origin_m, noise_m, self.plane))

    def height_sd_m(self, along_m: Stations, across_m: float) -> Stations:
        """Return the standard error [m] of the plane under stations (n,) [m] at one distance across [m]."""
        cosine, sine = np.cos(self.heading_rad), np.sin(self.heading_rad)
        return self.plane.height_sd_m(along_m * cosine - across_m * sine, along_m * sine + across_m * cosine)


def level_frame(points_m: PointsByXyz, heading_rad: float, rng: np.random.Generator) -> tuple[RoadFrame, float]:
    """Return a first frame and the local noise [m] of a cloud (n, 3) [m] whose bump is not known yet."""
    origin = np.median(points_m, axis=0)
    local = points_m - origin
    noise = local_noise_m(local)
    plane = search_plane(local[rng.permutation(local.shape[0])[:4000]], noise, rng)
    near = np.abs(local[:, 2] - plane.height_m(local[:, 0], local[:, 1])) < max(3 * noise, 0.005)
    if np.count_nonzero(near) >= 10:
        plane = refine_plane(local[near], noise, plane)
    return RoadFrame(origin_m=origin, heading_rad=heading_rad, plane=plane), noise
