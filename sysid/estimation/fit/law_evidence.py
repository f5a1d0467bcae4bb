"""Evidence of the data for suspension laws when declared masses and the tire model may be slightly wrong too.

A law that the truck does not have can compensate the error of a declared mass. Laws are therefore compared by the
remaining cost with masses and departures of the tires y free within their tolerances L^-1. With the gradient g and the
information H of the data near the optimum of the parameters x, the gradient e of data and priors together by x, and the
prior precision P,

    left = cost - 1/2 (e, g_y)' A^-1 (e, g_y),    A = H + diag(P, L),    covariance of x = (A^-1)_xx

(:mod:`sysid.estimation.uncertainty.normal_equations`). At the optimum e is zero. A search that ends early leaves some
of it, and masses act almost as the parameters do: without e, they would be credited with what the search has left over.

Friction is not a departure here, because it is one of the laws that are compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sysid.arrays import Parameters, ParametersByParameters, Unknowns, UnknownsByUnknowns
from sysid.campaign.records import Campaign
from sysid.estimation.fit.optimum import Optimum
from sysid.estimation.parameters.suspension_elements import TRAVELS
from sysid.estimation.uncertainty.allowance_columns import allowance_columns
from sysid.estimation.uncertainty.allowances import Allowances, without_friction
from sysid.estimation.uncertainty.departure_scale import PLAUSIBLE
from sysid.estimation.uncertainty.information import BlockInformation, apart_by_load_case, information_with
from sysid.estimation.uncertainty.normal_equations import Eliminated, NormalEquations
from sysid.estimation.uncertainty.residual_columns import ResidualColumns


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
        self._campaign, self._model = campaign, optimum.problem.model

    @cached_property
    def _allowances(self) -> Allowances:
        return without_friction(self._campaign, self._model.parameters, self._model.felt)

    @property
    def count(self) -> int:
        """Number m of masses and departures."""
        return self._allowances.count

    @cached_property
    def sd(self) -> Unknowns:
        """Standard deviations (m,) of masses and departures."""
        plausible = [PLAUSIBLE[d.kind] for d in self._allowances.departures.directions]
        return np.concatenate([self._allowances.masses.sd, plausible])

    def without_known(self, optimum: Optimum, more: Sequence[ResidualColumns]) -> Eliminated:
        """Equations of q candidates near an optimum, and how parameters, masses and departures follow them.

        Parameters
        ----------
        more : derivatives of every group's residuals by the candidates, each in units of its prior scale.
        """
        data = self._information(optimum, more)
        return self._eliminated(optimum, data.matrix, data.score, 1.0)

    def by_load_case(self, optimum: Optimum, more: Sequence[ResidualColumns]) -> NormalEquations:
        """Equations (q L,) of candidates without priors, each with one amplitude in every load case with runs."""
        data = self._information(optimum, more)
        return self._eliminated(optimum, *apart_by_load_case(data, optimum.problem.count + self.count), np.inf).left

    def _information(self, optimum: Optimum, more: Sequence[ResidualColumns]) -> BlockInformation:
        return information_with(self._campaign, optimum.problem, optimum.vector, *self._columns(optimum), more)

    def _eliminated(self, optimum: Optimum, matrix: UnknownsByUnknowns, score: Unknowns, sd: float) -> Eliminated:
        known = optimum.problem.count + self.count
        every = np.concatenate([self.sd, np.full(score.size - known, sd)])
        return _equations(optimum, matrix, score, every).eliminate(slice(known))

    def _columns(self, optimum: Optimum) -> tuple[Sequence[ResidualColumns], ...]:
        """Derivatives of every group's residuals at an optimum by masses and departures."""
        problem = optimum.problem
        parameters, motion = problem.unpack(optimum.vector)
        return allowance_columns(problem.model, self._allowances, problem.weights, parameters, motion)

    def judge(self, optimum: Optimum) -> Judged:
        """An optimum with the evidence for it."""
        problem = optimum.problem
        data = information_with(self._campaign, problem, optimum.vector, *self._columns(optimum))
        equations = _equations(optimum, data.matrix, data.score, self.sd)
        # Where a run just reaches a stop, the slope is that of one side, and no way down.
        travels = [i for i, p in enumerate(problem.model.parameters.parameters) if p.quantity in TRAVELS]
        equations = replace(
            equations, gradient=np.where(np.isin(np.arange(data.score.size), travels), 0.0, equations.gradient)
        )
        return Judged(optimum, evidence(optimum.minimum.cost, equations, problem.count))


def _equations(optimum: Optimum, matrix: UnknownsByUnknowns, score: Unknowns, sd: Unknowns) -> NormalEquations:
    """Equations of the parameters and of further unknowns with standard deviations `sd`, near an optimum."""
    pull, prior = optimum.problem.model.parameters.prior_pull(optimum.vector[: optimum.problem.count])
    return NormalEquations.of(matrix, score, prior=prior, pull=pull, sd=sd)


def evidence(cost: float, equations: NormalEquations, count: int) -> Evidence:
    """Remaining cost with all unknowns free, and the covariance and step of the first `count` of them.

    Parameters
    ----------
    cost : half the sum of squares where the equations hold, which may be a little off the parameters' optimum.
    """
    further = slice(count, None)
    covariance = equations.eliminate(further).left.covariance
    return Evidence(cost - equations.gain, covariance, equations.step()[:count])
