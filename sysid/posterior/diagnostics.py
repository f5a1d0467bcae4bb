"""Convergence over independent ensembles: autocorrelation time, effective draws, rank-normalised R-hat."""

from __future__ import annotations

from dataclasses import dataclass

import emcee
import numpy as np
from arviz_stats.base import array_stats  # type: ignore[attr-defined]  # its way of naming what is public

from sysid.arrays import DrawsByParameters, EnsemblesByStepsByWalkers, Parameters, WalkerDraws
from sysid.posterior.inference_data import draw_order
from sysid.posterior.sampled_posterior import PosteriorSummary

#: Draws of one ensemble that R-hat looks at; a longer chain is thinned evenly.
_RANKED = 50_000
#: Autocorrelation is summed up to so many times its own sum.
_WINDOW = 5
#: Standstills shorter than this many steps are never remarked on.
_SHORT_STANDSTILL = 30
#: A standstill is remarked on if fewer than this many of its length are expected by chance in the whole run.
_CHANCE = 1e-3


@dataclass(frozen=True)
class Diagnosis:
    """State of a run: `burn_in` steps to drop, `autocorrelation_time`, `ess`, `rhat` (p,).

    `density_rhat` is the R-hat of the log-density: ensembles that all still climb agree with each other in every
    parameter, and show it there.
    """

    burn_in: int
    autocorrelation_time: Parameters
    ess: Parameters
    rhat: Parameters
    density_rhat: float = 1.0

    @property
    def worst_rhat(self) -> float:
        """The largest R-hat, that of the log-density included."""
        return max(float(self.rhat.max()), self.density_rhat)


def diagnose(
    draws: WalkerDraws,
    least_burn_in: int = 0,
    log_probability: EnsemblesByStepsByWalkers | None = None,
    *,
    near: bool = False,
) -> Diagnosis:
    """Judge draws (E, steps, W, p) and, where it is given, their log-density (E, steps, W).

    tau is averaged over the ensembles. Burn-in is five times the largest tau of the steps behind `least_burn_in`, at
    most half of the run, or a quarter where the posterior is `near` to the normal distribution from which the walkers
    start, and at least `least_burn_in` if that leaves a fifth of the run. Effective draws (bulk) and R-hat are those of
    A. Vehtari et al., Rank-normalization, folding, and localization, Bayesian Analysis 16 (2021),
    doi:10.1214/20-BA1221, with ensembles as chains, never the dependent walkers of one ensemble, in the order of
    ``posterior.nc``. tau of a short run is not used to count draws: there the walkers are each taken about their own
    mean, and tau is too small.
    """
    steps = draws.shape[1]
    least = least_burn_in if 5 * least_burn_in <= 4 * steps else steps // 2
    tau = _autocorrelation_time(draws[:, least:])
    burn_in = int(max(least, min(steps // (4 if near else 2), np.ceil(5.0 * tau.max()))))
    kept = draws[:, burn_in:]
    if burn_in != least:
        tau = _autocorrelation_time(kept)
    ensembles, _, walkers, count = kept.shape
    chains = kept.reshape(ensembles, -1, count)[:, draw_order(kept.shape[1], walkers)]
    ess = np.array([effective_draws(chains[..., i]) for i in range(count)])
    rhat = np.array([_rhat(kept[..., i]) for i in range(count)])
    density = np.zeros(1) if log_probability is None else log_probability[:, burn_in:]
    # A density that is the same everywhere has no R-hat.
    return Diagnosis(burn_in, tau, ess, rhat, 1.0 if np.ptp(density) == 0.0 else _rhat(density))


def _rhat(values: EnsemblesByStepsByWalkers) -> float:
    """R-hat of one quantity (E, n, W)."""
    # Ranks of millions of draws take seconds and say no more than those of some ten thousand.
    thin = -(-values.shape[1] * values.shape[2] // _RANKED)
    return float(array_stats.rhat(values[:, ::thin].reshape(len(values), -1), chain_axis=0, draw_axis=1))


def effective_draws(chains: np.ndarray) -> float:
    """Bulk effective draws of one quantity from draws (chains, n)."""
    # Draws that never move are one draw per chain.
    if np.ptp(chains, axis=1).min() == 0.0:
        return float(len(chains))
    return float(array_stats.ess(chains, chain_axis=0, draw_axis=1, method="bulk"))


def _autocorrelation_time(draws: WalkerDraws) -> np.ndarray:
    # A walker that never moved has no autocorrelation; its ensemble then counts as one long correlation.
    with np.errstate(divide="ignore", invalid="ignore"):
        times = [[_integrated_time(chain[..., i].T) for i in range(chain.shape[-1])] for chain in draws]
    return np.asarray(np.maximum(np.nan_to_num(np.mean(times, axis=0), nan=float(draws.shape[1])), 1.0))


def _integrated_time(chains: np.ndarray) -> float:
    """As :func:`emcee.autocorr.integrated_time` of one quantity (W, n), which takes walker after walker."""
    chains = np.ascontiguousarray(chains)
    steps = chains.shape[1]
    padded = 2 * emcee.autocorr.next_pow_two(steps)
    transformed = np.fft.rfft(chains - chains.mean(axis=1, keepdims=True), padded)
    correlation = np.fft.irfft(np.abs(transformed) ** 2, padded)[:, :steps]
    times = 2.0 * np.cumsum(np.mean(correlation / correlation[:, :1], axis=0)) - 1.0
    return float(times[emcee.autocorr.auto_window(times, _WINDOW)])


def standstills(draws: WalkerDraws, burn_in: int) -> np.ndarray:
    """Longest standstill [steps] of every walker (E, W) that lasts into the kept steps; 0 where chance explains it.

    With the median share a of moves over all walkers, n steps without a move are expected about E W steps (1 - a/2)^n
    times; half of the median leaves room for walkers in the tails.
    """
    moved = draws[:, 1:, :, 0] != draws[:, :-1, :, 0]
    ensembles, steps, walkers = moved.shape
    if steps == 0:
        return np.zeros((ensembles, walkers), int)
    share = 0.5 * float(np.median(moved.mean(axis=1)))
    still, longest = np.zeros((ensembles, walkers), int), np.zeros((ensembles, walkers), int)
    for step in range(steps):
        still = np.where(moved[:, step], 0, still + 1)
        if step + 1 >= burn_in:
            longest = np.maximum(longest, still)
    by_chance = np.log(_CHANCE / (ensembles * walkers * steps)) / np.log1p(-share) if share > 0.0 else 0.0
    return np.where(longest > max(by_chance, _SHORT_STANDSTILL), longest, 0)


def summarise(
    names: tuple[str, ...], natural_draws: DrawsByParameters, diagnosis: Diagnosis
) -> tuple[PosteriorSummary, ...]:
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
