"""Reading a decay record: settled level, damped period, decrement and what kind of damping it shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.special import stdtrit

from sysid.sdof.averages import mean_with_scatter, random_effects
from sysid.sdof.decay_modes import ModeFit, fit_modes, scan_single_mode
from sysid.sdof.drop_results import DecayReading
from sysid.sdof.peaks import Extrema, find_extrema, smoothing_half_width
from sysid.sdof.release import Release, find_release
from sysid.sdof.smoothing import local_polynomial, spike_mask

DampingKind = Literal["viscous", "friction", "quadratic", "unknown"]

_SAMPLES_PER_CYCLE = 4.0  # of the highest frequency allowed: fewer and a faster motion may pass for a slow one
_TREND_SIGNIFICANCE = 0.01  # of the test for a decrement that changes
_TREND_RELEVANCE = 0.3  # relative change of the decrement over the record that viscous neighbours do not explain
_TREND_REMARK = 0.1  # relative change that is worth a remark if it is significant
_TREND_UNKNOWN = 0.5  # a change of this size that cannot be excluded leaves the kind of damping open
_SCATTER_REMARK = 0.2  # relative error of the decrement that is worth a remark
_HEAVY_RATIO = 0.10  # of a peak to the one before
_DRIFT_CYCLES, _DRIFT_SIGNIFICANCE = 3.0, 5.0


@dataclass(frozen=True)
class PreparedRecord:
    """A record made ready for reading: spikes and missing readings out, release and single-mode fit found.

    - `time_s`, `value` (n,): usable readings in the window;
    - `release`, `mode` (of the motion after the first turn) and `extrema` are None where `note` says why;
    - `period_s` is the body-mode period [s] that the smoothing uses, sought in `frequency_range_hz`.
    """

    time_s: np.ndarray
    value: np.ndarray
    spikes: int
    release: Release | None
    mode: ModeFit | None
    extrema: Extrema | None
    period_s: float
    frequency_range_hz: tuple[float, float]
    note: str


def prepare_record(
    time_s: Any,
    value: Any,
    *,
    window_s: tuple[float, float] | None = None,
    frequency_range_hz: tuple[float, float] = (0.2, 6.0),
    earliest_s: float | None = None,
    period_s: float | None = None,
    skip_first_turn: bool = False,
    ripple: tuple[np.ndarray, np.ndarray] | None = None,
) -> PreparedRecord:
    """Clean a record and find release, body mode and extrema; arguments as `read_decay`.

    - `period_s` replaces the period found here as the scale of the smoothing and of the search for extrema;
    - `ripple` (times [s], values) is a fitted wheel hop to take out of the readings before the extrema are sought.
    """
    time, y = _usable_readings(time_s, value, window_s)

    def fail(note: str, release: Release | None = None, spikes: int = 0) -> PreparedRecord:
        return PreparedRecord(time, y, spikes, release, None, None, float("nan"), frequency_range_hz, note)

    if time.size < 12:
        return fail(f"only {time.size} readings, a decay needs at least 12")
    rate = 1.0 / float(np.median(np.diff(time)))
    if rate < _SAMPLES_PER_CYCLE * frequency_range_hz[1]:
        return fail(
            f"sampled at {rate:.3g} Hz, too coarse to tell a body mode from faster motion "
            f"(at least {_SAMPLES_PER_CYCLE * frequency_range_hz[1]:.3g} Hz needed)"
        )
    spikes = spike_mask(time, y)
    time, y = time[~spikes], y[~spikes]
    count = int(spikes.sum())
    release = find_release(time, y)
    if release is None:
        return fail("no motion above the noise", spikes=count)
    start = max(release.first_turn_s, earliest_s if earliest_s is not None else -np.inf)
    ringing = time >= start
    first = scan_single_mode(time[ringing], y[ringing], frequency_range_hz)
    if first is None:
        return fail("no oscillation after the release", release, count)
    omega = 2.0 * np.pi * first[0]
    bounds = ((-0.02 * omega, 1.5 * omega), (0.6 * omega, 1.6 * omega))
    mode = fit_modes(time[ringing], y[ringing], [(first[1] * omega, omega)], [bounds])
    if mode is None:
        return fail("too few readings after the release", release, count)
    mode = _with_drift(time[ringing], y[ringing], mode)
    period = period_s or 2.0 * np.pi / float(mode.angular_frequency[0])
    if skip_first_turn:
        start = max(start, release.first_turn_s + 0.25 * period)
    if ripple is not None:
        y = y - np.interp(time, *ripple, left=0.0, right=0.0)
    moving = time >= max(release.time_s, earliest_s if earliest_s is not None else -np.inf)
    extrema = find_extrema(time[moving], y[moving], period, start, release.noise_sd)
    return PreparedRecord(time, y, count, release, mode, extrema, period, frequency_range_hz, "")


def read_decay(
    time_s: Any,
    value: Any,
    *,
    window_s: tuple[float, float] | None = None,
    frequency_range_hz: tuple[float, float] = (0.2, 6.0),
    earliest_s: float | None = None,
    skip_first_turn: bool = False,
) -> DecayReading:
    """Read settled level, damped period and logarithmic decrement off a free-decay record.

    delta_i = ln(S_i / S_(i+2)) with the peak-to-trough swings S_i = |x_i - x_(i+1)| of the refined extrema, so that an
    error of the baseline cancels; the period is twice the slope of the extrema's times over their number.  Both are
    averages weighted by the noise plus the scatter beyond the noise (`random_effects`): a perfect exponential decay is
    read from its large swings, a decrement that varies is averaged evenly over the cycles.

    Parameters
    ----------
    time_s, value
        (n,) times [s] and readings in any unit of length (or angle), NaN where missing; irregular stamps are allowed.
    window_s
        (start, end) [s] of the part to read; all of it by default.  Give it where a record is disturbed later.
    frequency_range_hz
        Where the body mode is sought.
    earliest_s
        Readings before this time [s] are not used for extrema, for instance because the wheel still touches the plank.
    skip_first_turn
        Leave out the first extremum after the release, where the motion is not yet free (an axle that drops).

    Returns
    -------
    DecayReading
        `usable` False and NaN numbers where fewer than two peaks with the trough between them stand above the noise.

    Raises
    ------
    ValueError
        If the two arrays are not one-dimensional and of equal length.
    """
    record = prepare_record(
        time_s,
        value,
        window_s=window_s,
        frequency_range_hz=frequency_range_hz,
        earliest_s=earliest_s,
        skip_first_turn=skip_first_turn,
    )
    return reading_of(record)


def _with_drift(time: np.ndarray, value: np.ndarray, mode: ModeFit) -> ModeFit:
    """The fit with a linear drift of the baseline where the record shows one beyond doubt, else the fit as it is."""
    sigma, omega = float(mode.decay_rate[0]), float(mode.angular_frequency[0])
    if (time[-1] - time[0]) * omega < _DRIFT_CYCLES * 2.0 * np.pi:
        return mode
    bounds = ((-0.02 * omega, 1.5 * omega), (0.6 * omega, 1.6 * omega))
    drifting = fit_modes(time, value, [(sigma, omega)], [bounds], drift=True)
    if drifting is None or abs(drifting.drift_per_s) < _DRIFT_SIGNIFICANCE * drifting.drift_se:
        return mode
    return drifting


def smooth_record(record: PreparedRecord, at_s: np.ndarray) -> np.ndarray:
    """The record with wheel hop kept out, (m,) at `at_s`; rest and motion are smoothed apart so that neither leaks."""
    result = np.full(np.shape(at_s), np.nan)
    if record.release is None or not np.isfinite(record.period_s):
        return result
    half_width = smoothing_half_width(record.period_s)
    for select in (np.less, np.greater_equal):
        part, wanted = select(record.time_s, record.release.time_s), select(at_s, record.release.time_s)
        if part.any() and wanted.any():
            result[wanted] = local_polynomial(record.time_s[part], record.value[part], at_s[wanted], half_width)[0]
    return result


def reading_of(record: PreparedRecord) -> DecayReading:
    """Averages over the extrema of a prepared record (see `read_decay`)."""
    if record.extrema is None or record.mode is None:
        return _unusable(record, record.note)
    extrema, mode = record.extrema, record.mode
    used = np.flatnonzero(extrema.used)
    if used.size < 3:
        return _unusable(record, "fewer than two peaks of the free decay stand above the noise, so no decrement")
    times, heights, index = extrema.time_s[used], extrema.value[used], extrema.index[used]
    design = np.stack([np.ones(used.size), 0.5 * (index - index.mean())], axis=1)
    line = random_effects(design, times - times[0], np.diag(extrema.time_sd[used] ** 2))
    heights = heights - mode.drift_per_s * (times - times[0])
    decrements = _decrements(heights, index, extrema.value_sd[used])
    if decrements is None:
        return _unusable(record, "the usable peaks are not successive, so no decrement")
    values, covariance, relative = decrements
    mean, error = mean_with_scatter(values, covariance)
    if not error < abs(mean):
        spread = f"{values.min():.2f} to {values.max():.2f}"
        return _unusable(record, f"the swings do not fall evenly (decrements from {spread}), so no decrement")
    slope, slope_error, kind, note = _trend(values, covariance, relative, mean)
    notes = [note] if note else []
    if record.spikes:
        notes.append(f"{record.spikes} spikes left out")
    if mode.drift_per_s:
        notes.append("a linear drift of the level was taken out")
    if np.exp(-mean) < _HEAVY_RATIO:
        notes.append("heavily damped: the next peak is below 10 %, so the decrement rests on small swings")
    if error > _SCATTER_REMARK * abs(mean):
        notes.append(f"the swings do not fall evenly, the decrement is known to {100 * error / abs(mean):.0f} % only")
    if values.size == 1:
        notes.append("one decrement only, so nothing is known of its dependence on amplitude")
    level, level_error = _settled_level(record, times[0], float(line.value[1]), mode)
    return DecayReading(
        settled_level=level,
        settled_level_se=level_error,
        extremum_time_s=extrema.time_s,
        extremum_value_m=extrema.value,
        used=extrema.used,
        damped_period=float(line.value[1]),
        damped_period_se=float(np.sqrt(line.covariance[1, 1])),
        log_decrement=mean,
        log_decrement_se=error,
        damping_kind=kind,
        decrement_trend=slope,
        decrement_trend_se=slope_error,
        usable=True,
        note="; ".join(notes),
    )


def _usable_readings(time_s: Any, value: Any, window_s: tuple[float, float] | None) -> tuple[np.ndarray, np.ndarray]:
    time, y = np.asarray(time_s, float), np.asarray(value, float)
    if time.ndim != 1 or time.shape != y.shape:
        raise ValueError(
            f"read_decay got times of shape {time.shape} and readings of shape {y.shape}; "
            "give two one-dimensional arrays of equal length."
        )
    keep = np.isfinite(time) & np.isfinite(y)
    if window_s is not None:
        keep &= (time >= window_s[0]) & (time <= window_s[1])
    time, first = np.unique(time[keep], return_index=True)
    return time, y[keep][first]


def _decrements(
    heights: np.ndarray, index: np.ndarray, sd: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Decrements per cycle (d,), their noise covariance (d, d) and their relative amplitudes (d,)."""
    neighbours = np.flatnonzero(np.diff(index) == 1)
    if neighbours.size < 2:
        return None
    sign = np.where(neighbours % 2 == 0, 1.0, -1.0)
    to_swing = np.zeros((neighbours.size, heights.size))
    rows = np.arange(neighbours.size)
    swing = np.abs(heights[neighbours] - heights[neighbours + 1])
    to_swing[rows, neighbours], to_swing[rows, neighbours + 1] = sign / swing, -sign / swing
    start = index[neighbours]
    pairs: list[tuple[int, int]] = [
        (int(i), int(np.argmax(start >= start[i] + 2))) for i in rows if np.any(start >= start[i] + 2)
    ] or [(0, neighbours.size - 1)]
    first, second = np.array(pairs).T
    cycles = 0.5 * (start[second] - start[first])
    contrast = np.zeros((len(pairs), neighbours.size))
    contrast[np.arange(len(pairs)), first] = 1.0 / cycles
    contrast[np.arange(len(pairs)), second] = -1.0 / cycles
    transfer = contrast @ to_swing
    # The heights' signs alternate, so a shared extremum enters both swings with the same sign.
    values = contrast @ np.log(swing)
    relative = np.sqrt(swing[first] * swing[second]) / swing[0]
    return values, (transfer * sd**2) @ transfer.T, relative


