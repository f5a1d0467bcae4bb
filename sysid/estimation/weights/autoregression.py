"""Correlation of residuals in time: autocorrelation, autoregressive models of it, and what it does to variances.

An autoregressive model of order p writes a residual as a sum of its p predecessors and an innovation,

    r_t = sum_j phi_j r_{t-j} + e_t,    var e = v,

with the power spectrum f(w) = v / |1 - sum_j phi_j exp(-i w j)|^2, here over the variance of r: white residuals have
f = 1.  Coefficients solve the Yule-Walker equations, for all orders one after the other (J. Durbin, The fitting of
time-series models, Revue de l'Institut International de Statistique 28 (1960), doi:10.2307/1401322); the order is the
one of least n log v + p log n (G. Schwarz, Estimating the dimension of a model, The Annals of Statistics 6 (1978),
doi:10.1214/aos/1176344136).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from sysid.threads import side_by_side

#: Highest order that is tried.
MAX_ORDER = 24
#: Reflection coefficients stay below one in magnitude by this much, so that every model is stationary.
_STATIONARY = 0.9999


@dataclass(frozen=True)
class Autoregression:
    """Autoregressive models of many channels.

    `coefficients` (P, ...) phi, zero beyond a channel's `order` (...); `innovation` (...) variance of the innovations
    over that of the residuals.
    """

    coefficients: np.ndarray
    order: np.ndarray
    innovation: np.ndarray

    def spectrum(self, cycles: np.ndarray) -> np.ndarray:
        """Power (F, ...) over the variance at frequencies (F,) in cycles per sample; its mean over 0 to 0.5 is 1."""
        lags = np.arange(1, self.coefficients.shape[0] + 1)
        turn = np.exp(-2j * np.pi * np.outer(cycles, lags))
        return np.asarray(self.innovation / np.abs(1.0 - np.tensordot(turn, self.coefficients, axes=1)) ** 2)

    def innovations(self, measured: np.ndarray, residual: np.ndarray) -> np.ndarray:
        """Innovations (T, ...) of residuals (T, ...), NaN where one of the predecessors was not `measured`."""
        depth = self.coefficients.shape[0]
        innovation = np.where(measured, residual, np.nan)
        for j, phi in enumerate(self.coefficients, start=1):
            innovation[j:] -= phi * np.where(measured[:-j] | (phi == 0.0), residual[:-j], np.nan)
        innovation[:depth] = np.nan
        return innovation


def autocorrelation(measured: np.ndarray, residual: np.ndarray, lags: int) -> np.ndarray:
    """Autocorrelation (lags, ...) of the residuals (T, ...), samples that were not `measured` left out; lag 0 is 1."""
    mask = measured.astype(float)
    count = np.maximum(mask.sum(axis=0), 1.0)
    centred = mask * (residual - (mask * residual).sum(axis=0) / count)
    length = next_fast_len(2 * mask.shape[0], real=True)
    pairs = irfft(np.abs(rfft(mask, length, axis=0)) ** 2, length, axis=0)[:lags]
    products = irfft(np.abs(rfft(centred, length, axis=0)) ** 2, length, axis=0)[:lags]
    covariance = products / np.maximum(pairs, 1.0)
    return np.asarray(covariance / np.maximum(covariance[:1], 1e-300))


def bridged(measured: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Residuals (T, ...) without their mean, with straight lines over short gaps and zeros elsewhere.

    The products of a sequence that has values everywhere are an autocorrelation of something, whatever its gaps; pairs
    of measured samples alone need not be. Short gaps are those that a model of the highest order reaches over. Zeros
    add no product to any lag: a record that begins late or ends early has the autocorrelation of its measured part.
    """
    time, filled = np.arange(residual.shape[0]), np.zeros(residual.shape)
    for index in np.ndindex(residual.shape[1:]):
        place = (slice(None), *index)
        known = np.flatnonzero(measured[place])
        if not known.size:
            continue
        values = residual[place][known]
        filled[place] = np.interp(time, known, values - values.mean(), left=0.0, right=0.0)
        for last in np.flatnonzero(np.diff(known) > MAX_ORDER):
            filled[(slice(known[last] + 1, known[last + 1]), *index)] = 0.0
    return filled


