"""Where the bump lies in a levelled cloud: crest direction, stretches along the road, bands side by side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from sysid.arrays import Points

# Stations further apart than this belong to different bumps.
MERGE_GAP_M = 0.3
#: Width of a band: about that of a tire.
_BAND_M = 0.25


@dataclass(frozen=True)
class CrestDirection:
    """Angle of the crest line from the perpendicular of travel [rad], counter-clockwise, within +-90 degrees.

    `explained` is the share of the height variance that a ridge in this direction explains (1 = a perfect ridge).
    """

    angle_rad: float
    explained: float


@dataclass(frozen=True)
class Stretch:
    """One stretch of road off its plane: first and last station [m] and its peak [m], negative for a dip."""

    start_m: float
    end_m: float
    peak_m: float


def smooth_heights(along_m: Points, across_m: Points, height_m: Points, *, neighbours: int) -> Points:
    """Return the median height [m] of each point's neighbours (n,): stray points vanish, ridges stay."""
    tree = cKDTree(np.column_stack([along_m, across_m]))
    _, index = tree.query(tree.data, k=min(neighbours, along_m.size))
    return np.asarray(np.median(height_m[index], axis=1))


def crest_direction(along_m: Points, across_m: Points, height_m: Points) -> CrestDirection:
    """Find the direction in which the heights are a ridge: the smallest scatter about the mean profile across it.

    Arguments (n,) [m], heights already free of stray points (:func:`smooth_heights`).
    """

    # Bins wide enough to hold several scan lines, each with a straight line of its own: with narrow bins or level ones
    # a cloud of widely spaced lines looks like a perfect staircase in every direction near theirs.
    total = float(np.sum(height_m**2))

    def scatter(angle: float) -> float:
        station = along_m * np.cos(angle) + across_m * np.sin(angle)
        station = station - station.min()
        width = max(0.1, float(station.max()) * 20 / station.size)
        label = np.floor(station / width).astype(np.int64)
        count = np.bincount(label)
        safe = np.maximum(count, 1)
        centred = station - (np.bincount(label, weights=station) / safe)[label]
        level = np.bincount(label, weights=height_m) ** 2 / safe
        lever = np.bincount(label, weights=centred**2)
        slope = np.bincount(label, weights=centred * height_m) ** 2 / np.where(lever > 1e-12, lever, np.inf)
        # Each bin costs two degrees of freedom; without that, directions with many bins would win.
        return (total - float(np.sum(level + slope))) / max(along_m.size - 2 * int(np.count_nonzero(count)), 1)

    angle, values = 0.0, np.zeros(1)
    for half_range, step in ((90.0, 3.0), (3.0, 0.25), (0.3, 0.03)):
        trials = angle + np.radians(np.arange(-half_range, half_range + step / 2, step))
        values = np.array([scatter(trial) for trial in trials])
        angle = float(trials[int(np.argmin(values))])
    angle = (angle + np.pi / 2) % np.pi - np.pi / 2
    return CrestDirection(angle_rad=angle, explained=1 - float(values.min()) / max(float(np.var(height_m)), 1e-30))


def raised_stretches(
    along_m: Points, height_m: Points, noise_m: float, *, least_height_m: float
) -> tuple[tuple[Stretch, ...], tuple[Stretch, ...]]:
    """Return the bumps along the road and the lesser rises and dips, both in order of station.

    Medians of narrow bins are compared with a threshold of 3 mm or five standard errors; stretches closer than 0.3 m
    are one.  A bump is at least `least_height_m` and a fifth of the highest one.
    """
    width = max(0.02, float(np.ptp(along_m)) * 12 / along_m.size)
    label = np.floor((along_m - along_m.min()) / width).astype(np.int64)
    order = np.argsort(label, kind="stable")
    bins, first, count = np.unique(label[order], return_index=True, return_counts=True)
    values = height_m[order]
    median = np.array([np.median(values[i : i + n]) for i, n in zip(first, count, strict=True)])
    # 1.25 is the loss of the median against the mean; bins with few points need a higher threshold.
    threshold = np.maximum(0.003, 5 * 1.25 * noise_m / np.sqrt(count))
    high = np.flatnonzero((np.abs(median) > threshold) & (count >= 3))
    if high.size == 0:
        return (), ()
    origin = float(along_m.min())
    lower, upper = origin + bins[high] * width, origin + (bins[high] + 1) * width
    breaks = np.flatnonzero(lower[1:] - upper[:-1] > MERGE_GAP_M) + 1
    stretches = [
        Stretch(float(lower[group[0]]), float(upper[group[-1]]), _peak(median[high[group]]))
        for group in np.split(np.arange(high.size), breaks)
    ]
    needed = max(least_height_m, 0.2 * max(stretch.peak_m for stretch in stretches))
    bumps = tuple(stretch for stretch in stretches if stretch.peak_m >= needed)
    return bumps, tuple(stretch for stretch in stretches if stretch.peak_m < needed)


def _peak(median: np.ndarray) -> float:
    return float(median.max() if median.max() > 0 else median.min())


def split_into_bands(across_m: Points) -> tuple[Points, int]:
    """Cut the width into bands along the road: band of each point (n,) and their number, at least four.

    Bands are about `_BAND_M` wide.
    """
    low, span = float(across_m.min()), float(np.ptp(across_m))
    count = int(np.clip(round(span / _BAND_M), 4, 60))
    label = np.floor((across_m - low) / max(span, 1e-12) * count).astype(np.int64)
    return np.clip(label, 0, count - 1), count


def covered_bands(band: Points, count: int, height_m: Points, profile_m: Points) -> np.ndarray:
    """Return which bands (count,) carry the bump: height at least half the profile's, or too few points.

    `height_m` and `profile_m` (n,) are measured heights and the heights of a common profile at the same points.
    """
    on_bump = profile_m > 0.3 * profile_m.max()
    points = np.bincount(band[on_bump], minlength=count)
    total = np.bincount(band[on_bump], weights=height_m[on_bump] / profile_m[on_bump], minlength=count)
    ratio = total / np.maximum(points, 1)
    reference = np.median(np.repeat(ratio, points)) if points.any() else 1.0
    return (points < 10) | (ratio > 0.5 * reference)
