"""Independent emcee ensembles: where they start, how they advance, and how they go on from a checkpoint."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import emcee
import numpy as np

from sysid.arrays import Parameters, ParametersByParameters
from sysid.errors import DataRejectedError
from sysid.posterior.segments import ChainEnd, Segment
from sysid.threads import side_by_side

Density = Callable[[np.ndarray], np.ndarray]

#: Rounds of drawing start points before the density is called nowhere finite.
_START_ROUNDS = 20


class FiniteDensity:
    """A log-density whose values that are not finite are minus infinity, and counted."""

    def __init__(self, density: Density):
        self.density = density
        self.rejected = 0

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Log-densities (n,) of points (n, p)."""
        values = np.asarray(self.density(points), float)
        bad = ~np.isfinite(values)
        self.rejected += int(bad.sum())
        return np.where(bad, -np.inf, values)


class Ensemble:
    """One emcee ensemble and the state that it is in."""

    def __init__(self, density: Density, moves: list[tuple[emcee.moves.Move, float]], state: emcee.State):
        walkers, dimension = state.coords.shape
        self._density = FiniteDensity(density)
        self._sampler = emcee.EnsembleSampler(walkers, dimension, self._density, moves=moves, vectorize=True)
        self._state = state

    def with_moves(self, moves: list[tuple[emcee.moves.Move, float]]) -> Ensemble:
        """The same walkers, to go on by other moves."""
        return Ensemble(self._density.density, moves, self._state)

    def advance(self, steps: int, done: Callable[[], None] = lambda: None) -> tuple[np.ndarray, ...]:
        """Take steps, each followed by a call of `done`: the members of a :class:`Segment` of this ensemble."""
        self._sampler.reset()
        self._density.rejected = 0
        last = self._state
        for state in self._sampler.sample(last, iterations=steps, skip_initial_state_check=True):
            last = state
            done()
        self._state = emcee.State(last.coords, log_prob=last.log_prob, random_state=last.random_state)
        _, key, place, has_gauss, cached = last.random_state
        return (
            self._sampler.get_chain().copy(),
            self._sampler.get_log_prob().copy(),
            self._sampler.backend.accepted.copy(),
            np.array(self._density.rejected),
            np.asarray(key),
            np.array([place, has_gauss, cached], float),
        )


def advance(
    ensembles: Sequence[Ensemble], steps: int, progress: Callable[[float], None] = lambda share: None
) -> Segment:
    """All ensembles by a stretch of steps; two at a time, because Python's part of a step keeps one core waiting.

    Parameters
    ----------
    progress : callback (share of the stretch that is done), after every step of an ensemble.
    """
    taken = itertools.count(1)

    def done() -> None:
        progress(next(taken) / (steps * len(ensembles)))

    results = side_by_side(lambda ensemble: ensemble.advance(steps, done), ensembles, at_most=2)
    return Segment(*(np.stack(members) for members in zip(*results, strict=True)))


def restored(ending: ChainEnd, ensemble: int) -> emcee.State:
    """State of an ensemble at the end of a stretch."""
    place, has_gauss, cached = ending.random_places[ensemble]
    random = ("MT19937", np.array(ending.random_keys[ensemble]), int(place), int(has_gauss), float(cached))
    return emcee.State(
        np.array(ending.positions[ensemble]),
        log_prob=np.array(ending.log_probability[ensemble]),
        random_state=random,
    )


def first(
    density: Density,
    names: Sequence[str],
    centre: Parameters,
    covariance: ParametersByParameters,
    walkers: int,
    seed: np.random.SeedSequence,
) -> emcee.State:
    """Walkers drawn from a Gaussian, redrawn where the density is not finite.

    Raises
    ------
    DataRejectedError
        If the density is finite nowhere, naming the least certain parameter.
    """
    generator = np.random.default_rng(seed)
    factor = np.linalg.cholesky(covariance)
    finite = FiniteDensity(density)
    points, values = np.empty((0, centre.size)), np.empty(0)
    for _ in range(_START_ROUNDS):
        trial = centre + generator.standard_normal((walkers, centre.size)) @ factor.T
        densities = finite(trial)
        points = np.concatenate([points, trial[np.isfinite(densities)]])
        values = np.concatenate([values, densities[np.isfinite(densities)]])
        if points.shape[0] >= walkers:
            break
    else:
        widest = names[int(np.argmax(np.diag(covariance)))]
        raise DataRejectedError(
            f"The posterior has no finite density around the least-squares optimum; parameter {widest} is the least "
            "certain one. Give it a prior in campaign.toml or leave out runs that the fit does not explain."
        )
    random = np.random.RandomState(np.random.MT19937(seed.spawn(1)[0]))
    return emcee.State(points[:walkers], log_prob=values[:walkers], random_state=random.get_state())
