"""Numbers that say how well one simulated history follows a measured one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sysid.arrays import Samples

#: Zero padding of the spectrum in which the dominant frequency is sought, in lengths of the record.
_PADDING = 8


class SpragueGeers(NamedTuple):
    """Error of magnitude and error of phase, both 0 at best [-]."""

    magnitude: float
    phase: float


class PeakError(NamedTuple):
    """Simulated less measured: largest absolute value over the measured one [-], and the instant of it [s]."""

    relative: float
    time_s: float


def _common(measured: np.ndarray, simulated: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    both = np.isfinite(measured) & np.isfinite(simulated)
    return np.asarray(measured)[both], np.asarray(simulated)[both]


def nrmse(measured: Samples, simulated: Samples) -> float:
    """Normalised error RMS(simulated - measured) / (max - min of measured) over finite samples; NaN without any.

    Parameters
    ----------
    measured, simulated : (n,) in one unit; NaN where missing.
    """
    m, s = _common(measured, simulated)
    span = float(np.ptp(m)) if m.size else 0.0
    return float(np.sqrt(np.mean((s - m) ** 2))) / span if span > 0.0 else float("nan")


def fit_percent(measured: Samples, simulated: Samples) -> float:
    """Fit 100 (1 - |m - s| / |m - mean(m)|) [%] with Euclidean norms over finite samples; NaN for a constant m.

    100 is agreement, 0 no better than the mean, below 0 worse.

    Parameters
    ----------
    measured, simulated : (n,) in one unit; NaN where missing.
    """
    m, s = _common(measured, simulated)
    scale = float(np.linalg.norm(m - m.mean())) if m.size and np.ptp(m) > 0.0 else 0.0
    return 100.0 * (1.0 - float(np.linalg.norm(m - s)) / scale) if scale > 0.0 else float("nan")


def peak_error(time_s: Samples, measured: Samples, simulated: Samples) -> PeakError:
    """Errors of the largest absolute value over finite samples and of its instant; NaN where m is zero throughout.

    Parameters
    ----------
    time_s, measured, simulated : (n,); NaN where missing.
    """
    both = np.isfinite(measured) & np.isfinite(simulated)
    m, s, t = np.abs(measured[both]), np.abs(simulated[both]), time_s[both]
    if not m.size or not np.any(m):
        return PeakError(float("nan"), float("nan"))
    at_m, at_s = int(np.argmax(m)), int(np.argmax(s))
    return PeakError(float(s[at_s] / m[at_m]) - 1.0, float(t[at_s] - t[at_m]))


def sprague_geers(measured: Samples, simulated: Samples) -> SpragueGeers:
    """Magnitude M = sqrt(sum s^2 / sum m^2) - 1 and phase P = arccos(sum m s / sqrt(sum m^2 sum s^2)) / pi.

    Sums run over finite samples; NaN where either history is zero throughout.

    Parameters
    ----------
    measured m, simulated s : (n,) in one unit; NaN where missing.

    References
    ----------
    M. A. Sprague, T. L. Geers, Int. J. Numer. Meth. Engng 60 (2004) 2467-2499, doi:10.1002/nme.1054.
    """
    m, s = _common(measured, simulated)
    mm, ss = float(m @ m), float(s @ s)
    if mm == 0.0 or ss == 0.0:
        return SpragueGeers(float("nan"), float("nan"))
    cosine = float(np.clip(m @ s / np.sqrt(mm * ss), -1.0, 1.0))
    return SpragueGeers(float(np.sqrt(ss / mm)) - 1.0, float(np.arccos(cosine)) / np.pi)


def dominant_frequency(values: Samples, interval_s: float) -> float:
    """Frequency [Hz] of the largest amplitude in the spectrum of a record under a Hann window; NaN if constant.

    The mean is taken off and missing samples are interpolated; the resolution is about 1 / (n `interval_s`).

    Parameters
    ----------
    values : (n,) on uniform samples, NaN where missing.
    interval_s : sample interval [s].
    """
    filled = filled_in(values)
    if filled.size < 3 or np.ptp(filled) == 0.0:
        return float("nan")
    spectrum = np.abs(np.fft.rfft((filled - filled.mean()) * np.hanning(filled.size), _PADDING * filled.size))
    return float(np.argmax(spectrum)) / (_PADDING * filled.size * interval_s)


def filled_in(values: Samples) -> Samples:
    """`values` (n,) with missing samples interpolated between their neighbours; empty where none is finite."""
    known = np.isfinite(values)
    if not known.any():
        return np.zeros(0)
    samples = np.arange(len(values))
    return np.asarray(np.interp(samples, samples[known], values[known]))
