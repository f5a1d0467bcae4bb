"""Butterworth filters that run forward and backward over readings, by the Fourier transform.

The gain is that of the digital filter squared, without any delay: with W = tan(pi f dt), g = 1 / (1 + x^(2 n)), where
x = W / W_c for a low-pass, x = (W^2 - W_a W_b) / (W (W_b - W_a)) for a band-pass.  Readings go on beyond both ends as
their image about the last one, so that a line stays a line.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

#: Length of the image at each end, in periods of the lowest edge: so far the other end of the record is felt.
_PERIODS = 6.0


def low_passed(values: np.ndarray, order: int, edge: float) -> np.ndarray:
    """Readings (n,) below `edge`, a part of half the rate."""
    corner = np.tan(0.5 * np.pi * edge)
    return _filtered(values, edge, order, lambda w: w / corner)


def band_passed(values: np.ndarray, order: int, low: float, high: float) -> np.ndarray:
    """Readings (n,) between `low` and `high`, parts of half the rate."""
    a, b = np.tan(0.5 * np.pi * low), np.tan(0.5 * np.pi * high)
    # Zero frequency is far outside any band.
    return _filtered(values, low, order, lambda w: (w * w - a * b) / (np.maximum(w, 1e-9 * a) * (b - a)))


def _filtered(values: np.ndarray, edge: float, order: int, distance: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Readings filtered by a gain that is 1/2 where the distance, a function of W, is 1."""
    pad = min(values.size - 1, int(np.ceil(2.0 * _PERIODS / edge)))
    size = next_fast_len(values.size + 2 * pad, real=True)
    # Half the rate itself is at W = infinity.
    w = np.tan(0.5 * np.pi * np.minimum(2.0 * np.arange(size // 2 + 1) / size, 1.0 - 1e-9))
    spectrum = rfft(np.pad(values, pad, mode="reflect", reflect_type="odd"), size)
    return np.asarray(irfft(spectrum / (1.0 + distance(w) ** (2 * order)), size)[pad : pad + values.size])
