"""Where wheels come over a bump or a road: the paths about which the springs of their tires are followed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from sysid.arrays import Stations

T = TypeVar("T")

#: How often the springs are followed about the paths of the time before, at most, and the root mean square move of a
#: path [m] at which it has settled.
_ROUNDS, _SETTLED_M = 8, 2e-4


@dataclass(frozen=True)
class WheelPaths:
    """Stations (T, na) of the wheels' centres of one vehicle or several (T, na, t), and how far they rise there [m]."""

    station_m: np.ndarray
    rise_m: np.ndarray

    def on(self, axle: int, station_m: Stations) -> tuple[Stations, Stations]:
        """Median and standard deviation over the vehicles of an axle's rise at stations (n,) [m], 0 beyond the ends."""
        each = [
            np.interp(station_m, np.maximum.accumulate(s), z, left=0.0, right=0.0)
            for s, z in zip(self.station_m[:, axle].T, self.rise_m[:, axle].T, strict=True)
        ]
        return np.median(each, axis=0), np.std(each, axis=0)

    def moved_m(self, other: WheelPaths) -> float:
        """Root mean square move [m] from other paths over the same instants, medians over the vehicles; worst axle."""
        moved = np.median(self.rise_m, axis=-1) - np.median(other.rise_m, axis=-1)
        return float(np.sqrt(np.mean(moved**2, axis=0)).max())


def followed(road: T, drive: Callable[[T], WheelPaths], about: Callable[[WheelPaths], T]) -> tuple[T, WheelPaths]:
    """A road about the paths of the wheels on it, and these: followed again until they stay where they are.

    Parameters
    ----------
    road : what the wheels feel by the first guess.
    drive : paths on such a road.
    about : the road as it is felt about paths.
    """
    paths = drive(road)
    for _ in range(_ROUNDS):
        road = about(paths)
        before, paths = paths, drive(road)
        if paths.moved_m(before) < _SETTLED_M:
            break
    return road, paths
