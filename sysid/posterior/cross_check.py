"""The posterior sampled once more by an independent gradient-based sampler, and compared with the ensembles' draws.

The No-U-Turn sampler of nutpie (M. D. Hoffman and A. Gelman, The No-U-Turn Sampler, Journal of Machine Learning
Research 15 (2014)) sees the same log-density and its exact gradient.  It shares neither moves nor code with the
ensembles: where both agree, what is left to doubt is the density.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.arrays import Parameters, ParametersByParameters
from sysid.errors import CampaignError
from sysid.estimation.uncertainty.spread import Spread
from sysid.posterior.diagnostics import effective_draws
from sysid.posterior.inference_data import draw_order, without_arviz_notice
from sysid.progress import Progress, unwatched
from sysid.tabular import Tabular, records_table

if TYPE_CHECKING:
    import pandas as pd

    from sysid.posterior.sampled_posterior import Posterior

#: (p,) -> log-density and its gradient (p,).
Gradient = Callable[[np.ndarray], tuple[float, np.ndarray]]
#: Differences up to so many Monte Carlo errors are chance, with some tens of parameters.
ERRORS = 4.0
CHAINS, TUNING, DRAWS = 2, 150, 250


@dataclass(frozen=True)
class CheckedParameter:
    """One log parameter by both samplers.

    `shift` difference of the means over the ensembles' standard deviation, `shift_error` its Monte Carlo error;
    `sd_ratio` gradient-based over ensembles, `sd_ratio_error` likewise; `effective` draws of the gradient-based one.
    """

    name: str
    shift: float
    shift_error: float
    sd_ratio: float
    sd_ratio_error: float
    effective: float

    @property
    def shift_limit(self) -> float:
        """How far apart the means may be by chance."""
        return ERRORS * self.shift_error

    @property
    def sd_ratio_limit(self) -> float:
        """How far the ratio of standard deviations may be from 1 by chance."""
        return ERRORS * self.sd_ratio_error

    @property
    def agrees(self) -> bool:
        """Whether both samplers differ by no more than chance."""
        return abs(self.shift) <= self.shift_limit and abs(self.sd_ratio - 1.0) <= self.sd_ratio_limit


@dataclass(frozen=True)
class CrossCheck(Tabular):
    """Comparison of two samplers: one entry per parameter, the verdict and a `message` in words."""

    sampler: str
    parameters: tuple[CheckedParameter, ...]
    divergences: int
    message: str

    @property
    def agrees(self) -> bool:
        """Whether all parameters agree."""
        return all(p.agrees for p in self.parameters)

    def summary(self) -> pd.DataFrame:
        """One row per parameter."""
        columns = ("name", "shift", "shift_error", "sd_ratio", "sd_ratio_error", "effective", "agrees")
        return records_table(self.parameters, columns)


def cross_check(
    gradient: Gradient,
    posterior: Posterior,
    centre: Parameters,
    covariance: ParametersByParameters,
    *,
    spread: Spread | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> CrossCheck:
    """Sample by nutpie and compare with a posterior's draws.

    Parameters
    ----------
    gradient : log-density of log parameters (p,) and its gradient.
    posterior : draws of the ensembles, in natural units.
    centre, covariance : Laplace approximation (p,), (p, p) in log space: the sampler's coordinates.
    spread : what the posterior's draws got in addition to the density; it is taken away before.

    Raises
    ------
    CampaignError
        If nutpie is not installed.
    """
    draws, divergences = gradient_draws(gradient, centre, covariance, seed=seed, progress=progress)
    return compared(posterior, draws, divergences, spread)


def compared(posterior: Posterior, draws: np.ndarray, divergences: int = 0, spread: Spread | None = None) -> CrossCheck:
    """Compare draws (chains, n, p) of log parameters with a posterior, without the `spread` that it was given."""
    ensembles, steps, walkers, count = posterior.draws.shape
    logs = np.log(posterior.draws)
    if spread is not None:
        logs = spread.taken_away(logs, posterior.seed, posterior.burn_in)
    ours = logs.reshape(ensembles, -1, count)[:, draw_order(steps, walkers)]
    compared_parameters = []
    for i, name in enumerate(posterior.names):
        pair = draws[..., i], ours[..., i]
        means, sds = [float(x.mean()) for x in pair], [float(x.std(ddof=1)) for x in pair]
        effective = [effective_draws(x) for x in pair]
        # Draws that alternate determine the mean better than the spread, so squares are counted separately.
        squares = [effective_draws((x - m) ** 2) for x, m in zip(pair, means, strict=True)]
        ratio = sds[0] / sds[1]
        compared_parameters.append(
            CheckedParameter(
                name,
                (means[0] - means[1]) / sds[1],
                np.sqrt(sum(1.0 / n for n in effective)),
                ratio,
                ratio * np.sqrt(sum(0.5 / n for n in squares)),
                effective[0],
            )
        )
    parameters = tuple(compared_parameters)
    apart = [p.name for p in parameters if not p.agrees]
    worst = max(parameters, key=lambda p: abs(p.shift))
    figures = (
        f"means within {abs(worst.shift):.2f} sd ({worst.name}), sd ratios {_span(p.sd_ratio for p in parameters)}"
    )
    if apart:
        message = f"The gradient-based sampler disagrees about {', '.join(apart)}: {figures}. Do not use the intervals."
    else:
        message = f"The gradient-based sampler agrees within Monte Carlo error: {figures}."
    if divergences:
        message += f" {divergences} of its trajectories diverged."
    return CrossCheck("NUTS (nutpie)", parameters, divergences, message)


def _span(values: Any) -> str:
    numbers = list(values)
    return f"{min(numbers):.2f} to {max(numbers):.2f}"


def gradient_draws(
    gradient: Gradient,
    centre: Parameters,
    covariance: ParametersByParameters,
    *,
    chains: int = CHAINS,
    tuning: int = TUNING,
    draws: int = DRAWS,
    seed: int = 0,
    progress: Progress | None = None,
) -> tuple[np.ndarray, int]:
    """Draws (chains, draws, p) of nutpie's NUTS, and how many trajectories diverged.

    Raises
    ------
    CampaignError
        If nutpie is not installed.
    """
    try:
        with without_arviz_notice():
            import nutpie
            from nutpie.compiled_pyfunc import from_pyfunc
    except ImportError as error:
        raise CampaignError(
            "The cross-check needs the sampler nutpie: install it with `pip install nutpie`, or leave it out."
        ) from error
    # In these coordinates the posterior is nearly a unit normal: the sampler has little to adapt.
    factor, count = np.linalg.cholesky(covariance), centre.size
    report = progress or unwatched
    calls, expected = 0, 4.0 * chains * (tuning + draws)

    def density(y: np.ndarray) -> tuple[float, np.ndarray]:
        nonlocal calls
        calls += 1
        if calls % 10 == 0:
            report("gradient-based sampler", min(calls / expected, 0.99))
        value, slope = gradient(centre + factor @ y)
        return (value, factor.T @ slope) if np.isfinite(value) else (-np.inf, np.zeros(count))

    model = from_pyfunc(
        count,
        lambda: density,
        lambda *_: lambda y: {"x": np.asarray(y, float)},
        [np.dtype(float)],
        [(count,)],
        ["x"],
        make_initial_point_fn=lambda seed: np.random.default_rng(seed).standard_normal(count),
    )
    trace = nutpie.sample(model, draws=draws, tune=tuning, chains=chains, cores=1, seed=seed + 1, progress_bar=False)
    y = np.asarray(trace.posterior["x"])
    return centre + y @ factor.T, int(np.asarray(trace.sample_stats["diverging"]).sum())
