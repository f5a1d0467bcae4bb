"""Free-decay model: body mode, wheel hop and offset fitted to the readings themselves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.sdof.decay import PreparedRecord
from sysid.sdof.decay_modes import ModeFit, fit_modes, mode_curve, scan_single_mode

HOP_RANGE_HZ = (6.0, 20.0)
_HOP_STARTS_HZ = (8.5, 12.0)
_HOP_DAMPING_RATIO = 0.12  # of the wheel hop where the search begins
_HOP_ABOVE_BODY = 2.0  # hop is sought at least an octave above the body mode
_WINDOW_CANDIDATES = 5  # later starts of the fitted window that are tried
_WINDOW_TOLERANCE = 1.15  # residuals this close to the noise, or to the best window, are as good
_WINDOW_SHARE = 0.2  # of the range of the record: the least swing that is left to fit
_POOR_NOISE_RATIO = 1.5  # residuals over noise from which a fit counts as poor,
_POOR_SHARE = 0.02  # if they are also more than this share of the amplitude
_UNEXPLAINED = 0.35  # of the motion: three body modes of a truck leave 0.32, two drops in one record 0.39 and more
_UNCERTAIN = 0.5  # relative error of the decay rate that leaves it unknown
_LARGEST_DAMPING_RATIO = 0.7  # beyond, a record shows less than one swing
_DRIFT_CYCLES, _DRIFT_SIGNIFICANCE = 3.0, 4.0
_CURVATURE_SIGNIFICANCE = 4.0  # standard errors
_CURVATURE_RELEVANCE = 0.3  # relative change of the decay rate over two time constants


@dataclass(frozen=True)
class FreeDecayFit:
    """Fit of y(t) = offset + body mode + wheel-hop mode after the release.

    - `decay_rate`: sigma [1/s], and `angular_frequency`: omega [rad/s], of the body mode with their `covariance` (2,
      2);
    - `hop` (decay rate, angular frequency): or None where the record shows none;
    - `window_s`: the part fitted;
    - `time_s`, `model`, `hop_model` (n,): the fitted curve and its hop part;
    - `noise_ratio`: residual over noise at rest (NaN where unknown).

    `usable` False (NaN numbers) where no body mode could be fitted, or it leaves more than 35 % of the motion.
    """

    decay_rate: float
    angular_frequency: float
    covariance: np.ndarray
    hop: tuple[float, float] | None
    window_s: tuple[float, float]
    time_s: np.ndarray
    model: np.ndarray
    hop_model: np.ndarray
    residual_rms: float
    noise_ratio: float
    usable: bool
    poor: bool
    note: str

    @property
    def damped_period(self) -> float:
        """Period of the body mode 2 pi / omega [s]."""
        return 2.0 * np.pi / self.angular_frequency

    @property
    def log_decrement(self) -> float:
        """Logarithmic decrement per cycle of the body mode 2 pi sigma / omega."""
        return 2.0 * np.pi * self.decay_rate / self.angular_frequency


def fit_free_decay(record: PreparedRecord, earliest_s: float = -np.inf) -> FreeDecayFit:
    """Fit body mode, wheel hop and offset to the free part of a prepared record by nonlinear least squares.

    y(t) = y0 + exp(-sigma t) (a cos omega t + b sin omega t) + the same with the wheel hop's sigma, omega.  The hop
    mode (6-20 Hz) and a linear drift stay only where the record shows them.  The window starts at the earliest extremum
    from which the residual is no more than 15 % above the noise or what later starts reach, since the wheel still rolls
    off the plank at first.  Standard errors allow for the autocorrelation of the residual.

    Parameters
    ----------
    record
        From `prepare_record`.
    earliest_s
        The window does not start before this time [s].

    Returns
    -------
    FreeDecayFit
        `poor` marks a residual well above the noise, `note` says what the fit shows (friction, drift, misfit).
    """
    if record.mode is None or record.release is None or record.extrema is None:
        return _unusable(record.note)
    fits: list[ModeFit] = []
    for start in _window_starts(record, earliest_s):
        if (candidate := _fit_window(record, start)) is not None:
            fits.append(candidate)
            if candidate.residual_rms <= _WINDOW_TOLERANCE * record.release.noise_sd:
                break  # as good as the noise allows, no later start can do better
    if not fits:
        return _unusable("too few readings after the release for a free-decay model")
    best = min(fit.residual_rms for fit in fits)
    fit = next(fit for fit in fits if fit.residual_rms <= _WINDOW_TOLERANCE * best)
    fit = _with_drift(fit, record)
    inside = record.time_s >= fit.start_s
    time, value = record.time_s[inside], record.value[inside]
    sigma, omega = float(fit.decay_rate[0]), float(fit.angular_frequency[0])
    spread = np.sqrt(np.diagonal(fit.covariance)[:2])
    amplitude = float(fit.amplitude[0])
    noise = record.release.noise_sd
    ratio = fit.residual_rms / noise if noise > 1e-9 * amplitude else float("nan")
    if not fit.converged or spread[1] > 0.1 * omega or spread[0] > max(_UNCERTAIN * abs(sigma), 0.02 * omega):
        return _unusable("the body mode is too short or too small for a free-decay fit")
    if sigma <= 0.0:
        return _unusable("the oscillation does not decay")
    if sigma > np.hypot(sigma, omega) * _LARGEST_DAMPING_RATIO:
        return _unusable("too heavily damped to tell period and decrement apart")
    left = _unexplained(value, fit.residual_rms, noise)
    if left > _UNEXPLAINED:
        return _unusable(
            f"a decaying body mode leaves {100.0 * left:.0f} % of the motion unexplained (something else moved the "
            "axle, or several modes are equally strong)"
        )
    poor = fit.residual_rms > _POOR_SHARE * amplitude and not ratio < _POOR_NOISE_RATIO
    notes = []
    if poor:
        by = f", {ratio:.1f} times the noise" if np.isfinite(ratio) else ""
        share = 100.0 * fit.residual_rms / amplitude
        notes.append(f"poor fit: residual {share:.1f} % of the amplitude{by} (neighbouring axles, friction or contact)")
    notes += _envelope_note(fit, time, value)
    if fit.drift_per_s:
        notes.append("a linear drift was fitted along")
    return FreeDecayFit(
        decay_rate=sigma,
        angular_frequency=omega,
        covariance=fit.covariance[:2, :2].copy(),
        hop=(float(fit.decay_rate[1]), float(fit.angular_frequency[1])) if fit.decay_rate.size > 1 else None,
        window_s=(float(time[0]), float(time[-1])),
        time_s=time,
        model=fit.model,
        hop_model=mode_curve(fit, time, 1) if fit.decay_rate.size > 1 else np.zeros(time.size),
        residual_rms=fit.residual_rms,
        noise_ratio=ratio,
        usable=True,
        poor=poor,
        note="; ".join(notes),
    )


def _window_starts(record: PreparedRecord, earliest_s: float) -> list[float]:
    """First turn after the release and the extrema after it that leave two cycles and a fifth of the motion."""
    if record.release is None or record.extrema is None:
        return []
    first = max(record.release.first_turn_s, earliest_s)
    times, heights = record.extrema.time_s, record.extrema.value
    swings = np.abs(np.diff(heights, append=heights[-1:]))
    later = (times > first) & (times <= record.time_s[-1] - 2.0 * record.period_s)
    # The remaining motion must be large enough for a fit: a record at rest fits best of all.
    later &= swings > _WINDOW_SHARE * float(np.ptp(record.value[record.time_s >= first]))
    starts = [first, *times[later].tolist()]
    return starts[: _WINDOW_CANDIDATES + 1]


def _body_bounds(omega: float) -> tuple[tuple[float, float], tuple[float, float]]:
    return (-0.05 * omega, 1.5 * omega), (0.6 * omega, 1.6 * omega)


def _hop_bounds(body_omega: float, time: np.ndarray) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Bounds of the hop's decay rate and angular frequency, None where the sampling does not reach it."""
    nyquist_hz = 0.5 / float(np.median(np.diff(time)))
    low = max(2.0 * np.pi * HOP_RANGE_HZ[0], _HOP_ABOVE_BODY * body_omega)
    high = 2.0 * np.pi * min(HOP_RANGE_HZ[1], 0.8 * nyquist_hz)
    return ((0.0, 0.6 * high), (low, high)) if high > 1.2 * low else None


