"""What is known of the residuals of a fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.arrays import Channels


@dataclass(frozen=True)
class ResidualEvidence:
    """Residuals before and after the noise model (:mod:`sysid.estimation.weights.autoregression`).

    - `before`, `after` (K, F): power spectra of the residuals and of their innovations over `frequency_hz` (F,), means
    over the channels and runs of each of K `kinds` of sensors; 1 everywhere if white;
    - `order` (n,): of the autoregressive model of every channel in every run;
    - `autocorrelation_before`, `autocorrelation_after` (n, L): at lags `lag_s` (L,);
    - `degrees_of_freedom` (C,): of the tails of every channel in `columns`, infinite for normal ones.
    """

    kinds: tuple[str, ...]
    frequency_hz: np.ndarray
    before: np.ndarray
    after: np.ndarray
    order: np.ndarray
    lag_s: np.ndarray
    autocorrelation_before: np.ndarray
    autocorrelation_after: np.ndarray
    columns: tuple[str, ...]
    degrees_of_freedom: Channels
