"""The road under the wheels of either side of a truck, from the tracks of a scan on which its tires roll."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.arrays import Points, Stations
from sysid.road.road_profile import SideProfiles
from sysid.road.strip_profile import StripFit, StripProfile, fit_strip, settle_ends
from sysid.road.wheel_track import Strip, track_range, travel_station

#: Half the width of one tire on the road, and how far a scan may end inside the outer edge of the tires.
_TIRE_HALF_WIDTH_M = 0.15
_MISSED_M = 0.1
#: No longer piece of the bump without points.
_GAP_M = 0.05
#: Below it a variance is none: (1 um)^2.
_LEAST_VARIANCE_M2 = 1e-12


@dataclass(frozen=True)
class WheelTracks:
    """Mean over the tires and the two sides of it, on stations along the travel (n,) [m].

    `height_m` and `variance_m2` of the mean; stations begin at `first_m` and count from where the middle of the truck,
    `middle_m` across the strip, meets its origin.
    """

    first_m: float
    middle_m: float
    height_m: np.ndarray
    variance_m2: np.ndarray
    sides: SideProfiles


def profile_of_tracks(
    strip: Strip,
    flat: Points,
    whole: StripFit,
    mean: StripProfile,
    *,
    tires_m: tuple[float, ...],
    middle_m: float,
    skew_rad: float,
    step_m: float,
    knot_spacing_m: float,
    least_points: int,
) -> WheelTracks | None:
    """The profile under the tires of a truck; None where the scan does not show it.

    Each side has a spline of its own, along the normal of the crest line, of the points under its tires. As far as
    bands of the bump differ no more than those of the flat road, these differences are texture and errors of the
    scanner: with the variances L^2 of the former beyond T^2 of the latter, a side counts by w = L^2 / (L^2 + T^2) and
    the whole width by the rest, P = w P_side + (1 - w) P_all. A tire at y to the left of the middle rolls over
    h(s) = P((s + y tan(skew)) cos(skew)).

    Parameters
    ----------
    strip : all points of the scan about the bump, square to the crest line; flat : (n,) which of them lie on flat road.
    whole, mean : of the whole width.
    tires_m : distances of the tires of one side from the middle of the truck [m].
    middle_m : where the middle of the truck passes, to the left of the middle of the scan [m].
    skew_rad : angle from the direction of travel to the normal of the crest line.
    step_m, knot_spacing_m : of stations, and of the knots of the splines [m]; least_points : per side.
    """
    low, high = track_range(strip, mean, skew_rad)
    middle = (low + high) / 2 + middle_m
    outer = max(tires_m) + _TIRE_HALF_WIDTH_M - _MISSED_M
    if middle - outer < low or middle + outer > high:
        return None
    own = whole.lateral_sd_m**2 / max(whole.lateral_sd_m**2 + whole.texture_sd_m**2, _LEAST_VARIANCE_M2)
    across = travel_station(strip.along_m, strip.across_m, skew_rad, 0.0)[1] - middle
    splines = []
    for side in (1.0, -1.0):
        under = np.min(np.abs(across[:, None] - side * np.unique(tires_m)), axis=1) <= _TIRE_HALF_WIDTH_M
        if np.count_nonzero(under) < least_points:
            return None
        fit = fit_strip(
            strip.along_m[under],
            strip.across_m[under],
            strip.height_m[under],
            flat[under],
            start_m=whole.start_m,
            end_m=whole.end_m,
            noise_m=whole.noise_m,
            knot_spacing_m=knot_spacing_m,
        )
        spline = settle_ends(fit, step_m=step_m, knot_spacing_m=knot_spacing_m)
        if spline.largest_gap_m > max(_GAP_M, mean.largest_gap_m):
            return None
        splines.append(_between(mean, spline, own, step_m))
    return _along_travel((splines[0], splines[1]), own, middle, np.array(tires_m), skew_rad, step_m)


def _between(whole: StripProfile, side: StripProfile, own: float, step_m: float) -> StripProfile:
    """The profile of a side that counts by the share `own` beside that of the whole width."""
    parts = [(spline, share) for spline, share in ((whole, 1.0 - own), (side, own)) if share > 0.0]
    start, end = min(s.start_m for s, _ in parts), max(s.end_m for s, _ in parts)
    station = start + step_m * np.arange(int(np.ceil((end - start) / step_m - 1e-9)) + 1)
    height, variance = np.zeros_like(station), np.zeros_like(station)
    for spline, share in parts:
        height += share * np.interp(station, spline.station_m, spline.height_m, left=0.0, right=0.0)
        variance += share * np.interp(station, spline.station_m, spline.variance_m2, left=0.0, right=0.0)
    return StripProfile(station, height, variance, start, end, max(s.largest_gap_m for s, _ in parts))


def _along_travel(
    splines: tuple[StripProfile, StripProfile],
    own: float,
    middle_m: float,
    tires_m: np.ndarray,
    skew_rad: float,
    step_m: float,
) -> WheelTracks:
    cosine, tangent = np.cos(skew_rad), np.tan(skew_rad)
    reach, at = float(tires_m.max() * abs(tangent)), float(tires_m.mean())
    first = min(s.start_m for s in splines) / cosine - reach
    last = max(s.end_m for s in splines) / cosine + reach
    station = first + step_m * np.arange(int(np.ceil((last - first) / step_m - 1e-9)) + 1)

    def rolled(spline: StripProfile, values: Stations, places_m: np.ndarray) -> Stations:
        query = (station[:, None] + places_m * tangent) * cosine
        return np.asarray(np.interp(query, spline.station_m, values, left=0.0, right=0.0).mean(axis=1))

    under, centred, sd = [], [], []
    for side, spline in zip((1.0, -1.0), splines, strict=True):
        under.append(rolled(spline, spline.height_m, side * tires_m))
        centred.append(rolled(spline, spline.height_m, np.array([side * at])))
        # Averaging standard errors, not variances, is the safe side: tires of one side share their errors.
        sd.append(rolled(spline, np.sqrt(spline.variance_m2), side * tires_m))
    height = 0.5 * (under[0] + under[1])
    height[0] = height[-1] = 0.0
    # Both sides share the errors of the whole width alone.
    variance = (0.5 - 0.25 * own) * (sd[0] ** 2 + sd[1] ** 2)
    sides = SideProfiles(centred[0], centred[1], at, skew_rad)
    return WheelTracks(first, middle_m, height, variance, sides)
