"""Travels of stops that the runs just reach, found by a scan.

A stop beyond the largest travel of the runs has no effect. The derivative by its travel is zero there, so no search
moves it, even if the runs would fit much better with the stop a little nearer. So the cost is computed at many shorter
travels, with all other parameters as they are and the motions of the runs following: first at values from that of the
optimum down to improbable ones, then closely between the last of them that the runs do not reach and the next one. A
stop that is touched by a tenth of a millimetre can show, and one at half a millimetre can already be much too near.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sysid.arrays import UnknownsOfFit
from sysid.campaign.clocks.moved import on_moved_clocks
from sysid.campaign.records import Campaign
from sysid.estimation.fit.optimum import Optimum, parameter_sd
from sysid.estimation.fit.options import Phase
from sysid.estimation.fit.reweighted_search import continued, optimise_from
from sysid.estimation.fit.stop_search import IDLE_SHRINKAGE
from sysid.estimation.fit.thresholds import DECISIVE
from sysid.estimation.parameters.suspension_elements import TRAVEL_SD, TRAVELS
from sysid.estimation.residuals.set_misfits import group_inputs, group_misfits
from sysid.estimation.uncertainty.run_scores import own_columns, own_priors
from sysid.progress import Progress

#: Values of a travel that are tried side by side, and how far they go in its logarithm.
_VALUES = 48
_FURTHEST = 5.0 * TRAVEL_SD
#: Fall of the cost from which on a nearer stop is searched for: as large as laws are decided by.
_LEAST = 0.5 * DECISIVE
#: Relative change of the sum of squares above rounding.
_ROUNDING = 1e-12
#: Searches at most; each may bring another stop within reach.
_MOST = 3


def with_touched_stops(campaign: Campaign, optimum: Optimum, phase: Phase, report: Progress) -> Optimum:
    """The best of an optimum and of searches from shorter values of travels that the runs do not reach there.

    Parameters
    ----------
    campaign : screened, its clocks as read.
    phase, report : of the searches, which keep model and weights of the optimum.
    """
    for _ in range(_MOST):
        nearer = _nearer_stops(optimum)
        if nearer is None:
            break
        again = _searched(campaign, replace(optimum, vector=nearer), phase, report)
        if again.minimum.cost >= optimum.minimum.cost:
            break
        optimum = again
    return optimum


def _searched(campaign: Campaign, near: Optimum, phase: Phase, report: Progress) -> Optimum:
    """The optimum of a search that begins at the vector of another one, all else as it is there."""
    problem, kept = near.problem, replace(phase, weight_rounds=0, larger_steps=False)
    values, motion = problem.unpack(near.vector)
    campaign, noise, weights = on_moved_clocks(campaign, near.clocks), near.instrument, problem.weights
    found = optimise_from(campaign, problem.model, motion, noise, values, kept, report, weights=weights)
    return replace(continued(found, near), amounts=near.amounts, clocks=near.clocks)


def _nearer_stops(optimum: Optimum) -> UnknownsOfFit | None:
    """The vector of an optimum with the travels that a scan finds at shorter values; None if it finds none."""
    parameters = optimum.problem.model.parameters.parameters
    if not any(p.quantity in TRAVELS for p in parameters):
        return None
    sd = parameter_sd(optimum)
    unreached = [i for i, p in enumerate(parameters) if p.quantity in TRAVELS and sd[i] >= IDLE_SHRINKAGE * p.prior_sd]
    if not unreached:
        return None
    costs = _Costs(optimum)
    # Value and fall of the cost of each.
    found = {i: lowest for i in unreached if (lowest := costs.lowest(i))[1] > _LEAST}
    if not found:
        return None
    best = max(found, key=lambda i: found[i][1])
    together, alone = optimum.vector.copy(), optimum.vector.copy()
    together[list(found)] = [value for value, _ in found.values()]
    alone[best] = found[best][0]
    # Two stops that explain the same residuals are not both moved.
    return together if len(found) > 1 and costs.fall(together) > found[best][1] else alone


class _Costs:
    """Costs of parameter sets near an optimum, without derivatives."""

    def __init__(self, optimum: Optimum):
        problem = optimum.problem
        self._centre, motion = problem.unpack(optimum.vector)
        self._model = problem.model
        self._rows, self._targets = problem.model.parameters.prior_rows()
        self._inputs = [
            group_inputs(
                problem.model,
                problem.weights,
                motion,
                position,
                own_columns(problem, position, problem.linearise_one(optimum.vector, position), None),
                own_priors(problem, motion, position, None),
            )
            for position in range(len(problem.model.groups))
        ]

    def lowest(self, parameter: int) -> tuple[float, float]:
        """The value of a log parameter, not above that of the optimum, with the lowest cost; the fall of the cost."""
        values = self._centre[parameter] - np.linspace(0.0, _FURTHEST, _VALUES)
        misfits, costs = self._along(parameter, values)
        felt = np.flatnonzero(~(np.abs(misfits - misfits[0]) <= _ROUNDING * misfits[0]))
        if not felt.size:
            return float(values[0]), 0.0
        closely = np.linspace(values[felt[0] - 1], values[felt[0]], _VALUES) if felt[0] else values
        values = np.concatenate([values, closely])
        falls = costs[0] - np.concatenate([costs, self._along(parameter, closely)[1]])
        best = int(np.argmax(np.where(np.isfinite(falls), falls, -np.inf)))
        return float(values[best]), float(falls[best])

    def fall(self, vector: UnknownsOfFit) -> float:
        """By how much the cost is lower at the log parameters of a vector than at the optimum."""
        sets = np.stack([self._centre, vector[: self._centre.size]], axis=1)
        costs = self._of(sets)[1]
        return float(costs[0] - costs[1])

    def _along(self, parameter: int, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        sets = np.repeat(self._centre[:, None], values.size, axis=1)
        sets[parameter] = values
        return self._of(sets)

    def _of(self, sets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sums of squares (S,) of the residuals, and costs (S,), of sets (p, S)."""
        every = zip(self._inputs, self._model.shapes, strict=True)
        misfits = np.sum([group_misfits(of, sets, shape=shape)[0] for of, shape in every], axis=0)
        prior = ((self._rows @ sets - self._targets[:, None]) ** 2).sum(axis=0)
        return np.asarray(misfits), np.asarray(0.5 * (misfits + prior))
