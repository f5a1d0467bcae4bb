"""The mean profile of a strip of road: robust weights, bands that count alike, ends where the data put them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.arrays import Points
from sysid.road.bump_search import split_into_bands
from sysid.road.penalised_spline import BinnedHeights, SplineFit, bin_heights, fit_spline

# Road on either side of a bump that takes part in the fit; the ends of the bump are looked for in it.
WINDOW_M = 0.25
#: Residuals over the noise: full weight up to the first, none beyond the second (one of 150,000 normal ones).
_HUBER = 2.0
_REJECT = 4.5
#: Length of the patches whose points share the texture of the road, and largest share of the height by which one band
#: may be worn: assumptions.
_PATCH_M = 0.05
_LARGEST_WEAR = 0.35
# Steps in which the ends are tried: coarse over what the wide fit leaves open, then fine about the best.
_END_COARSE_M = 0.005 * np.arange(-16, 9)
_END_FINE_M = 0.001 * np.arange(-6, 7)
# A moved end is not felt further away than this.
_END_REACH_M = 0.15


@dataclass(frozen=True)
class StripFit:
    """Smooth mean of a strip before its ends are settled, and what the strip says about its own uniformity.

    - `data` are the weighted points between `low_m` and `high_m` (bump and road next to it), `wide` the spline over all
      of that, `start_m` and `end_m` where the bump was seen;
    - `noise_m`: the scatter of one point.

    - `inflation` (>= 1) is the variance of patch means over what independent noise predicts;
    - `waviness_sd_m`: departure of the strip's mean from the plane on the flat road, without noise; the profile under
      the bump is not known better than this;
    - `lateral_sd_m`: how much the bump's height differs between `bands` bands, beyond the differences on the flat road,
      and `texture_sd_m`: these differences.

    `crest_turn_rad` is the turn of the heading that squares it to the crest line; `outliers` counts rejected points.
    """

    data: BinnedHeights
    wide: SplineFit
    start_m: float
    end_m: float
    low_m: float
    high_m: float
    noise_m: float
    inflation: float
    waviness_sd_m: float
    lateral_sd_m: float
    texture_sd_m: float
    bands: int
    crest_turn_rad: float
    outliers: int


@dataclass(frozen=True)
class StripProfile:
    """Mean profile on uniform stations from `start_m` to `end_m` (n,), zero at both, with its variance.

    `largest_gap_m` is the longest piece of the bump without points.
    """

    station_m: np.ndarray
    height_m: np.ndarray
    variance_m2: np.ndarray
    start_m: float
    end_m: float
    largest_gap_m: float


def fit_strip(
    along_m: Points,
    across_m: Points,
    height_m: Points,
    flat: Points,
    *,
    start_m: float,
    end_m: float,
    noise_m: float,
    knot_spacing_m: float,
) -> StripFit:
    """Fit the mean of the points (n,) [m] about the bump seen between `start_m` and `end_m` [m].

    `flat` (n,) bool marks points of the flat road, `noise_m` is the local noise.
    Outliers are taken out by Huber weights (2 standard deviations) and rejection (4.5) about the median of their
    patch of a band, with the median absolute deviation as scale: a worn band is no outlier.  Points of sparse bands
    weigh more (at most three times), so that a scanner standing on one side does not turn the mean over the width into
    the profile of the near side.
    """
    inside = (along_m > start_m - WINDOW_M) & (along_m < end_m + WINDOW_M)
    along, across, height = along_m[inside], across_m[inside], height_m[inside]
    low, high = float(along.min()), float(along.max())
    band, band_count = split_into_bands(across)
    band_weight = _band_weights(band, band_count)

    rough = _running_median(along, height)
    residual = height - rough
    departure = _band_departure(along, band, residual, rough, noise_m)
    local = residual - departure
    smoothness = None
    for iteration in range(5):
        scale = max(_mad(local), 0.3 * noise_m)
        robust = _robust_weights(local / scale)
        weight = band_weight * robust
        # Kish's effective number: weights that differ for coverage must not pretend to know more than the points do.
        weight = weight * weight.sum() / np.sum(weight**2)
        data = bin_heights(along, height, weight)
        fit = fit_spline(data, low, high, knot_spacing_m=knot_spacing_m, smoothness=smoothness)
        smooth = fit.height_m(along)
        residual = height - smooth
        if iteration == 0:
            departure = _band_departure(along, band, residual, smooth, scale)
        local = residual - departure
        # The smoothness settles long before the weights do.
        smoothness = fit.smoothness if iteration >= 2 else None
    scale = max(_mad(local), 0.3 * noise_m)

    bump = _patches(along, band, residual, weight, smooth)
    raised = bump.height_m > 0.3 * bump.height_m.max(initial=0.0)
    inflation = max(1.0, float(np.mean(bump.size * bump.mean_m**2)) / scale**2) if bump.size.size else 1.0
    waviness, flat_lateral = _flat_road(along_m[flat], across_m[flat], height_m[flat], scale)
    return StripFit(
        data=data,
        wide=fit,
        start_m=start_m,
        end_m=end_m,
        low_m=low,
        high_m=high,
        noise_m=scale,
        inflation=inflation,
        waviness_sd_m=waviness,
        lateral_sd_m=float(np.sqrt(max(_excess(bump, raised, scale) - flat_lateral, 0.0))),
        texture_sd_m=float(np.sqrt(flat_lateral)),
        bands=band_count,
        crest_turn_rad=_crest_turn(fit.slope(along), across, weight, residual),
        outliers=int(np.sum(robust == 0) + np.sum(np.abs(height_m[flat & ~inside]) > _REJECT * scale)),
    )


def _crest_turn(slope: np.ndarray, across: np.ndarray, weight: np.ndarray, residual: np.ndarray) -> float:
    """Angle [rad] by which the bump is turned against the strip: residuals (n,) that grow across it where it slopes."""
    # Steps have no slope: where the spline makes one up, it must not decide about the heading.
    slope = np.clip(slope, -1.0, 1.0)
    lever = across - np.average(across, weights=weight * slope**2 + 1e-12)
    moment = float(np.sum(weight * (lever * slope) ** 2))
    return float(np.sum(weight * lever * slope * residual)) / moment if moment > 0 else 0.0


def settle_ends(fit: StripFit, *, step_m: float, knot_spacing_m: float) -> StripProfile:
    """Return the profile every `step_m`, averaged over where the bump may start and end.

    Each candidate end has the marginal likelihood of its spline as weight, tempered by the inflation; the variance is
    that of the mixture, plus waviness and the mean of the bands.  One end moves at a time: the two are far apart and do
    not feel each other.
    """
    grid = np.arange(fit.low_m, fit.high_m, step_m)
    visible = np.abs(fit.wide.height_m(grid)) > np.maximum(3 * np.sqrt(fit.wide.variance_m2(grid)), 5e-4)
    seen = grid[visible]
    first = float(min(seen.min(), fit.start_m)) if seen.size else fit.start_m
    last = float(max(seen.max(), fit.end_m)) if seen.size else fit.end_m
    best = fit_spline(fit.data, first, last, knot_spacing_m=knot_spacing_m)
    starts, ends = [best], [best]
    for offsets in (_END_COARSE_M, _END_FINE_M):
        starts = _try_ends(fit, first + offsets, np.full(offsets.size, best.end_m), best)
        best = min((best, *starts), key=lambda trial: trial.criterion)
        ends = _try_ends(fit, np.full(offsets.size, best.start_m), last - offsets, best)
        best = min((best, *ends), key=lambda trial: trial.criterion)
        best = fit_spline(fit.data, best.start_m, best.end_m, knot_spacing_m=knot_spacing_m)
        first, last = best.start_m, best.end_m
    start_trials, start_share = _likely(starts or [best], fit.inflation)
    end_trials, end_share = _likely(ends or [best], fit.inflation)
    first = min(trial.start_m for trial in start_trials)
    last = max(trial.end_m for trial in end_trials)
    station = first + step_m * np.arange(int(np.ceil((last - first) / step_m - 1e-9)) + 1)
    mean, variance = best.height_m(station), best.variance_m2(station)
    for trials, share, near in (
        (start_trials, start_share, station < best.start_m + _END_REACH_M),
        (end_trials, end_share, station > best.end_m - _END_REACH_M),
    ):
        local = station[near]
        curves = np.array([trial.height_m(local) for trial in trials])
        spread = np.array([trial.variance_m2(local) for trial in trials])
        average = share @ curves
        mean[near] += average - best.height_m(local)
        variance[near] += share @ (spread + (curves - average) ** 2) - best.variance_m2(local)
    mean[0] = mean[-1] = 0.0
    measured = fit.data.station_m[(fit.data.station_m > first) & (fit.data.station_m < last)]
    return StripProfile(
        station_m=station,
        height_m=mean,
        variance_m2=np.maximum(variance, 0.0) + fit.waviness_sd_m**2 + fit.lateral_sd_m**2 / fit.bands,
        start_m=first,
        end_m=last,
        largest_gap_m=float(np.max(np.diff(np.concatenate([[first], measured, [last]])))),
    )


def _try_ends(fit: StripFit, starts: np.ndarray, ends: np.ndarray, best: SplineFit) -> list[SplineFit]:
    """Return the fits with other ends and the smoothness of the best one so far."""
    spacing = (best.end_m - best.start_m) / (best.spline.t.size - 7)
    return [
        fit_spline(fit.data, float(start), float(end), knot_spacing_m=spacing, smoothness=best.smoothness)
        for start, end in zip(starts, ends, strict=True)
        if start >= fit.low_m and end <= fit.high_m and end - start > 8 * spacing
    ]


def _likely(fits: list[SplineFit], inflation: float) -> tuple[list[SplineFit], np.ndarray]:
    criterion = np.array([fit.criterion for fit in fits])
    share = np.exp(-0.5 * (criterion - criterion.min()) / inflation)
    kept = np.flatnonzero(share >= 0.01 * share.max())
    return [fits[i] for i in kept], share[kept] / share[kept].sum()


def _band_weights(band: np.ndarray, count: int) -> np.ndarray:
    points = np.bincount(band, minlength=count)
    typical = float(np.median(points[points > 0]))
    return np.asarray(np.clip(typical / np.maximum(points, 1), 1 / 3, 3.0)[band])


@dataclass(frozen=True)
class _Patches:
    """Patches of road 5 cm long and one band wide with five or more points: their number, mean residual and height."""

    size: np.ndarray
    mean_m: np.ndarray
    height_m: np.ndarray


def _patches(
    along: np.ndarray, band: np.ndarray, residual: np.ndarray, weight: np.ndarray, height: np.ndarray
) -> _Patches:
    used = weight > 0
    if not used.any():
        return _Patches(np.zeros(0), np.zeros(0), np.zeros(0))
    along, band, residual, height = along[used], band[used], residual[used], height[used]
    label = np.floor((along - along.min()) / _PATCH_M).astype(np.int64) * (band.max() + 1) + band
    size = np.bincount(label)
    enough = size >= 5
    safe = np.maximum(size, 1)
    mean, level = np.bincount(label, weights=residual) / safe, np.bincount(label, weights=height) / safe
    return _Patches(size[enough], mean[enough], level[enough])


def _band_departure(
    along: np.ndarray, band: np.ndarray, residual: np.ndarray, height: np.ndarray, scale: float
) -> np.ndarray:
    """Return at each point the median residual of its patch of its band, as far as wear or skewness can explain it.

    Points close to that median are what the band looks like; what is more than a third of the bump's height off is an
    object on the road and stays an outlier.
    """
    label = np.floor((along - along.min()) / _PATCH_M).astype(np.int64) * (band.max() + 1) + band
    order = np.lexsort((residual, label))
    _, first, size = np.unique(label[order], return_index=True, return_counts=True)
    median = residual[order][first + size // 2]
    departure = np.empty_like(residual)
    # A departure within the noise of its median is none; following it would make the noise look smaller than it is.
    real = (size >= 5) & (np.abs(median) > 4 * scale / np.sqrt(size))
    departure[order] = np.repeat(np.where(real, median, 0.0), size)
    limit = _LARGEST_WEAR * np.abs(height) + 2 * scale
    return np.asarray(np.clip(departure, -limit, limit))


def _excess(patches: _Patches, chosen: np.ndarray, scale: float) -> float:
    """Return the variance of the chosen patches' means beyond that of independent noise, zero for fewer than ten."""
    if np.count_nonzero(chosen) < 10:
        return 0.0
    return max(0.0, float(np.mean(patches.mean_m[chosen] ** 2 - scale**2 / patches.size[chosen])))


