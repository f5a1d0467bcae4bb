"""Convergence over independent ensembles: autocorrelation time, effective draws, rank-normalised R-hat."""

from __future__ import annotations

from dataclasses import dataclass

import emcee
import numpy as np
from arviz_stats.base import array_stats

from sysid.posterior.results import PosteriorSummary


@dataclass(frozen=True)
class Diagnosis:
    """State of a run: `burn_in` steps to drop, `autocorrelation_time`, `ess`, `rhat` (p,)."""

    burn_in: int
    autocorrelation_time: np.ndarray
    ess: np.ndarray
    rhat: np.ndarray


def diagnose(draws: np.ndarray) -> Diagnosis:
    """Judge draws (E, steps, W, p).

    tau is averaged over the ensembles, burn-in is five times the largest tau but at most half of the run, effective
    draws are E W (steps - burn-in) / tau, and R-hat (A. Vehtari et al., Rank-normalization, folding, and localization,
    Bayesian Analysis 16 (2021), doi:10.1214/20-BA1221) compares ensembles, never the dependent walkers of one.
    """
    ensembles, steps, walkers, count = draws.shape
    tau = _autocorrelation_time(draws)
    burn_in = int(min(steps // 2, np.ceil(5.0 * tau.max())))
    kept = draws[:, burn_in:]
    tau = _autocorrelation_time(kept)
    ess = ensembles * walkers * kept.shape[1] / tau
    flat = kept.reshape(ensembles, -1, count)
    rhat = np.array([float(array_stats.rhat(flat[..., i], chain_axis=0, draw_axis=1)) for i in range(count)])
    return Diagnosis(burn_in, tau, ess, rhat)


def _autocorrelation_time(draws: np.ndarray) -> np.ndarray:
    # A walker that never moved has no autocorrelation; its ensemble then counts as one long correlation.
    with np.errstate(divide="ignore", invalid="ignore"):
        times = [emcee.autocorr.integrated_time(chain, c=5, tol=0, quiet=True) for chain in draws]
    return np.maximum(np.nan_to_num(np.mean(times, axis=0), nan=float(draws.shape[1])), 1.0)


def summarise(names: tuple[str, ...], natural_draws: np.ndarray, diagnosis: Diagnosis) -> tuple[PosteriorSummary, ...]:
    """Marginal summaries of draws (n, p) in natural units."""
    q05, q50, q95 = np.quantile(natural_draws, [0.05, 0.5, 0.95], axis=0)
    mean, sd = natural_draws.mean(axis=0), natural_draws.std(axis=0, ddof=1)
    return tuple(
        PosteriorSummary(
            name,
            *(float(v[i]) for v in (mean, sd, q05, q50, q95, diagnosis.ess, diagnosis.rhat)),
        )
        for i, name in enumerate(names)
    )
