"""What the product computes, as contenders: likelihoods, simulations, Jacobians, posterior steps."""

from __future__ import annotations

from collections.abc import Callable

import emcee
import numpy as np

from benchmarks.bare_kernel import BareKernel
from benchmarks.rounds import Contender, Sample, timed
from benchmarks.work import Work, density, engine
from sysid.estimation.residuals.linearisation import linearise
from sysid.estimation.residuals.signals import simulate_runs
from sysid.posterior.log_density import LogDensity
from sysid.posterior.moves import posterior_moves

BATCHES = (1, 16, 64, 256)
#: The JAX engine takes part in every so many rounds.
JAX_EVERY = 3
POSTERIOR_STEPS = 4


def likelihoods(work: Work, ours: LogDensity, name: str, batches: tuple[int, ...], every: int) -> list[Contender]:
    """Batched likelihoods by one engine, compiled; per set."""
    found = []
    for sets in batches:
        points = work.sets(sets)
        ours(points)
        call: Callable[[], object] = lambda points=points: ours(points)  # noqa: E731
        found.append(Contender(f"{name} {sets}", timed(call, repeats(sets, name)), sets, every))
    return found


def repeats(sets: int, name: str) -> int:
    """So many calls make a measurement of some tens of milliseconds."""
    return max(1, 16 // sets) if name == "native" else 1


def bare(program: BareKernel, batches: tuple[int, ...]) -> list[Contender]:
    """The same likelihoods by the bare kernel; per set."""

    def measure(batch: int, sets: int) -> Callable[[], Sample]:
        return lambda: program.measure(batch, repeats(sets, "native"))[0]

    return [Contender(f"kernel {sets}", measure(k, sets), sets) for k, sets in enumerate(batches)]


def simulation(work: Work, name: str, every: int = 1) -> Contender:
    """One simulation of one parameter set: filtered signals of all runs."""
    return _in_engine(f"{name} simulation", name, every, 4 if name == "native" else 1)(
        lambda: simulate_runs(work.model, work.state.point.log_parameters, work.state.point.motion)
    )


def jacobian(work: Work, name: str, every: int = 1) -> Contender:
    """All residuals with their derivatives by all global parameters, speeds and starts."""
    point = work.state.point
    return _in_engine(f"{name} Jacobian", name, every, 1)(
        lambda: linearise(work.model, point.weights, point.log_parameters, point.motion)
    )


def posterior(work: Work, ours: LogDensity) -> Contender:
    """Steps of one ensemble of the posterior stage; per step of all walkers."""
    count = work.state.point.log_parameters.size
    walkers = 2 * int(np.ceil(2.1 * count / 2))
    covariance = 1e-6 * np.eye(count)
    sampler = emcee.EnsembleSampler(
        walkers, count, ours, moves=posterior_moves(work.state.point.log_parameters, covariance), vectorize=True
    )
    start = work.state.point.log_parameters + 1e-3 * np.random.default_rng(3).standard_normal((walkers, count))
    state = sampler.run_mcmc(start, 1)
    return Contender("native posterior step", timed(lambda: sampler.run_mcmc(state, POSTERIOR_STEPS)), POSTERIOR_STEPS)


def product_density(work: Work, name: str) -> LogDensity:
    """The product's log-density by one engine."""
    return density(work, name)


def _in_engine(label: str, name: str, every: int, count: int) -> Callable[[Callable[[], object]], Contender]:
    def make(call: Callable[[], object]) -> Contender:
        def inside() -> None:
            with engine(name):
                call()

        inside()
        return Contender(label, timed(inside, count), every=every)

    return make
