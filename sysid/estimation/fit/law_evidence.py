"""Evidence of the data for suspension laws when declared masses and the tire model may be slightly wrong too.

A law that the truck does not have can compensate the error of a declared mass. Laws are therefore compared by the
remaining cost with masses and departures of the tires y free within their tolerances L^-1. With the gradient g and the
information H of the data near the optimum of the parameters x, the gradient e of data and priors together by x, and the
prior precision P,

    left = cost - 1/2 e' (H_xx + P)^-1 e - 1/2 r' (S + L)^-1 r,
    r = g_y - H_yx (H_xx + P)^-1 e,    S = H_yy - H_yx (H_xx + P)^-1 H_xy,
    covariance of x = (H_xx + P - H_xy (H_yy + L)^-1 H_yx)^-1.

At the optimum e is zero. A search that ends early leaves some of it, and masses act almost as the parameters do:
without e, they would be credited with what the search has left over.

Friction is not a departure here, because it is one of the laws that are compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sysid.arrays import Parameters, ParametersByParameters, Unknowns, UnknownsByUnknowns
from sysid.campaign.records import Campaign
from sysid.estimation.fit.optimum import Optimum
from sysid.estimation.parameters.suspension_elements import TRAVELS
from sysid.estimation.uncertainty.allowance_columns import allowance_columns
from sysid.estimation.uncertainty.allowances import Allowances
from sysid.estimation.uncertainty.departure_scale import PLAUSIBLE
from sysid.estimation.uncertainty.departures import departures
from sysid.estimation.uncertainty.information import BlockInformation, apart_by_load_case, information_with
from sysid.estimation.uncertainty.residual_columns import ResidualColumns
from sysid.estimation.uncertainty.uncertain_masses import uncertain_masses


@dataclass(frozen=True)
class Evidence:
    """Evidence for an optimum: remaining `cost` with masses and tires free, `covariance` (p, p) of the log parameters
    with both unknown, and the `step` (p,) of the log parameters to where they are with both free.
    """

    cost: float
    covariance: ParametersByParameters
    step: Parameters


@dataclass(frozen=True)
class Judged:
    """An optimum and the evidence for it."""

    optimum: Optimum
    evidence: Evidence

    @property
    def count(self) -> int:
        """Number of parameters."""
        return self.optimum.problem.count


class LawEvidence:
    """Evidence for the optima of one campaign under the footprint maps of one of them."""

    def __init__(self, campaign: Campaign, optimum: Optimum):
        self._campaign, self._felt = campaign, optimum.problem.model.felt

    @cached_property
    def _allowances(self) -> Allowances:
        rubbing = [True] * len(self._campaign.vehicle.axles)
        tires = departures(self._felt, self._campaign.load_cases_in_use, rubbing)
        return Allowances(uncertain_masses(self._campaign), tires)

    @property
    def count(self) -> int:
        """Number m of masses and departures."""
        return self._allowances.count

    @cached_property
    def sd(self) -> Unknowns:
        """Standard deviations (m,) of masses and departures."""
        tires = [PLAUSIBLE[d.kind] for d in self._allowances.departures.directions]
        return np.concatenate([self._allowances.masses.sd, tires])

    def without_known(self, optimum: Optimum, more: Sequence[ResidualColumns]) -> Eliminated:
        """What the data say about q candidates near an optimum, all else free to follow.

        Parameters
        ----------
        more : derivatives of every group's residuals by the candidates.
        """
        data = self._information(optimum, more)
        return self._eliminated(optimum, data.matrix, data.score)

    def by_load_case(self, optimum: Optimum, more: Sequence[ResidualColumns]) -> tuple[Unknowns, UnknownsByUnknowns]:
        """The same (q L,) and (q L, q L) with one amplitude of every candidate in each of L load cases with runs."""
        data = self._information(optimum, more)
        found = self._eliminated(optimum, *apart_by_load_case(data, optimum.problem.count + self.count))
        return found.pull, found.information

    def _information(self, optimum: Optimum, more: Sequence[ResidualColumns]) -> BlockInformation:
        return information_with(self._campaign, optimum.problem, optimum.vector, *self._columns(optimum), more)

    def _eliminated(self, optimum: Optimum, matrix: UnknownsByUnknowns, score: Unknowns) -> Eliminated:
        whole, precision = _with_priors(optimum, score)
        return eliminated(matrix, whole, precision, self.sd)

    def _columns(self, optimum: Optimum) -> tuple[Sequence[ResidualColumns], ...]:
        """Derivatives of every group's residuals at an optimum by masses and departures."""
        problem = optimum.problem
        parameters, motion = problem.unpack(optimum.vector)
        return allowance_columns(problem.model, self._allowances, problem.weights, parameters, motion)

    def judge(self, optimum: Optimum) -> Judged:
        """An optimum with the evidence for it."""
        problem = optimum.problem
        data = information_with(self._campaign, problem, optimum.vector, *self._columns(optimum))
        score, precision = _with_priors(optimum, data.score)
        # Where a run just reaches a stop, the slope is that of one side, and no way down.
        score[[i for i, p in enumerate(problem.model.parameters.parameters) if p.quantity in TRAVELS]] = 0.0
        return Judged(optimum, evidence(optimum.minimum.cost, data.matrix, score, precision, self.sd))


