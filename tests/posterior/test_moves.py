"""Every offered move leaves a correlated Gaussian in ten dimensions as it is; a broken move does not."""

from __future__ import annotations

import time
from importlib.metadata import version
from pathlib import Path

import emcee
import numpy as np
import pytest
from scipy.stats import multivariate_t

from sysid.posterior import sampling
from sysid.posterior.diagnostics import diagnose
from sysid.posterior.moves import LaplaceMove, MoveInCommon, fitted_to_walkers, posterior_moves
from sysid.posterior.options import SamplingOptions
from sysid.posterior.sampling import sample_posterior

DIMENSION, WALKERS, SEED = 10, 600, 7
CENTRE = np.linspace(-3.0, 6.0, DIMENSION)


def covariance() -> np.ndarray:
    """Correlations up to 0.9 and standard deviations from 0.05 to 5."""
    random = np.random.default_rng(1)
    factor = random.normal(size=(DIMENSION, 3))
    full = factor @ factor.T + 0.4 * np.eye(DIMENSION)
    sd = np.sqrt(np.diag(full))
    scale = np.geomspace(0.05, 5.0, DIMENSION)
    return full / np.outer(sd, sd) * np.outer(scale, scale)


COVARIANCE = covariance()
FACTOR = np.linalg.cholesky(COVARIANCE)
WHITEN = np.linalg.inv(FACTOR)


def density(points: np.ndarray) -> np.ndarray:
    return -0.5 * (((points - CENTRE) @ WHITEN.T) ** 2).sum(axis=1)