def _trend(
    values: np.ndarray, covariance: np.ndarray, relative: np.ndarray, mean: float
) -> tuple[float, float, DampingKind, str]:
    """Slope of the decrement against relative amplitude, its standard error, what it means and a remark.

    The kind is judged on the ratios R_i = S_(i+2)/S_i, which for viscous and dry friction together are exactly
    rho^2 - f/S_i, and for a quadratic share fall about linearly with S_i.
    """
    nan = float("nan")
    if values.size < 3:
        return nan, nan, "unknown", ""
    line = random_effects(_line(relative), values, covariance)
    slope, error = float(line.value[1]), float(np.sqrt(line.covariance[1, 1]))
    ratio = np.exp(-values)
    ratio_covariance = covariance * np.outer(ratio, ratio)
    fits = [(x, random_effects(_line(x), ratio, ratio_covariance)) for x in (relative, 1.0 / relative)]
    x, fit = min(fits, key=lambda item: (item[1].extra_sd, float(item[1].covariance[1, 1] / item[1].value[1] ** 2)))
    # Overlapping cycles share swings, so only every other decrement counts as a degree of freedom.
    limit = float(stdtrit(max(values.size // 2 - 1, 1), 1.0 - 0.5 * _TREND_SIGNIFICANCE))
    at_ends = np.clip(fit.value[0] + fit.value[1] * (np.array([x.min(), x.max()]) - x.mean()), 0.02, None)
    change = abs(float(np.log(at_ends[1] / at_ends[0]))) / abs(mean)
    certainty = abs(float(fit.value[1])) / max(float(np.sqrt(fit.covariance[1, 1])), 1e-300)
    falls_with_amplitude = (fit.value[1] < 0.0) == (x is relative)
    if certainty > limit and change >= _TREND_RELEVANCE:
        if falls_with_amplitude:
            return slope, error, "quadratic", "the decrement falls with the amplitude, as with quadratic damping"
        why = "as with dry friction or a curved spring"
        return slope, error, "friction", f"the decrement rises as the amplitude falls, {why}"
    if limit * change > _TREND_UNKNOWN * certainty or values.size < 4:
        return slope, error, "unknown", ""
    remark = ""
    if certainty > limit and change > _TREND_REMARK:
        remark = f"the decrement changes by {100 * change:.0f} % over the record, significantly but little"
    return slope, error, "viscous", remark


def _line(x: np.ndarray) -> np.ndarray:
    return np.stack([np.ones(x.size), x - x.mean()], axis=1)


def _settled_level(record: PreparedRecord, start_s: float, period_s: float, mode: ModeFit) -> tuple[float, float]:
    """Level about which the last part of the free decay swings, by a fit of one mode on a constant."""
    late = record.time_s >= max(start_s, 0.5 * (start_s + record.time_s[-1]) - period_s)
    omega, sigma = 2.0 * np.pi / period_s, float(mode.decay_rate[0])
    bounds = ((-0.1 * omega, 1.5 * omega), (0.8 * omega, 1.25 * omega))
    fit = fit_modes(record.time_s[late], record.value[late], [(sigma, omega)], [bounds])
    if fit is None:
        return mode.baseline, mode.baseline_se
    return fit.baseline, fit.baseline_se


def _unusable(record: PreparedRecord, note: str) -> DecayReading:
    nan = float("nan")
    extrema, mode = record.extrema, record.mode
    empty = np.zeros(0)
    tail = record.value[record.value.size - max(1, record.value.size // 5) :]
    level = float(np.median(tail)) if tail.size else nan
    return DecayReading(
        settled_level=mode.baseline if mode is not None else level,
        settled_level_se=mode.baseline_se if mode is not None else nan,
        extremum_time_s=extrema.time_s if extrema is not None else empty,
        extremum_value_m=extrema.value if extrema is not None else empty,
        used=np.zeros(extrema.time_s.size, bool) if extrema is not None else empty.astype(bool),
        damped_period=nan,
        damped_period_se=nan,
        log_decrement=nan,
        log_decrement_se=nan,
        damping_kind="unknown",
        decrement_trend=nan,
        decrement_trend_se=nan,
        usable=False,
        note=note,
    )
