"""Proposals for emcee: its stretch and differential-evolution moves, and an independence move about what is known.

emcee's snooker move is not offered: up to release 3.1.6 it leaves the wrong distribution invariant.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import emcee
import numpy as np
from scipy.linalg import solve_triangular

from sysid.arrays import Parameters, ParametersByParameters, WalkerDraws


class LaplaceMove(emcee.moves.MHMove):  # type: ignore[misc]  # emcee has no types
    """Metropolis-Hastings with proposals from a multivariate t about a centre: the least-squares optimum to begin with.

    A proposal q is accepted with probability min(1, pi(q) t(x) / (pi(x) t(q))): draws of a posterior that is close to
    its Laplace approximation decorrelate in a few steps, while the heavier tails keep the ratio bounded.

    Parameters
    ----------
    centre : (p,) ; covariance : (p, p) of a normal approximation; degrees_of_freedom of the t.
    """

    def __init__(self, centre: Parameters, covariance: ParametersByParameters, degrees_of_freedom: float = 40.0):
        self._centre = np.asarray(centre, float)
        self._factor = np.linalg.cholesky(covariance)
        self._nu = float(degrees_of_freedom)
        super().__init__(self._propose, ndim=self._centre.size)

    def draws(self, count: int, random: np.random.RandomState) -> tuple[np.ndarray, np.ndarray]:
        """Points (n, p) of the t, and the logarithm of its density there (n,), up to a constant."""
        normal = random.standard_normal((count, self._centre.size))
        chi2 = random.chisquare(self._nu, size=count)
        points = self._centre + (normal / np.sqrt(chi2 / self._nu)[:, None]) @ self._factor.T
        return points, self._log_t(points)

    def _propose(self, coordinates: np.ndarray, random: np.random.RandomState) -> tuple[np.ndarray, np.ndarray]:
        proposal, log_t = self.draws(len(coordinates), random)
        return proposal, self._log_t(coordinates) - log_t

    def _log_t(self, points: np.ndarray) -> np.ndarray:
        """Logarithm of the t density at points (n, p), up to a constant."""
        white = solve_triangular(self._factor, (points - self._centre).T, lower=True)
        return np.asarray(-0.5 * (self._nu + points.shape[1]) * np.log1p((white**2).sum(axis=0) / self._nu))


class MoveInCommon(emcee.moves.Move):  # type: ignore[misc]  # emcee has no types
    """One of several moves at every step, the same one in all ensembles, so that they ask for as many points at once.

    Parameters
    ----------
    moves : with their probabilities; seed : of the choice; step : how many steps there were before.
    """

    def __init__(self, moves: Sequence[tuple[emcee.moves.Move, float]], seed: int, step: int = 0):
        self.moves = tuple(moves)
        self._seed, self._step = seed, step

    def propose(self, model: Any, state: emcee.State) -> tuple[emcee.State, np.ndarray]:
        """The state after one step, and which walkers (n,) have moved."""
        # By the number of the step, so that a chain goes on as if it had not been interrupted.
        shares = [share for _, share in self.moves]
        chosen = np.random.default_rng([self._seed, self._step]).choice(len(shares), p=shares)
        self._step += 1
        new, accepted = self.moves[chosen][0].propose(model, state)
        return new, accepted


def posterior_moves(
    centre: Parameters, covariance: ParametersByParameters, seed: int = 0, step: int = 0
) -> list[tuple[emcee.moves.Move, float]]:
    """Moves for a posterior with a known normal approximation; arguments as of :class:`MoveInCommon`."""
    moves = [
        (LaplaceMove(centre, covariance), 0.7),
        (emcee.moves.DEMove(), 0.18),
        (emcee.moves.StretchMove(), 0.12),
    ]
    return [(MoveInCommon(moves, seed, step), 1.0)]


def fitted_to_walkers(
    covariance: ParametersByParameters, draws: WalkerDraws
) -> tuple[Parameters, ParametersByParameters]:
    """Centre and covariance of independence proposals from the latest draws of all ensembles.

    C = (n S + p C_0) / (n + p) with the covariance S of the draws, that of the Laplace approximation C_0, n walkers and
    p parameters: few walkers do not know a covariance by themselves.

    Parameters
    ----------
    covariance : (p, p) C_0; draws : (E, steps, W, p).
    """
    ensembles, _, walkers, count = draws.shape
    pooled = draws.reshape(-1, count)
    known = ensembles * walkers
    mixed = (known * np.atleast_2d(np.cov(pooled.T)) + count * covariance) / (known + count)
    return pooled.mean(axis=0), np.asarray(mixed)
