"""Travels of stops that the runs just reach, found by a scan.

A stop beyond the largest travel of the runs has no effect. The derivative by its travel is zero there, so no search
moves it, even if the runs would fit much better with the stop a little nearer. So the cost is computed at many shorter
travels, with all other parameters as they are and the motions of the runs following.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sysid.arrays import UnknownsOfFit
from sysid.estimation.fit.optimum import Optimum, parameter_sd
from sysid.estimation.fit.stop_search import IDLE_SHRINKAGE
from sysid.estimation.fit.thresholds import DECISIVE
from sysid.estimation.parameters.suspension_elements import TRAVELS
from sysid.estimation.residuals.set_misfits import group_inputs, group_misfits

#: Step of the scan in the logarithm of a travel, 1 mm or less; what the runs just reach falls within a few of them.
_STEP = 0.0125
#: Values of each travel, the first one that of the optimum; together five standard deviations of the prior.
_VALUES = 48
#: Fall of the cost from which on a nearer stop is searched for: as large as laws are decided by.
_LEAST = 0.5 * DECISIVE
#: Searches at most; each may bring another stop within reach.
_MOST = 3


def with_touched_stops(optimum: Optimum, searched: Callable[[Optimum], Optimum]) -> Optimum:
    """The best of an optimum and of searches from shorter values of travels that the runs do not reach there.

    Parameters
    ----------
    searched : the optimum of a search that begins at the vector of another one, under its weights and maps.
    """
    for _ in range(_MOST):
        nearer = _nearer_stops(optimum)
        if nearer is None:
            break
        again = searched(replace(optimum, vector=nearer))
        if again.minimum.cost >= optimum.minimum.cost:
            break
        optimum = again
    return optimum


def _nearer_stops(optimum: Optimum) -> UnknownsOfFit | None:
    """The vector of an optimum with all travels that a scan finds at shorter values; None if it finds none."""
    parameters = optimum.problem.model.parameters.parameters
    travels = [i for i, p in enumerate(parameters) if p.quantity in TRAVELS]
    if not travels:
        return None
    sd = parameter_sd(optimum)
    unreached = [i for i in travels if sd[i] >= IDLE_SHRINKAGE * parameters[i].prior_sd]
    costs = _Costs(optimum) if unreached else None
    vector, found = optimum.vector.copy(), False
    for i in unreached:
        assert costs is not None
        values = vector[i] - _STEP * np.arange(_VALUES)
        along = costs.along(i, values)
        best = int(np.argmin(np.where(np.isfinite(along), along, np.inf)))
        if along[best] < along[0] - _LEAST:
            vector[i], found = values[best], True
    return vector if found else None


class _Costs:
    """Costs along single parameters through an optimum."""

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
                problem.expected,
                position,
                problem.linearise_one(optimum.vector, position),
            )
            for position in range(len(problem.model.groups))
        ]

    def along(self, parameter: int, values: np.ndarray) -> np.ndarray:
        """Costs (n,) with one log parameter at some values (n,)."""
        sets = np.repeat(self._centre[:, None], values.size, axis=1)
        sets[parameter] = values
        prior = ((self._rows @ sets - self._targets[:, None]) ** 2).sum(axis=0)
        every = zip(self._inputs, self._model.shapes, strict=True)
        return np.asarray(0.5 * (prior + sum(np.asarray(group_misfits(of, sets, shape=shape)) for of, shape in every)))
