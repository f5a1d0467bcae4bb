"""Residuals of a decay that are correlated in time, and the same made white."""

from __future__ import annotations

import numpy as np

_AR_ORDER = 2  # a damped oscillation, such as the wheel hop, is one of order 2


def autoregression(residual: np.ndarray, first_of_run: np.ndarray) -> np.ndarray:
    """Coefficients (2,) of an autoregression of the residual (m,) by least squares, none where it shows none.

    After a fit, the remaining white noise has a negative correlation over long times. Whitening by that would make the
    fit seem more certain than it is.

    Parameters
    ----------
    first_of_run : (m,) whether a reading is the first after a gap.
    """
    rows = _history(first_of_run)
    past = np.stack([residual[rows - lag] for lag in range(1, _AR_ORDER + 1)], axis=1)
    coefficients = np.linalg.lstsq(past, residual[rows], rcond=None)[0]
    before = float(np.mean(residual[rows] ** 2))
    after = float(np.mean((residual[rows] - past @ coefficients) ** 2))
    gain = rows.size * np.log(max(before, 1e-300) / max(after, 1e-300)) - _AR_ORDER * np.log(rows.size)
    slow = after / max((1.0 - float(coefficients.sum())) ** 2, 1e-6)
    return coefficients if gain > 0.0 and slow > before else np.zeros(0)


def _history(first_of_run: np.ndarray) -> np.ndarray:
    """Readings with as many others before them, without a gap, as the autoregression needs."""
    run = np.cumsum(first_of_run)
    rows = np.arange(_AR_ORDER, run.size)
    return np.asarray(rows[run[rows] == run[rows - _AR_ORDER]])


def whiten(value: np.ndarray, coefficients: np.ndarray, first_of_run: np.ndarray) -> np.ndarray:
    """The part that the autoregression does not predict from the readings before: rows of (m,) or (m, p) values."""
    if coefficients.size == 0:
        return value
    rows = _history(first_of_run)
    return np.asarray(value[rows] - sum(c * value[rows - lag - 1] for lag, c in enumerate(coefficients)))