def _fit_window(record: PreparedRecord, start_s: float) -> ModeFit | None:
    """Fit from one start; the hop mode is added only where it earns its coefficients."""
    inside = record.time_s >= start_s
    time, value = record.time_s[inside], record.value[inside]
    first = scan_single_mode(time, value, record.frequency_range_hz) if time.size >= 16 else None
    if first is None:
        return None
    omega = 2.0 * np.pi * first[0]
    single = fit_modes(time, value, [(first[1] * omega, omega)], [_body_bounds(omega)])
    if single is None:
        return None
    body = (float(single.decay_rate[0]), float(single.angular_frequency[0]))
    hop_bounds = _hop_bounds(body[1], time)
    fit = single
    if hop_bounds is None:
        return fit
    for hop_hz in _HOP_STARTS_HZ:
        hop_omega = float(np.clip(2.0 * np.pi * hop_hz, 1.02 * hop_bounds[1][0], 0.98 * hop_bounds[1][1]))
        start = (_HOP_DAMPING_RATIO * hop_omega, hop_omega)
        both = fit_modes(time, value, [body, start], [_body_bounds(body[1]), hop_bounds])
        if both is not None and _earned(single, both, 4) and both.residual_rms < fit.residual_rms:
            fit = both
    return fit


def _with_drift(fit: ModeFit, record: PreparedRecord) -> ModeFit:
    """The fit with a linear drift where the record shows one beyond doubt, else the fit as it is."""
    inside = record.time_s >= fit.start_s
    time, value = record.time_s[inside], record.value[inside]
    omega = float(fit.angular_frequency[0])
    if (time[-1] - time[0]) * omega < _DRIFT_CYCLES * 2.0 * np.pi:
        return fit
    modes = list(zip(fit.decay_rate.tolist(), fit.angular_frequency.tolist(), strict=True))
    bounds = [_body_bounds(omega)]
    hop_bounds = _hop_bounds(omega, time)
    if len(modes) > 1 and hop_bounds is not None:
        bounds.append(hop_bounds)
    drifting = fit_modes(time, value, modes[: len(bounds)], bounds, drift=True)
    if drifting is None or not _earned(fit, drifting, 1):
        return fit
    return drifting if abs(drifting.drift_per_s) > _DRIFT_SIGNIFICANCE * drifting.drift_se else fit