def _flat_road(along: np.ndarray, across: np.ndarray, height: np.ndarray, scale: float) -> tuple[float, float]:
    """Return the waviness [m] of the strip's mean on the flat road and the variance [m^2] of patches there."""
    if along.size < 50:
        return 0.0, 0.0
    band, count = split_into_bands(across)
    weight = _band_weights(band, count) * _robust_weights(height / scale)
    patches = _patches(along, band, height, weight, np.zeros_like(height))
    label = np.floor((along - along.min()) / 0.1).astype(np.int64)
    total = np.bincount(label, weights=weight)
    square = np.bincount(label, weights=weight**2)
    used = total > 10
    if np.count_nonzero(used) < 3:
        return 0.0, _excess(patches, np.ones(patches.size.size, dtype=bool), scale)
    mean = np.bincount(label, weights=weight * height)[used] / total[used]
    waviness = float(np.mean(mean**2 - scale**2 * square[used] / total[used] ** 2))
    return float(np.sqrt(max(waviness, 0.0))), _excess(patches, np.ones(patches.size.size, dtype=bool), scale)


def _robust_weights(standard: np.ndarray) -> np.ndarray:
    size = np.abs(standard)
    return np.where(size > _REJECT, 0.0, np.minimum(1.0, _HUBER / np.maximum(size, _HUBER)))


def _running_median(along: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Return a rough profile at the points: medians of bins of about 15 points, at least 1 cm, joined by lines."""
    width = max(0.01, float(np.ptp(along)) * 15 / along.size)
    label = np.floor((along - along.min()) / width).astype(np.int64)
    order = np.argsort(label, kind="stable")
    _, first = np.unique(label[order], return_index=True)
    groups = np.split(order, first[1:])
    station = np.array([np.mean(along[group]) for group in groups])
    level = np.array([np.median(height[group]) for group in groups])
    return np.asarray(np.interp(along, station, level))


def _mad(residual: np.ndarray) -> float:
    return 1.4826 * float(np.median(np.abs(residual)))