def whitened(moves, steps: int) -> np.ndarray:
    """Draws (n, 10) of the moves from an exact start, in coordinates in which the target is standard normal."""
    random = np.random.RandomState(SEED)
    start = CENTRE + random.standard_normal((WALKERS, DIMENSION)) @ FACTOR.T
    sampler = emcee.EnsembleSampler(WALKERS, DIMENSION, density, moves=moves, vectorize=True)
    sampler.run_mcmc(emcee.State(start, random_state=random.get_state()), steps, skip_initial_state_check=True)
    draws = sampler.get_chain()[steps // 4 :].reshape(-1, DIMENSION)
    return (draws - CENTRE) @ WHITEN.T


def unbiased(draws: np.ndarray) -> bool:
    """The check of this file: every standard deviation within 3 %, every mean within a tenth."""
    sd, mean = draws.std(axis=0), draws.mean(axis=0)
    return bool(np.all((sd > 0.97) & (sd < 1.03)) and np.all(np.abs(mean) < 0.1))


MOVES = {
    "laplace": ([(LaplaceMove(CENTRE, COVARIANCE), 1.0)], 400),
    "laplace of a wrong shape": ([(LaplaceMove(CENTRE + 0.2 * FACTOR[:, 0], 1.5 * COVARIANCE), 1.0)], 900),
    "differential evolution": ([(emcee.moves.DEMove(), 1.0)], 1800),
    "stretch": ([(emcee.moves.StretchMove(), 1.0)], 2600),
    "mix": (posterior_moves(CENTRE, COVARIANCE), 600),
}


@pytest.mark.parametrize("name", MOVES)
def test_every_offered_move_keeps_a_gaussian(name: str):
    moves, steps = MOVES[name]
    draws = whitened(moves, steps)
    assert unbiased(draws), (draws.std(axis=0), draws.mean(axis=0))


def test_the_mix_is_made_of_the_moves_tested_here():
    ((mix, weight),) = posterior_moves(CENTRE, COVARIANCE)
    assert (weight, sum(share for _, share in mix.moves)) == (1.0, pytest.approx(1.0))
    assert {type(move) for move, _ in mix.moves} == {LaplaceMove, emcee.moves.DEMove, emcee.moves.StretchMove}


class Counts(emcee.moves.Move):
    """Says which of several it is, and leaves the walkers where they are."""

    def __init__(self, number: int, said: list[int]):
        self.number, self.said = number, said

    def propose(self, model, state):
        self.said.append(self.number)
        return state, np.zeros(len(state.coords), bool)


def chosen(seed: int, step: int, steps: int) -> list[int]:
    """Numbers of the moves of some steps."""
    said: list[int] = []
    mix = MoveInCommon([(Counts(k, said), share) for k, share in enumerate((0.7, 0.2, 0.1))], seed, step)
    state = emcee.State(np.zeros((4, 2)))
    for _ in range(steps):
        mix.propose(None, state)
    return said


def test_all_ensembles_take_the_same_move_at_a_step():
    said = chosen(3, 0, 4000)
    assert said == chosen(3, 0, 4000) != chosen(4, 0, 4000)
    assert np.bincount(said) / 4000 == pytest.approx([0.7, 0.2, 0.1], abs=0.03)


def test_a_chain_that_goes_on_takes_the_moves_that_it_would_have_taken():
    assert chosen(3, 0, 60) == chosen(3, 0, 20) + chosen(3, 20, 40) != chosen(3, 0, 20) + chosen(3, 0, 40)


class WithoutHastings(LaplaceMove):
    """The independence move as it must not be: proposals are weighed as if they were symmetric."""

    def _propose(self, coordinates, random):
        proposal, factor = super()._propose(coordinates, random)
        return proposal, 0.0 * factor


def test_a_move_without_its_hastings_factor_is_caught():
    assert not unbiased(whitened([(WithoutHastings(CENTRE, 1.5 * COVARIANCE), 1.0)], 300))


@pytest.mark.skipif(version("emcee") != "3.1.6", reason="the fault is that of this release")
def test_the_snooker_move_is_caught():
    assert not unbiased(whitened([(emcee.moves.DEMove(), 0.5), (emcee.moves.DESnookerMove(), 0.5)], 300))


def test_the_hastings_factor_is_the_ratio_of_multivariate_t_densities():
    move = LaplaceMove(CENTRE, COVARIANCE, degrees_of_freedom=5.0)
    random = np.random.RandomState(3)
    points = CENTRE + random.standard_normal((50, DIMENSION)) @ FACTOR.T
    proposal, factor = move.get_proposal(points, random)
    exact = multivariate_t(CENTRE, COVARIANCE, df=5.0)
    np.testing.assert_allclose(factor, exact.logpdf(points) - exact.logpdf(proposal), rtol=1e-9)


def test_proposals_have_the_spread_of_the_t_distribution():
    move = LaplaceMove(CENTRE, COVARIANCE, degrees_of_freedom=12.0)
    proposal, _ = move.get_proposal(np.tile(CENTRE, (200_000, 1)), np.random.RandomState(4))
    white = (proposal - CENTRE) @ WHITEN.T
    np.testing.assert_allclose(np.cov(white.T), np.eye(DIMENSION) * 12 / 10, atol=0.02)


def test_proposals_fitted_to_walkers_have_their_mean_and_a_weighted_covariance():
    draws = np.random.default_rng(5).multivariate_normal(CENTRE, COVARIANCE, size=(2, 3, 20))
    first = np.eye(DIMENSION)
    centre, mixed = fitted_to_walkers(first, draws)
    pooled = draws.reshape(-1, DIMENSION)
    np.testing.assert_allclose(centre, pooled.mean(axis=0))
    # 40 walkers against 10 parameters.
    np.testing.assert_allclose(mixed, 0.8 * np.cov(pooled.T) + 0.2 * first)


def sampled_from_afar(adapting_steps: int):
    """The Gaussian of this file sampled from an approximation that is three standard deviations off along one axis."""
    options = SamplingOptions(
        adapting_steps=adapting_steps, min_steps=60, max_steps=240, seed=2, start_inflation=1.0, min_effective=1e9
    )
    centre = CENTRE + 3.0 * FACTOR[:, 0] + 40.0
    return sample_posterior(lambda x: density(x - 40.0), tuple("abcdefghij"), centre, 0.7 * COVARIANCE, "test", options)


def test_proposals_that_are_fitted_to_draws_find_a_posterior_elsewhere():
    """Kept draws are unbiased; with proposals that stay where they began, the same steps do not get there."""

    def off(posterior) -> np.ndarray:
        draws = (np.log(posterior.draws.reshape(-1, DIMENSION)) - 40.0 - CENTRE) @ WHITEN.T
        return np.abs(draws.mean(axis=0))

    following, staying = sampled_from_afar(60), sampled_from_afar(0)
    assert following.burn_in == 120
    assert off(following).max() < 0.06 < 0.2 < off(staying).max(), (off(following), off(staying))
    assert following.acceptance.mean() > 1.6 * staying.acceptance.mean()


def test_ensembles_that_run_side_by_side_share_no_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    """emcee's move holds no step size for a moment of every step; here the moment is long enough to be met."""
    setup = emcee.moves.DEMove.setup

    def slow(move: emcee.moves.DEMove, coordinates: np.ndarray) -> None:
        move.g0 = None
        time.sleep(0.001)
        setup(move, coordinates)

    monkeypatch.setattr(emcee.moves.DEMove, "setup", slow)
    monkeypatch.setenv("SYSID_THREADS", "2")
    options = SamplingOptions(ensembles=4, segment_steps=20, min_steps=60, max_steps=100)
    names = tuple(f"p{i}" for i in range(3))
    drawn = sample_posterior(lambda x: -0.5 * (x**2).sum(axis=1), names, np.zeros(3), np.eye(3), "test", options)
    assert drawn.draws.shape[0] == 4


def never_converged(folder: Path, steps: int, *, resume: bool = False):
    """The Gaussian of this file, sampled with proposals fitted after 40 steps and again after 80."""
    options = SamplingOptions(adapting_steps=40, min_steps=10, max_steps=steps, min_effective=1e9, seed=4)
    names = tuple("abcdefghij")
    covariance = 0.3 * COVARIANCE
    return sample_posterior(
        lambda x: density(x - 40.0), names, CENTRE + 40.0, covariance, "test", options, folder=folder, resume=resume
    )


def test_a_chain_that_has_not_converged_gets_proposals_fitted_again(tmp_path, monkeypatch):
    looked: list[int] = []

    def fitted(covariance, draws):
        looked.append(draws.shape[1])
        return fitted_to_walkers(covariance, draws)

    monkeypatch.setattr(sampling, "fitted_to_walkers", fitted)
    posterior = never_converged(tmp_path / "a", 110)
    # Every fifth of steps 20 to 40, and of 40 to 80.
    assert looked == [4, 8]
    assert not posterior.converged
    assert posterior.burn_in == 80


@pytest.mark.parametrize("stopped", [40, 50, 80])
def test_a_chain_that_was_stopped_there_goes_on_as_if_it_had_not_been(tmp_path, stopped: int):
    whole = never_converged(tmp_path / "a", 110)
    never_converged(tmp_path / "b", stopped)
    np.testing.assert_array_equal(never_converged(tmp_path / "b", 110, resume=True).draws, whole.draws)


def test_a_limit_where_convergence_is_not_judged_yet_gets_a_judgement_of_its_own(tmp_path):
    """Steps 80 to 100 follow proposals that were fitted at 80: a chain that ends there is judged as a whole."""
    whole = never_converged(tmp_path / "a", 90)
    assert whole.burn_in >= 45
    never_converged(tmp_path / "b", 50)
    resumed = never_converged(tmp_path / "b", 90, resume=True)
    np.testing.assert_array_equal(resumed.draws, whole.draws)
    assert resumed.message == whole.message


def test_proposals_are_fitted_at_the_end_of_stretches_and_draws_before_are_not_kept():
    options = SamplingOptions(adapting_steps=50, segment_steps=50)
    assert [sampling._adapted(n, options) for n in (49, 50, 99, 100, 200, 399, 400)] == [0, 50, 50, 100, 200, 200, 400]
    odd = SamplingOptions(adapting_steps=60, segment_steps=25)
    assert [sampling._adapted(n, odd) for n in (50, 75, 100, 125, 240, 250)] == [0, 75, 75, 125, 125, 250]
    # Without such steps proposals stay those of the Laplace approximation.
    assert sampling._adapted(10_000, SamplingOptions(adapting_steps=0)) == 0
    default = SamplingOptions()
    assert sampling._kept_enough(20, default)
    assert not sampling._kept_enough(10, default)
    # After 60 steps: as many again as a chain needs at least; after 240, a quarter more.
    assert [sampling._kept_enough(n, default) for n in (60, 70, 80, 120)] == [True, False, True, True]
    assert [sampling._kept_enough(n, default) for n in (290, 300)] == [False, True]
    draws = np.random.default_rng(1).standard_normal((2, 300, 6, 1))
    assert diagnose(draws, 240).burn_in == 240