def _earned(simple: ModeFit, rich: ModeFit, extra: int) -> bool:
    """Whether the richer model lowers the Bayesian information criterion, and by more than rounding errors."""
    samples = simple.residual.size
    before, after = simple.residual_rms**2, rich.residual_rms**2
    if before <= 1e-18 * float(simple.amplitude[0]) ** 2:
        return False
    return bool(samples * np.log(before / max(after, 1e-300)) > extra * np.log(samples))


def _unexplained(value: np.ndarray, residual_rms: float, noise_sd: float) -> float:
    """Residual over motion, both as root mean squares without the noise."""
    residual, motion = residual_rms**2 - noise_sd**2, float(np.var(value)) - noise_sd**2
    return float(np.sqrt(max(residual, 0.0) / max(motion, residual, 1e-300)))


def _envelope_note(fit: ModeFit, time: np.ndarray, value: np.ndarray) -> list[str]:
    """A remark where the log envelope is curved, exp(-sigma t + kappa t^2 / 2), beyond doubt and by much."""
    modes = list(zip(fit.decay_rate.tolist(), fit.angular_frequency.tolist(), strict=True))
    bounds = [((-1.5 * abs(s) - 0.1 * w, 3.0 * abs(s) + 0.1 * w), (0.7 * w, 1.4 * w)) for s, w in modes]
    curved = fit_modes(time, value, modes, bounds, drift=bool(fit.drift_per_s), curved=True)
    if curved is None or abs(curved.curvature) <= _CURVATURE_SIGNIFICANCE * curved.curvature_se:
        return []
    sigma = float(fit.decay_rate[0])
    # Two time constants: what lies later carries too little signal to speak of an envelope.
    change = -curved.curvature * min(float(time[-1] - time[0]), 2.0 / sigma)
    if abs(change) < _CURVATURE_RELEVANCE * sigma:
        return []
    if change > 0.0:
        return ["the envelope falls ever faster, as with dry friction"]
    return ["the envelope falls ever slower, as with quadratic damping or two modes"]


def _unusable(note: str) -> FreeDecayFit:
    nan = float("nan")
    empty = np.zeros(0)
    return FreeDecayFit(
        nan, nan, np.full((2, 2), nan), None, (nan, nan), empty, empty, empty, nan, nan, False, True, note
    )
