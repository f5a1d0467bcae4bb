"""Settings of the sampling stage."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SamplingOptions:
    """Settings of the sampling stage.

    `ensembles` independent ensembles of `walkers_per_parameter` walkers per parameter; sampling goes on in stretches of
    `segment_steps` until R-hat < `rhat_limit` and at least `min_effective` effective draws for every parameter, or
    `max_steps`.  `start_inflation` widens the Laplace covariance from which the walkers start.  Independence proposals
    are those of the Laplace approximation. Where the chain has not converged after `adapting_steps` with them, they are
    fitted to its second half, and again at every doubling. Convergence is judged from `min_steps` after the last change
    of the proposals on, and draws before that change are in no posterior that is called converged.

    `importance_draws` about the optimum say whether a chain is needed. With `importance_suffices` they are the
    posterior where their Pareto k is low and `min_effective` of them are effective: no chain is run.
    """

    ensembles: int = 4
    walkers_per_parameter: float = 2.1
    segment_steps: int = 10
    adapting_steps: int = 60
    min_steps: int = 20
    max_steps: int = 1500
    rhat_limit: float = 1.01
    min_effective: float = 400.0
    start_inflation: float = 2.0
    importance_draws: int = 400
    importance_suffices: bool = False
    seed: int = 0
    preview: bool = False
