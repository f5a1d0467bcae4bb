"""Whether a record shows more than viscous damping, and what of it is left to read when the mass sticks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sysid.sdof.decay import PreparedRecord
from sysid.sdof.decay_modes import ModeFit, fit_modes
from sysid.sdof.drop_results import DampingLaw
from sysid.sdof.free_decay import FreeDecayFit
from sysid.sdof.peaks import smoothing_half_width

_SMALLEST_SHARE = 0.10  # of the amplitude lost, by all that is not viscous
_SMALLEST_PART = 0.25  # of the motion after the release that the fitted swings must be
_EVIDENCE = 10.0  # of the information criterion, against two viscous modes
_SECOND_MODE = (0.6, 1.3, 1.8)  # frequency over that of the first at which a search of two body modes begins
_NOISE_ALONE = 1.3  # residual over noise; where both models leave more, the smaller residual is no proof of either
# Decay rates of body modes over the angular frequency. Below, two close modes that beat imitate any envelope.
_BODY_DAMPING = (0.05, 0.6)
_MODES_COEFFICIENTS = 9  # of two modes: rate, frequency, two amplitudes each, and the level


def more_than_viscous(
    law: DampingLaw, record: PreparedRecord, modes: FreeDecayFit, *, neighbours: bool = False
) -> DampingLaw | None:
    """The damping law where the record shows dry friction or quadratic damping beyond doubt, else None.

    Modes of a linear vehicle can look like either over a few swings, so the law must meet three conditions. By a
    Bayesian information criterion of 10, it explains the common readings better than body mode and wheel hop and, on a
    vehicle with `neighbours`, better than two body modes (bounce and pitch) that leave nothing but noise. It loses a
    tenth of the amplitude in another way than viscously. Its evidence is in swings that are a quarter of the motion.
    """
    if not _speaks_for(law, record) or law.terms == ("viscous",) or law.shares[1:].sum() < _SMALLEST_SHARE:
        return None
    value = np.interp(law.time_s, record.time_s, record.value)
    if neighbours and _two_modes_suffice(law, value, record):
        return None
    if not modes.usable:
        return law
    common = (law.time_s >= modes.window_s[0]) & (law.time_s <= modes.window_s[1])
    if int(common.sum()) < law.time_s.size // 2:
        return law
    linear = np.interp(law.time_s[common], modes.time_s, modes.model) - value[common]
    return law if _evidence(law.model[common] - value[common], linear, len(law.terms)) > _EVIDENCE else None


def _evidence(mixed: np.ndarray, linear: np.ndarray, terms: int) -> float:
    """By how much the information criterion of two modes is worse than that of a law, from residuals (n,) of both."""
    gain = mixed.size * np.log(max(float(np.mean(linear**2)), 1e-300) / max(float(np.mean(mixed**2)), 1e-300))
    return float(gain + (_MODES_COEFFICIENTS - 4 - terms) * np.log(mixed.size))


def _two_modes_suffice(law: DampingLaw, value: np.ndarray, record: PreparedRecord) -> bool:
    """Whether two body modes leave no more than noise of the readings (n,) of a law, and explain them as well."""
    two = _two_body_modes(law, value, record.frequency_range_hz)
    if two is None or record.release is None or two.residual_rms > _NOISE_ALONE * record.release.noise_sd:
        return False
    return _evidence(law.model - value, two.residual, len(law.terms)) <= _EVIDENCE


def _two_body_modes(law: DampingLaw, value: np.ndarray, range_hz: tuple[float, float]) -> ModeFit | None:
    """The best fit of two body modes to the readings (n,) of a law, None where none converges."""
    omega = 2.0 * np.pi / law.damped_period
    bounds = (
        (_BODY_DAMPING[0] * omega, _BODY_DAMPING[1] * omega),
        (2.0 * np.pi * range_hz[0], 2.0 * np.pi * range_hz[1]),
    )
    first = (0.1 * omega, omega)
    fits = [fit_modes(law.time_s, value, [first, (0.1 * omega, f * omega)], [bounds, bounds]) for f in _SECOND_MODE]
    return min((fit for fit in fits if fit is not None), key=lambda fit: fit.residual_rms, default=None)


def viscous_alone(law: DampingLaw, record: PreparedRecord) -> bool:
    """Whether the record shows viscous damping and, against every other mixture, nothing else."""
    return _speaks_for(law, record) and law.terms == ("viscous",) and law.evidence > _EVIDENCE


def _speaks_for(law: DampingLaw, record: PreparedRecord) -> bool:
    """Whether the fitted swings are a fair part of the motion after the release."""
    if not law.usable or record.release is None:
        return False
    moving = record.value[record.time_s >= record.release.time_s]
    return float(np.ptp(law.model)) >= _SMALLEST_PART * float(np.ptp(moving))


def without_sticking(record: PreparedRecord, law: DampingLaw) -> PreparedRecord:
    """The record without the extrema that sticking touches: those the smoothing mixes with rest, or within F/k."""
    if record.extrema is None or not np.isfinite(law.stick_time_s):
        return record
    extrema = record.extrema
    moving = law.stick_time_s - smoothing_half_width(record.period_s)
    free = (extrema.time_s < moving) & (np.abs(extrema.value - law.level) > law.friction_m)
    return replace(record, extrema=replace(extrema, used=extrema.used & free))
