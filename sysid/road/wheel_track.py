"""Which points the wheels roll on: the strip across the road, and the mean over tracks that meet a skew bump."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.arrays import Points, Stations
from sysid.road.bump_search import Stretch, covered_bands, split_into_bands
from sysid.road.strip_profile import StripProfile

#: Half the width of a pair of twin tires.
_TRACK_HALF_WIDTH_M = 0.3


@dataclass(frozen=True)
class Strip:
    """Points of the wheel-track strip in road coordinates (n,) [m]; `narrowed` where bare bands were cut off."""

    along_m: np.ndarray
    across_m: np.ndarray
    height_m: np.ndarray
    half_width_m: float
    narrowed: bool = False

    @property
    def centre_m(self) -> float:
        """Middle of the strip across the road [m]."""
        return (float(self.across_m.min()) + float(self.across_m.max())) / 2


def select_strip(
    along_m: Points,
    across_m: Points,
    height_m: Points,
    *,
    centre_m: float,
    half_width_m: float | None,
    track_width_m: float | None,
) -> Strip:
    """Return the points (n,) of the strip; see :class:`sysid.road.scan.ScanOptions` for the three settings [m]."""
    # A stray point far to the side must not stretch the strip.
    low, high = (float(value) for value in np.quantile(across_m, [0.002, 0.998]))
    offset = across_m - (low + high) / 2 - centre_m
    if track_width_m is not None:
        half = _TRACK_HALF_WIDTH_M if half_width_m is None else half_width_m
        keep = np.abs(np.abs(offset) - track_width_m / 2) <= half
    elif half_width_m is not None:
        half = half_width_m
        keep = np.abs(offset) <= half
    else:
        half = (high - low) / 2
        keep = (across_m >= low) & (across_m <= high)
    return Strip(along_m[keep], across_m[keep], height_m[keep], half)


def without_bare_bands(strip: Strip, bumps: tuple[Stretch, ...]) -> Strip:
    """Cut the strip to the widest run of bands that carry the bump: a scan is often wider than the bump."""
    band, count = split_into_bands(strip.across_m)
    inside = (strip.along_m > bumps[0].start_m) & (strip.along_m < bumps[-1].end_m)
    along, height = strip.along_m[inside], strip.height_m[inside]
    if along.size == 0:
        return strip
    label = np.floor((along - along.min()) / 0.05).astype(np.int64)
    order = np.argsort(label, kind="stable")
    bins, first = np.unique(label[order], return_index=True)
    profile = np.full(label.max() + 1, 1e-4)
    # The upper quartile over the width is the bump's own height even where up to half of the bands are bare.
    for k, group in zip(bins, np.split(height[order], first[1:]), strict=True):
        profile[k] = max(float(np.quantile(group, 0.75)), 1e-4)
    covered = covered_bands(band[inside], count, height, profile[label])
    if covered.all():
        return strip
    runs = np.split(np.arange(count), np.flatnonzero(np.diff(covered.astype(int))) + 1)
    widest = max((run for run in runs if covered[run[0]]), key=len, default=np.arange(count))
    keep = (band >= widest[0]) & (band <= widest[-1])
    half = strip.half_width_m * len(widest) / count
    return Strip(strip.along_m[keep], strip.across_m[keep], strip.height_m[keep], half, narrowed=True)


def travel_station(along_m: Points, across_m: Points, skew_rad: float, centre_m: float) -> tuple[Points, Points]:
    """Return stations along the travel and distances across it [m] of points given square to a skew crest line.

    A turn by the skew; stations count from where the track at `centre_m` across the travel meets along = 0.
    """
    cosine, sine = np.cos(skew_rad), np.sin(skew_rad)
    station = along_m * cosine - across_m * sine + centre_m * np.tan(skew_rad)
    return station, across_m * cosine + along_m * sine


def track_range(strip: Strip, profile: StripProfile, skew_rad: float) -> tuple[float, float]:
    """Return how far to the right and to the left of the travel [m] the strip reaches on the bump."""
    # Only on the bump: the corners of a scan that is skew to the bump reach further to the sides.
    near = (strip.along_m > profile.start_m) & (strip.along_m < profile.end_m)
    across = travel_station(strip.along_m[near], strip.across_m[near], skew_rad, 0.0)[1]
    low, high = np.quantile(across, [0.005, 0.995])
    return float(low), float(high)


def mean_over_tracks(
    profile: StripProfile, strip: Strip, skew_rad: float, step_m: float
) -> tuple[float, Stations, Stations]:
    """Return first station, mean heights and their variance along the travel over all tracks of the strip.

    If a bump lies at `skew_rad` to the direction of travel, a wheel at lateral position y meets it earlier or later (by
    y tan of the skew) and takes longer to cross it (by 1 / cos). A planar vehicle follows the mean of its tracks.
    `profile` is square to the crest line; stations every `step_m` [m].
    """
    low, high = track_range(strip, profile, skew_rad)
    edges = np.linspace(low, high, 101)
    across = travel_station(strip.along_m, strip.across_m, skew_rad, 0.0)[1]
    used = np.histogram(across, edges)[0] > 0
    shift = ((low + high) / 2 - (edges[:-1] + np.diff(edges) / 2)[used]) * np.tan(skew_rad)
    first = profile.start_m / np.cos(skew_rad) + float(shift.min())
    length = (profile.end_m - profile.start_m) / np.cos(skew_rad) + float(np.ptp(shift))
    travel = first + step_m * np.arange(int(np.ceil(length / step_m)) + 1)
    query = (travel[:, None] - shift) * np.cos(skew_rad)
    height = np.interp(query, profile.station_m, profile.height_m, left=0.0, right=0.0).mean(axis=1)
    # Errors of neighbouring tracks are those of one spline: averaging standard errors, not variances, is the safe side.
    sd = np.interp(query, profile.station_m, np.sqrt(profile.variance_m2), left=0.0, right=0.0).mean(axis=1)
    height[0] = height[-1] = 0.0
    return first, height, sd**2