def fitted_autoregression(measured: np.ndarray, residual: np.ndarray, lags: int) -> Autoregression:
    """Autoregressive models of residuals (T, ...), short gaps bridged, by :func:`autoregression`."""
    full = bridged(measured, residual)
    everywhere = np.ones(residual.shape, bool)
    # Products over their full number fall off with the lag: so they stay positive definite.
    taper = (1.0 - np.arange(lags) / residual.shape[0]).reshape(-1, *[1] * (residual.ndim - 1))
    return autoregression(autocorrelation(everywhere, full, lags) * taper, measured.sum(axis=0))


def autoregression(correlation: np.ndarray, count: np.ndarray, max_order: int = MAX_ORDER) -> Autoregression:
    """Autoregressive models of channels, each of the order that its residuals support.

    Parameters
    ----------
    correlation : (lags, ...) positive definite autocorrelation, lag 0 first; orders stay below the number of lags.
    count : (...) number of residuals behind it.
    """
    orders = max(min(max_order, correlation.shape[0] - 1), 0)
    shape, n = correlation.shape[1:], np.maximum(count, 2)
    phi, best = np.zeros((orders, *shape)), np.zeros((orders, *shape))
    left, sound = np.ones(shape), np.ones(shape, bool)
    least, order, innovation = np.zeros(shape), np.zeros(shape, int), np.ones(shape)
    for p in range(1, orders + 1):
        past = phi[: p - 1]
        reflection = (correlation[p] - (past * correlation[p - 1 : 0 : -1]).sum(axis=0)) / left
        # Rounding of nearly deterministic sequences; beyond 1 there is no stationary process.
        reflection = np.clip(reflection, -_STATIONARY, _STATIONARY)
        phi[: p - 1] = past - reflection * past[::-1]
        phi[p - 1] = reflection
        left = left * (1.0 - reflection**2)
        # If a sequence is practically known from its past, higher orders only fit rounding errors.
        sound &= np.abs(reflection) < _STATIONARY
        criterion = n * np.log(left) + p * np.log(n)
        better = sound & (criterion < least)
        least, order = np.where(better, criterion, least), np.where(better, p, order)
        innovation, best = np.where(better, left, innovation), np.where(better, phi, best)
    return Autoregression(best, order, innovation)


def variance_inflation(models: Autoregression, sensitivity: np.ndarray) -> np.ndarray:
    """Factor (...) by which correlation inflates the variance of the residuals' scores; at least 1.

    The score J' r of a column J has the variance J' R J against J' J for white residuals, R their correlation. In the
    frequency domain that is the mean of the residuals' spectrum f weighted by the power |J(w)|^2 of the column: slow
    residuals do not reduce the information of fast motion. A channel has one factor: the mean over the parameters of
    their factors. Each is weighted by the information of the channel about the parameter over the average of that over
    channels. The largest of them would change with every parameter about which a channel begins to have information. On
    a truck with nonlinear dampers, the weights of two searches that ended in the same place differed by factors of 30,
    and the optima by standard deviations.

    Parameters
    ----------
    sensitivity : (T, ..., p) derivatives of the residuals by the parameters.
    """
    # Transforms of a prime number of samples take six times as long as those of the next number of small factors.
    length = next_fast_len(sensitivity.shape[0], real=True)
    spectrum = models.spectrum(np.fft.rfftfreq(length))
    total, weighted = np.empty(sensitivity.shape[1:]), np.empty(sensitivity.shape[1:])

    # Record by record: transforms of all of them take more memory than the derivatives.
    def add(at: tuple[int, ...]) -> None:
        record: tuple[Any, ...] = (slice(None), *at)
        transform = rfft(sensitivity[record], length, axis=0)
        power = transform.real**2 + transform.imag**2
        total[at], weighted[at] = power.sum(axis=0), spectrum[record] @ power

    side_by_side(add, np.ndindex(total.shape[:-1]))
    inflation = np.maximum(weighted / np.where(total > 0.0, total, 1.0), 1.0)
    mean = total.mean(axis=tuple(range(total.ndim - 1)))
    share = total / np.where(mean > 0.0, mean, 1.0)
    whole = share.sum(axis=-1)
    return np.asarray(np.where(whole > 0.0, (share * inflation).sum(axis=-1) / np.where(whole > 0.0, whole, 1.0), 1.0))