def _with_priors(optimum: Optimum, score: Unknowns) -> tuple[Unknowns, ParametersByParameters]:
    """The gradient of data and priors from that of the data, and the precision (p, p) of the priors."""
    count = optimum.problem.count
    pull, precision = optimum.problem.model.parameters.prior_pull(optimum.vector[:count])
    return np.concatenate([score[:count] + pull, score[count:]]), precision


class Eliminated(NamedTuple):
    """Gradient `pull` (q,) and `information` (q, q) of q candidates, all else eliminated.

    `response` (p, q): how the p parameters follow the candidates.
    """

    pull: Unknowns
    information: UnknownsByUnknowns
    response: np.ndarray


def eliminated(
    information: UnknownsByUnknowns, score: Unknowns, prior: ParametersByParameters, sd: Unknowns
) -> Eliminated:
    """What is known of q candidates with p parameters and m masses and departures eliminated.

    Parameters
    ----------
    information : (p + m + q, p + m + q) of the data; score : (p + m + q,) gradient of half the sum of squares, priors
        included: the parameters may be a little off their optimum.
    prior : (p, p) prior precision; sd : (m,) tolerances of masses and departures.
    """
    count = prior.shape[0]
    known = count + sd.size
    of_known = information[:known, :known].copy()
    of_known[:count, :count] += prior
    of_known[count:, count:] += np.diag(sd**-2.0)
    cross = information[:known, known:]
    solved = np.linalg.solve(of_known, cross)
    remaining = information[known:, known:] - cross.T @ solved
    return Eliminated(score[known:] - solved.T @ score[:known], remaining, -solved[:count])


def evidence(
    cost: float, information: UnknownsByUnknowns, score: Unknowns, prior: ParametersByParameters, sd: Unknowns
) -> Evidence:
    """Remaining cost with m further unknowns free, and the covariance of p parameters with them.

    Parameters
    ----------
    information : (p + m, p + m) of the data; score : (p + m,) gradient of half the sum of squares, priors included: the
        parameters may be a little off their optimum.
    prior : (p, p) prior precision; sd : (m,) standard deviations of the further unknowns.
    """
    count = prior.shape[0]
    # In units of their tolerances: safe for unknowns that the data do not see.
    cross = information[:count, count:] * sd
    free = sd[:, None] * information[count:, count:] * sd + np.eye(sd.size)
    of_parameters = information[:count, :count] + prior
    follows = np.linalg.solve(of_parameters, cross)
    off = np.linalg.solve(of_parameters, score[:count])
    pull = sd * score[count:] - cross.T @ off
    moved = np.linalg.solve(free - cross.T @ follows, pull)
    return Evidence(
        cost - 0.5 * float(score[:count] @ off + pull @ moved),
        np.linalg.inv(of_parameters - cross @ np.linalg.solve(free, cross.T)),
        follows @ moved - off,
    )
