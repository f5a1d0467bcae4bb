"""Tires on a road profile: the deflection on flat ground that carries the same force, as a table.

Ordinary tires are radial springs (Badalamenti and Doyle 1988): spokes of stiffness that follow a power of their
compression.  A table holds, over the station s of the wheel centre and its depth u below the height at which the free
tire touches flat ground, the deflection D(s, u) and the ratio of forward to vertical force.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Profile = Callable[[Array], Array]

STATION_STEP_M = 0.005
DEPTH_STEP_M = 0.0025
_DEPTHS_M = np.arange(-0.13, 0.16, DEPTH_STEP_M)
_REACH_M = 0.45  # no contact is further ahead of the wheel centre


@dataclass(frozen=True)
class Contact:
    """Tables of one kind of tire over several profiles: values (profile, station, depth, 2) in m and -."""

    first_station_m: float
    values: Array

    def __call__(
        self, profile: NDArray[np.int64], station_m: Array, depth_m: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Deflection D [m], dD/ds, dD/du and forward over vertical force, all of the shape of `station_m`."""
        _, stations, depths, _ = self.values.shape
        s = np.clip((station_m - self.first_station_m) / STATION_STEP_M, 0.0, stations - 1.001)
        u = np.maximum((depth_m - _DEPTHS_M[0]) / DEPTH_STEP_M, 0.0)
        i, j = s.astype(np.int64), np.minimum(u, depths - 1.001).astype(np.int64)
        s -= i
        u -= j
        at = (profile * stations + i) * depths + j
        flat = self.values.reshape(-1, 2)
        v00, v01, v10, v11 = (flat.take(at + k, axis=0) for k in (0, 1, depths, depths + 1))
        su, ss = u[..., None], s[..., None]
        near, far = v00 + su * (v01 - v00), v10 + su * (v11 - v10)
        value = near + ss * (far - near)
        by_depth = (1.0 - s) * (v01 - v00)[..., 0] + s * (v11 - v10)[..., 0]
        by_station = (far - near)[..., 0]
        return value[..., 0], by_station / STATION_STEP_M, by_depth / DEPTH_STEP_M, value[..., 1]


def spokes(profiles: list[Profile], length_m: float, radius_m: float, exponent: float) -> Contact:
    """Tables of radial springs whose force on flat ground grows about with the power `exponent` of the deflection.

    A spoke compressed by d pushes with d^(exponent - 1/2): the contact grows with the square root of the deflection.
    """
    stations = np.arange(-radius_m, length_m + radius_m, STATION_STEP_M)
    ahead = np.arange(-_REACH_M, _REACH_M + 1e-9, STATION_STEP_M)
    flat = _sums(np.zeros_like(ahead)[None], ahead, radius_m, exponent)[0][0]
    up = flat > 0.0
    force, deflection = np.r_[0.0, flat[up]], np.r_[0.0, _DEPTHS_M[up]]
    values = np.empty((len(profiles), stations.size, _DEPTHS_M.size, 2))
    for n, profile in enumerate(profiles):
        for part in np.array_split(np.arange(stations.size), 8):
            vertical, forward = _sums(profile(stations[part, None] + ahead), ahead, radius_m, exponent)
            top = np.log(np.maximum(vertical, 1e-12))
            # Nearly a power law: interpolated in logarithms, and continued by its last slope.
            known = np.log(force[1:]), np.log(deflection[1:])
            last = (known[1][-1] - known[1][-2]) / (known[0][-1] - known[0][-2])
            log = np.interp(top, *known) + last * np.maximum(top - known[0][-1], 0.0)
            log += last * np.minimum(top - known[0][0], 0.0)
            values[n, part, :, 0] = np.where(vertical > 0.0, np.exp(log), 0.0)
            values[n, part, :, 1] = np.where(vertical > 0.0, forward / np.maximum(vertical, 1e-12), 0.0)
    return Contact(float(stations[0]), values)


def _sums(heights_m: Array, ahead_m: Array, radius_m: float, exponent: float) -> tuple[Array, Array]:
    """Vertical and forward sums over spokes (station, depth) of rows of road heights ahead of the wheel centre."""
    vertical, forward = (np.empty((heights_m.shape[0], _DEPTHS_M.size)) for _ in range(2))
    for n, depth in enumerate(_DEPTHS_M):
        below = radius_m - depth - heights_m
        angle = np.arctan2(ahead_m, below)
        pressed = np.maximum(radius_m - np.hypot(ahead_m, below), 0.0) ** (exponent - 0.5)
        pressed[np.hypot(ahead_m, below) >= radius_m] = 0.0
        pressed[below <= 0.0] = 0.0
        width = np.maximum(np.diff(angle, axis=1), 0.0)  # what lies behind an edge is not seen
        vertical[:, n] = np.sum(0.5 * width * _pairs(pressed * np.cos(angle)), axis=1)
        forward[:, n] = -np.sum(0.5 * width * _pairs(pressed * np.sin(angle)), axis=1)
    return vertical, forward


def _pairs(values: Array) -> Array:
    return np.asarray(values[:, 1:] + values[:, :-1])


def cams(profiles: list[Profile], length_m: float, radius_m: float, spacing_m: float) -> Contact:
    """Tables of two elliptical cams, one behind the other (Schmeitz 2004): half axes of the free radius, order 1.8."""
    stations = np.arange(-radius_m, length_m + radius_m, STATION_STEP_M)
    ahead = np.arange(-radius_m, radius_m + 1e-9, STATION_STEP_M)
    cam = radius_m * (1.0 - np.abs(ahead / radius_m) ** 1.8) ** (1.0 / 1.8) - radius_m
    values = np.empty((len(profiles), stations.size, _DEPTHS_M.size, 2))
    for n, profile in enumerate(profiles):
        front, rear = (
            np.max(profile(stations[:, None] + side * spacing_m / 2.0 + ahead) + cam, axis=1) for side in (1.0, -1.0)
        )
        values[n, :, :, 0] = np.maximum(0.5 * (front + rear)[:, None] + _DEPTHS_M, 0.0)
        values[n, :, :, 1] = -((front - rear) / spacing_m)[:, None]
    return Contact(float(stations[0]), values)
