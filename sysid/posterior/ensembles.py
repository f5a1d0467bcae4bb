"""Independent emcee ensembles: where they start, how they advance, and how they go on from a checkpoint."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from threading import Barrier, BrokenBarrierError
from typing import TypeVar

import emcee
import numpy as np

from sysid.arrays import Parameters, ParametersByParameters
from sysid.errors import DataRejectedError
from sysid.posterior.segments import ChainEnd, Segment
from sysid.threads import in_threads_of_their_own

Density = Callable[[np.ndarray], np.ndarray]

_Result = TypeVar("_Result")

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


class Together:
    """A density for several ensembles, each in a thread of its own: computed once for what all of them ask next.

    The more points there are at a time, the less a point costs.
    """

    def __init__(self, density: Density, members: int):
        self._density = density
        self._asked: list[np.ndarray | None] = [None] * members
        self._answers: list[np.ndarray] = []
        self._over = False
        self._failure: BaseException | None = None
        self._barrier = Barrier(members, self._compute)

    def serve(self, member: int, work: Callable[[Density], _Result]) -> _Result:
        """The result of some work with the density, done by one member while the others do theirs.

        Raises
        ------
        Whatever the density or the work of any member raises.
        """

        def density(points: np.ndarray) -> np.ndarray:
            self._asked[member] = points
            self._barrier.wait()
            return self._answers[member]

        try:
            result = work(density)
            self._asked[member] = None
            # Until all are done: the others wait for everyone.
            while not self._over:
                self._barrier.wait()
        except BrokenBarrierError:
            raise (self._failure or KeyboardInterrupt) from None
        except BaseException as error:
            self._failure = self._failure or error
            raise
        finally:
            if not self._over:
                self._barrier.abort()
        return result

    def stop(self) -> None:
        """Let nobody wait any longer."""
        self._barrier.abort()

    def _compute(self) -> None:
        """Answer everyone, in the one thread that came last."""
        asked = [(m, points) for m, points in enumerate(self._asked) if points is not None]
        if not asked:
            self._over = True
            return
        try:
            values = self._density(np.concatenate([points for _, points in asked]))
        except BaseException as error:
            self._failure = error
            raise
        parts = np.split(values, np.cumsum([len(points) for _, points in asked])[:-1])
        answers = dict(zip([m for m, _ in asked], parts, strict=True))
        self._answers = [answers.get(m, np.empty(0)) for m in range(len(self._asked))]


class Ensemble:
    """One emcee ensemble: its moves, which keep a step size, and the state that it is in."""

    def __init__(self, moves: list[tuple[emcee.moves.Move, float]], state: emcee.State):
        self._moves, self._state = moves, state

    def with_moves(self, moves: list[tuple[emcee.moves.Move, float]]) -> Ensemble:
        """The same walkers, to go on by other moves."""
        return Ensemble(moves, self._state)

    def advance(self, density: Density, steps: int, done: Callable[[], None] = lambda: None) -> tuple[np.ndarray, ...]:
        """Take steps, each followed by a call of `done`: the members of a :class:`Segment` of this ensemble."""
        finite, last = FiniteDensity(density), self._state
        sampler = emcee.EnsembleSampler(*last.coords.shape, finite, moves=self._moves, vectorize=True)
        for state in sampler.sample(last, iterations=steps, skip_initial_state_check=True):
            last = state
            done()
        self._state = emcee.State(last.coords, log_prob=last.log_prob, random_state=last.random_state)
        _, key, place, has_gauss, cached = last.random_state
        return (
            sampler.get_chain().copy(),
            sampler.get_log_prob().copy(),
            sampler.backend.accepted.copy(),
            np.array(finite.rejected),
            np.asarray(key),
            np.array([place, has_gauss, cached], float),
        )


def advance(
    density: Density,
    ensembles: Sequence[Ensemble],
    steps: int,
    progress: Callable[[float], None] = lambda share: None,
) -> Segment:
    """All ensembles by a stretch of steps, their proposals computed together.

    Parameters
    ----------
    progress : callback (share of the stretch that is done), after every step of an ensemble.
    """
    taken, together = itertools.count(1), Together(density, len(ensembles))

    def done() -> None:
        progress(next(taken) / (steps * len(ensembles)))

    def stretch(member: int) -> tuple[np.ndarray, ...]:
        return together.serve(member, lambda density: ensembles[member].advance(density, steps, done))

    results = in_threads_of_their_own(stretch, range(len(ensembles)), together.stop)
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
