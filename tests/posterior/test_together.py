"""Ensembles that ask one density at the same time: what they are told, how often it is computed, and how they end."""

from __future__ import annotations

import threading

import emcee
import numpy as np
import pytest

from sysid.errors import NumericsError
from sysid.posterior.ensembles import Ensemble, Together, advance
from sysid.posterior.moves import posterior_moves
from sysid.threads import in_threads_of_their_own

WALKERS, COUNT = 8, 3


class Gaussian:
    """A standard normal density that remembers how many points it was asked for at a time."""

    def __init__(self):
        self.asked: list[int] = []

    def __call__(self, points: np.ndarray) -> np.ndarray:
        self.asked.append(len(points))
        return -0.5 * (points**2).sum(axis=1)


def ensembles(count: int, moves=lambda: posterior_moves(np.zeros(COUNT), np.eye(COUNT))) -> list[Ensemble]:
    """Ensembles that start apart."""
    random = np.random.default_rng(1)
    starts = [random.standard_normal((WALKERS, COUNT)) for _ in range(count)]
    states = [
        emcee.State(x, log_prob=-0.5 * (x**2).sum(axis=1), random_state=np.random.RandomState(k).get_state())
        for k, x in enumerate(starts)
    ]
    return [Ensemble(moves(), state) for state in states]


def test_each_ensemble_moves_as_it_would_alone():
    density = Gaussian()
    together = advance(density, ensembles(3), 12)
    for k in range(3):
        alone = ensembles(3)[k].advance(Gaussian(), 12)
        assert np.array_equal(together.draws[k], alone[0])
        assert np.array_equal(together.log_probability[k], alone[1])
    # All walkers at once, or half of each ensemble: never one ensemble after the other.
    assert set(density.asked) == {3 * WALKERS, 3 * WALKERS // 2}


def test_ensembles_whose_moves_differ_wait_for_each_other_to_the_end():
    density = Gaussian()
    mixed = ensembles(3, lambda: [(emcee.moves.StretchMove(), 0.5), (emcee.moves.WalkMove(), 0.5)])
    mixed[1] = mixed[1].with_moves([(posterior_moves(np.zeros(COUNT), np.eye(COUNT))[0][0].moves[0][0], 1.0)])
    segment = advance(density, mixed, 20)
    assert segment.draws.shape == (3, 20, WALKERS, COUNT)
    # One asks once per step, the others twice: it is done before them.
    assert min(density.asked) < max(density.asked)


def test_the_error_of_a_density_is_the_error_of_all():
    def fails(points: np.ndarray) -> np.ndarray:
        raise NumericsError("no number")

    before = threading.active_count()
    with pytest.raises(NumericsError, match="no number"):
        advance(fails, ensembles(4), 5)
    assert threading.active_count() == before


def test_an_ensemble_that_fails_ends_the_others():
    class Fails(emcee.moves.Move):
        def propose(self, model, state):
            raise NumericsError("of one")

    some = ensembles(3)
    some[2] = some[2].with_moves([(Fails(), 1.0)])
    with pytest.raises(NumericsError, match="of one"):
        advance(Gaussian(), some, 5)


def test_an_interrupted_call_lets_nobody_wait():
    together = Together(Gaussian(), 2)
    ended = threading.Event()

    def work(member: int) -> None:
        try:
            # The second never asks, so that the first would wait for ever.
            together.serve(member, lambda density: density(np.zeros((1, COUNT))) if member == 0 else interrupt())
        finally:
            ended.set()

    def interrupt() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        in_threads_of_their_own(work, range(2), together.stop)
    assert ended.wait(5.0)
