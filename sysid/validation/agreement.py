"""Agreement of simulated with measured histories, channel by channel."""

from __future__ import annotations

import numpy as np

from sysid.estimation.fit.fit_result import FitResult
from sysid.estimation.residuals.run_history import RunHistory
from sysid.helper_process import shared_with_helper
from sysid.validation.channel_agreement import ChannelAgreement, Validation, ValidationLimits
from sysid.validation.metrics import dominant_frequency, filled_in, fit_percent, nrmse, peak_error, sprague_geers
from sysid.validation.objective_rating import objective_ratings

#: Above this share of missing or clipped samples a channel gets no objective rating: interpolation would rate itself.
_MOST_MISSING = 0.05
#: Samples of a rated history: the time of a rating grows with their square. At 200 Hz that is 20 s.
_MOST_RATED = 4000


def validate(fit: FitResult, limits: ValidationLimits | None = None) -> Validation:
    """Agreement of every channel of every fitted run, with the limits that it is held against."""
    rows = tuple(row for rows in shared_with_helper(history_agreement, fit.histories) for row in rows)
    return Validation(rows, limits or ValidationLimits())


def _joined(histories: np.ndarray) -> np.ndarray:
    """Histories (C, n) as means of so many neighbours that no more than :data:`_MOST_RATED` samples are left."""
    together = -(-histories.shape[1] // _MOST_RATED)
    if together <= 1:
        return histories
    whole = histories[:, : histories.shape[1] // together * together]
    return np.asarray(whole.reshape(len(histories), -1, together).mean(axis=2))


def history_agreement(history: RunHistory, out_of_sample: bool = False) -> list[ChannelAgreement]:
    """Agreement of every channel of one run that has a reading; `out_of_sample` marks a run that no fit has seen."""
    plain = np.where(history.censored == 0, history.measured, np.nan)
    lost = np.mean(~np.isfinite(plain), axis=1)
    rated = [c for c in range(len(history.columns)) if lost[c] <= _MOST_MISSING]
    # What a gap hides is hidden from both, or the line through it would be rated against the motion.
    seen = np.where(np.isfinite(plain), history.simulated, np.nan)
    pair = (
        _joined(np.array([filled_in(h[c]) for c in rated]).reshape(len(rated), plain.shape[1])) for h in (plain, seen)
    )
    ratings = dict(zip(rated, objective_ratings(*pair), strict=True))
    rows = []
    for c, column in enumerate(history.columns):
        measured, simulated = plain[c], history.simulated[c]
        samples = int(np.isfinite(measured).sum())
        if samples == 0:
            continue
        rating, noise = ratings.get(c), float(history.noise_before_sd[c])
        magnitude, phase = sprague_geers(measured, simulated)
        # The peak of a clipped channel is not known, only that it lies above the limit.
        clipped = bool(np.any(history.censored[c]))
        peak, when = (np.nan, np.nan) if clipped else peak_error(history.time_s, measured, simulated)
        interval = float(history.time_s[1] - history.time_s[0]) if len(history.time_s) > 1 else np.nan
        rows.append(
            ChannelAgreement(
                run=history.file,
                column=column,
                kind=history.kinds[c],
                axle=history.axles[c],
                nrmse=nrmse(measured, simulated),
                residual_over_noise=float(np.sqrt(np.nanmean((measured - simulated) ** 2))) / noise
                if np.isfinite(noise)
                else np.nan,
                samples=samples,
                fit_percent=fit_percent(measured, simulated),
                peak_error=peak,
                peak_time_error_s=when,
                measured_frequency_hz=dominant_frequency(measured, interval),
                simulated_frequency_hz=dominant_frequency(seen[c], interval),
                sprague_geers_magnitude=magnitude,
                sprague_geers_phase=phase,
                iso18571=np.nan if rating is None else rating.overall,
                out_of_sample=out_of_sample,
            )
        )
    return rows
