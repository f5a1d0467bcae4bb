"""From a point cloud to the smooth profile of the bump along the direction of travel."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from sysid import limits
from sysid.errors import CampaignError, DataRejectedError
from sysid.road.bump_search import Stretch, raised_stretches
from sysid.road.levelled_profile import levelled_profile
from sysid.road.road_frame import RoadFrame, level_frame
from sysid.road.road_profile import RoadProfile, ScanAnalysis
from sysid.road.scan_checks import HEIGHT_M, UNUSUAL_HEIGHT_M, checked_points, crest_angle, unit_hint
from sysid.road.shapes import make_profile
from sysid.road.side_profiles import WheelTracks, profile_of_tracks
from sysid.road.strip_profile import StripFit, StripProfile, fit_strip, settle_ends
from sysid.road.wheel_track import (
    Strip,
    mean_over_tracks,
    select_strip,
    track_range,
    travel_station,
    without_bare_bands,
)

if TYPE_CHECKING:
    from sysid.campaign.records import Scan

_SAMPLE_POINTS = 60_000  # on which heading, plane and profile settle
_CREST_POINTS = 12_000  # for the first guess of the heading
_LEAST_ROAD_M = 0.1  # of flat road that must be left before and behind the bumps
_LARGEST_TURN_RAD = 0.02  # of the heading in one round
_SETTLED_TURN_RAD = 2e-4  # moves the edge of a 4 m wide bump by less than 1 mm


@dataclass(frozen=True)
class ScanOptions:
    """Settings of :func:`analyse_scan`.

    Without `strip_half_width_m` the profile is the mean over the whole scanned width, every band along the road
    counting alike; with it, over a strip about `strip_centre_m` (to the left of the scan's middle line).  With
    `track_width_m` it is the mean of two such strips (half width 0.3 m if None), half a track width to either side of
    that centre.
    A scan that knows the tires of the truck is taken along their tracks, unless a strip is requested.  A crest line
    that is off by less than the scan's `heading_within_rad` turns the heading, one that is off by more is a skew bump
    and reported, one beyond `heading_rejected_rad` is rejected.
    `strip_points` and `cloud_points` are kept for figures.
    """

    station_step_m: float = 0.002
    flat_m: float = 0.3
    strip_centre_m: float = 0.0
    strip_half_width_m: float | None = None
    track_width_m: float | None = None
    knot_spacing_m: float = 0.005
    heading_rejected_rad: float = float(np.radians(20.0))
    minimum_points: int = 200
    strip_points: int = 4000
    cloud_points: int = 6000

    @property
    def requested(self) -> bool:
        """Whether the profile is that of a requested strip."""
        return self.strip_half_width_m is not None or self.track_width_m is not None

    def __post_init__(self) -> None:
        for name in ("station_step_m", "flat_m", "knot_spacing_m", "strip_half_width_m", "track_width_m"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise CampaignError(f"Scan option {name} is {value}; a positive length in metres is expected.")
        for name, least in (("minimum_points", 50), ("strip_points", 1), ("cloud_points", 1)):
            if getattr(self, name) < least:
                raise CampaignError(f"Scan option {name} is {getattr(self, name)}; at least {least} is expected.")


@dataclass(frozen=True)
class _Work:
    """Data passed between the steps: the levelled frame, the strip in it, bumps and lesser rises along it."""

    frame: RoadFrame
    strip: Strip
    bumps: tuple[Stretch, ...]
    rises: tuple[Stretch, ...]


def analyse_scan(scan: Scan, *, options: ScanOptions | None = None) -> ScanAnalysis:
    """Find road plane, bump and smooth profile along the direction of travel in a laser point cloud.

    The plane is found by a search that disfavours planes with points below them and refined on the flat road around the
    bump; heights are measured perpendicular to it. The heading is squared to the bump's crest line where the two differ
    by less than the tolerance of the declared heading. The profile is the mean over the tires of the truck, and the
    profile under either side stands beside it; where tires are not known or not scanned it is the mean over the width.
    The profile is the penalised spline of :mod:`sysid.road.penalised_spline`, exactly zero outside the bump. Its
    standard error includes the noise of the points, the error of the plane, the waviness of the flat road, the
    uncertain ends of the bump and differences between bands. `scan.points_m` (n, 3) [m]; the result is in metres and
    radians. Raises DataRejectedError (one sentence) where the cloud holds no usable bump. Heights along the road in
    place of a cloud become a profile by :func:`sysid.road.levelled_profile.levelled_profile`.
    """
    if scan.levelled is not None:
        return levelled_profile(scan)
    try:
        analysis = _analysis(scan, options or ScanOptions())
    except np.linalg.LinAlgError:
        raise _undetermined(scan) from None
    profile = analysis.profile
    if not (np.isfinite(profile.height_m).all() and np.isfinite(profile.height_sd_m).all()):
        raise _undetermined(scan)
    return analysis


def _undetermined(scan: Scan) -> DataRejectedError:
    return DataRejectedError(
        f"Scan {scan.file}: its points do not determine a road plane and a profile (they lie on few lines or repeat "
        "each other); scan an area of at least 0.5 m across the lane."
    )


def _analysis(scan: Scan, options: ScanOptions) -> ScanAnalysis:
    points, repeated = checked_points(scan, options.minimum_points)
    rng = np.random.default_rng(0)
    sample = points[rng.permutation(points.shape[0])[:_SAMPLE_POINTS]]
    frame, noise = level_frame(sample, scan.heading_rad, rng)
    frame = frame.turned(crest_angle(sample[:_CREST_POINTS], frame, noise, scan, options.heading_rejected_rad))
    # Heading, plane and profile depend on each other: settle them on the sample, then take every point once.
    for _ in range(5):
        work = _level(sample, frame, noise, scan, options)
        fit = _fit(work, noise, options)
        frame = work.frame
        if abs(fit.crest_turn_rad) < _SETTLED_TURN_RAD:
            break
        frame = frame.turned(float(np.clip(fit.crest_turn_rad, -_LARGEST_TURN_RAD, _LARGEST_TURN_RAD)))
    if points.shape[0] > sample.shape[0]:
        strip = _strip_of(points, work.frame, scan, options)
        work = _Work(work.frame, _trimmed(strip, work.bumps, options), work.bumps, work.rises)
        fit = _fit(work, noise, options)
    mean = settle_ends(fit, step_m=options.station_step_m, knot_spacing_m=options.knot_spacing_m)
    result = _result(scan, options, points, work, fit, mean)
    if repeated:
        note = f"{repeated} points occur more than once in the scan and were counted once."
        result = replace(result, messages=(*result.messages, note))
    return result


def _level(points: np.ndarray, frame: RoadFrame, noise: float, scan: Scan, options: ScanOptions) -> _Work:
    """Level the frame on the road around the bump and cut the strip out of it."""
    for _ in range(2):
        strip = _strip_of(points, frame, scan, options)
        bumps, rises = raised_stretches(strip.along_m, strip.height_m, noise, least_height_m=HEIGHT_M[0])
        if not bumps:
            raise DataRejectedError(
                f"Scan {scan.file} shows no bump of {1e3 * HEIGHT_M[0]:.0f} mm or more in the wheel-track strip; "
                "check strip and heading."
            )
        length = bumps[-1].end_m - bumps[0].start_m
        if length > limits.PROFILE_LENGTH_M:
            raise DataRejectedError(
                f"Scan {scan.file}: the raised part of the road is {length:.0f} m long, at most "
                f"{limits.PROFILE_LENGTH_M:g} m are read; crop the cloud to the road around the bump."
            )
        flat = _flat_road(frame.road_coordinates(points)[0], (*bumps, *rises))
        if np.count_nonzero(flat) < 30:
            raise DataRejectedError(
                f"Scan {scan.file} holds hardly any flat road around the bump; scan at least 0.3 m on either side."
            )
        frame = frame.relevelled(points, flat, noise)
    strip = _strip_of(points, frame, scan, options)
    first, last = (float(value) for value in np.quantile(strip.along_m, [0.0005, 0.9995]))
    start, end = bumps[0].start_m, bumps[-1].end_m
    if start - first < _LEAST_ROAD_M or last - end < _LEAST_ROAD_M:
        raise DataRejectedError(
            f"Scan {scan.file}: the bump reaches from {max(start - first, 0.0):.2f} m to {end - first:.2f} m of "
            f"{last - first:.2f} m scanned and is cut off; scan at least 0.3 m of flat road before and behind it."
        )
    return _Work(frame, _trimmed(strip, bumps, options), bumps, rises)


def _strip_of(points: np.ndarray, frame: RoadFrame, scan: Scan, options: ScanOptions) -> Strip:
    strip = select_strip(
        *frame.road_coordinates(points),
        centre_m=options.strip_centre_m,
        half_width_m=options.strip_half_width_m,
        track_width_m=options.track_width_m,
    )
    if strip.along_m.size < min(options.minimum_points, points.shape[0] // 2):
        raise DataRejectedError(
            f"Scan {scan.file}: {strip.along_m.size} points lie in the wheel-track strip, {options.minimum_points} are "
            "needed; widen the strip or scan more densely."
        )
    return strip


def _trimmed(strip: Strip, bumps: tuple[Stretch, ...], options: ScanOptions) -> Strip:
    # A requested strip is used as it is.
    return strip if options.requested else without_bare_bands(strip, bumps)


def _flat_road(along: np.ndarray, stretches: tuple[Stretch, ...]) -> np.ndarray:
    flat = np.ones(along.size, dtype=bool)
    for stretch in stretches:
        flat &= (along < stretch.start_m - 0.1) | (along > stretch.end_m + 0.1)
    return flat


def _fit(work: _Work, noise: float, options: ScanOptions) -> StripFit:
    strip = work.strip
    return fit_strip(
        strip.along_m,
        strip.across_m,
        strip.height_m,
        _flat_road(strip.along_m, (*work.bumps, *work.rises)),
        start_m=work.bumps[0].start_m,
        end_m=work.bumps[-1].end_m,
        noise_m=noise,
        knot_spacing_m=options.knot_spacing_m,
    )


def _result(
    scan: Scan, options: ScanOptions, points: np.ndarray, work: _Work, fit: StripFit, mean: StripProfile
) -> ScanAnalysis:
    strip, step = work.strip, options.station_step_m
    turned = work.frame.heading_rad - scan.heading_rad
    skew = turned if abs(turned) > scan.heading_within_rad else 0.0
    first, height, variance, centre = mean.start_m, mean.height_m, mean.variance_m2, 0.0
    tracks = None if options.requested else _tracks(scan, options, points, work, fit, mean, skew)
    if tracks is not None:
        first, height, variance = tracks.first_m, tracks.height_m, tracks.variance_m2
        centre = tracks.middle_m
    elif skew:
        centre = sum(track_range(strip, mean, skew)) / 2
        first, height, variance = mean_over_tracks(mean, strip, skew, step)
    flat = int(np.ceil(options.flat_m / step - 1e-9))
    origin = first - flat * step
    station = step * np.arange(height.size + 2 * flat)
    plane_sd = work.frame.height_sd_m(origin + station, strip.centre_m)
    profile = make_profile(
        station,
        np.pad(height, flat),
        height_sd_m=np.sqrt(np.pad(variance, flat) + plane_sd**2),
        name=scan.name,
    )
    if tracks is not None:
        left, right = (np.pad(side, flat) for side in (tracks.sides.left_m, tracks.sides.right_m))
        profile = replace(profile, sides=replace(tracks.sides, left_m=left, right_m=right))
    thin = slice(None, None, max(1, strip.along_m.size // options.strip_points))
    cloud = points[:: max(1, points.shape[0] // options.cloud_points)]
    along, across, above = work.frame.road_coordinates(cloud)
    cloud_along, cloud_across = travel_station(along, across, skew, centre)
    declared = work.frame.turned(-skew)
    return ScanAnalysis(
        profile=profile,
        heading_rad=declared.heading_rad,
        grade=declared.grade,
        camber=declared.camber,
        points=int(points.shape[0]),
        outliers=fit.outliers,
        noise_rms_m=fit.noise_m,
        strip_half_width_m=strip.half_width_m,
        strip_station_m=travel_station(strip.along_m[thin], strip.across_m[thin], skew, centre)[0] - origin,
        strip_height_m=strip.height_m[thin],
        cloud_along_m=cloud_along - origin,
        cloud_across_m=cloud_across,
        cloud_height_m=above,
        messages=_messages(scan, turned, skew, work, fit, mean, profile, options.requested),
    )


def _tracks(
    scan: Scan,
    options: ScanOptions,
    points: np.ndarray,
    work: _Work,
    fit: StripFit,
    mean: StripProfile,
    skew: float,
) -> WheelTracks | None:
    """The profile under the tires; None where they are not known or the scan does not show it."""
    if not scan.tires_m:
        return None
    strip = _strip_of(points, work.frame, scan, options)
    return profile_of_tracks(
        strip,
        _flat_road(strip.along_m, (*work.bumps, *work.rises)),
        fit,
        mean,
        tires_m=scan.tires_m,
        middle_m=scan.lateral_m,
        skew_rad=skew,
        step_m=options.station_step_m,
        knot_spacing_m=options.knot_spacing_m,
        least_points=options.minimum_points,
    )


def _messages(
    scan: Scan,
    turned: float,
    skew: float,
    work: _Work,
    fit: StripFit,
    mean: StripProfile,
    profile: RoadProfile,
    requested: bool,
) -> tuple[str, ...]:
    height = float(profile.height_m.max())
    if height > HEIGHT_M[1]:
        raise DataRejectedError(
            f"Scan {scan.file} shows a bump of {height:.3g} m, more than {HEIGHT_M[1]:g} m; "
            f"check its unit{unit_hint(height, *HEIGHT_M)}."
        )
    sentences = []
    if skew:
        sentences.append(
            f"The crest line of the bump is {abs(np.degrees(turned)):.1f} degrees off the perpendicular to the "
            f"heading: the {'left' if skew > 0.0 else 'right'} wheels meet it first. The profile is the mean of "
            f"{'the tires' if profile.sides else 'all tracks'}. If it was crossed square, set heading_deg to "
            f"{np.degrees(scan.heading_rad + turned) % 360:.1f}; if the direction of travel is less well known, widen "
            "heading_within_deg."
        )
    elif abs(np.degrees(turned)) > 0.5:
        sentences.append(
            f"The heading was turned by {np.degrees(turned):+.2f} degrees to be square to the crest line of the bump."
        )
    if height > UNUSUAL_HEIGHT_M:
        sentences.append(f"The bump is {height:.3f} m high, unusual for a speed bump: check the unit of the scan.")
    if len(work.bumps) > 1:
        gaps = ", ".join(f"{after.start_m - before.end_m:.2f} m" for before, after in pairwise(work.bumps))
        sentences.append(
            f"The scan holds {len(work.bumps)} bumps (flat road between them: {gaps}); the profile holds all of them."
        )
    for rise in work.rises[:3]:
        away = rise.start_m - work.bumps[0].start_m
        side = "before" if away < 0 else "behind"
        kind = "rise" if rise.peak_m > 0 else "dip"
        sentences.append(
            f"A {kind} of {1e3 * abs(rise.peak_m):.0f} mm, {abs(away):.2f} m {side} the start of the bump, is "
            "not part of it and was left out."
        )
    if work.strip.narrowed:
        sentences.append(
            "The bump does not cover the whole scanned width; the strip was cut to "
            f"+-{work.strip.half_width_m:.2f} m around its middle."
        )
    if fit.lateral_sd_m > max(0.002, 0.03 * height):
        sentences.append(
            f"The height of the bump differs across the scanned width by {1e3 * fit.lateral_sd_m:.1f} mm (standard "
            f"deviation); the profile is {'that under the tires' if profile.sides else 'the mean over the width'}."
        )
        if scan.tires_m and not profile.sides and not requested:
            sentences.append(
                f"The scan does not show the whole bump under tires up to {max(scan.tires_m):.2f} m to either side of "
                "its middle: scan both wheel tracks, or give track_m of the axles and lateral_m of the scan."
            )
    if mean.largest_gap_m > 0.05:
        sentences.append(
            f"No point lies on {1e2 * mean.largest_gap_m:.0f} cm of the bump (shadow of the laser?); "
            "the profile bridges it."
        )
    return tuple(sentences)
