"""One step towards the joint optimum of parameters, masses and departures.

With parameters x of prior precision P, masses and departures y ~ N(0, L^-1), and the information H and gradient g of
the data at (x, y), priors included, a Gauss-Newton step is

    (dx, dy) = -(H T + diag(P, L))^-1 g.

Gradients hold the footprints, which follow tires and loads afterwards: T = I + F, with F dz the departures to which
these amount after a step dz (:mod:`sysid.estimation.uncertainty.map_following`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sysid.arrays import Parameters, ParametersByParameters
from sysid.estimation.uncertainty.normal_equations import NormalEquations


@dataclass(frozen=True)
class JointStep:
    """Changes of p parameters and q masses and departures, these also `over_sd`, in standard deviations.

    `over_sd` counts in the least standard deviation that matters where the true one is smaller.
    """

    parameters: Parameters
    amounts: np.ndarray
    over_sd: np.ndarray

    @property
    def largest(self) -> float:
        """The largest change of a mass or departure in standard deviations."""
        return float(np.max(np.abs(self.over_sd), initial=0.0))

    def times(self, share: float) -> JointStep:
        """A share of the step."""
        return JointStep(share * self.parameters, share * self.amounts, share * self.over_sd)

    def takes_back(self, before: JointStep) -> bool:
        """Whether the step undoes most of the one before: such steps go back and forth without end."""
        lengths = np.linalg.norm(self.over_sd) * np.linalg.norm(before.over_sd)
        return bool(-self.over_sd @ before.over_sd > 0.5 * lengths)


def joint_step(
    information: np.ndarray,
    score: np.ndarray,
    prior: ParametersByParameters,
    pull: Parameters,
    sd: np.ndarray,
    amounts: np.ndarray,
    footprint_response: np.ndarray | None = None,
    least_sd: np.ndarray | float = 0.0,
) -> JointStep:
    """One Gauss-Newton step.

    Parameters
    ----------
    information : (p + q, p + q) of the data; score : (p + q,) gradient of half the sum of squares of the data.
    prior : (p, p) prior precision of the parameters; pull : (p,) gradient of their prior's half sum of squares.
    sd : (q,) prior standard deviations of masses and departures, 0 for those that stay; amounts : (q,) where they are.
    footprint_response : (p + q, p + q) F, None where footprints stay.
    least_sd : (q,) standard deviations below which a change of a mass or departure does not matter.
    """
    count = len(prior)
    equations = NormalEquations.of(information, score, prior=prior, pull=pull, sd=sd, amounts=amounts)
    step = equations.step(None if footprint_response is None else information @ footprint_response)
    spread = np.maximum(np.sqrt(equations.variances[count:]), least_sd)
    over_sd = np.divide(step[count:], spread, where=spread > 0.0, out=np.zeros(sd.size))
    return JointStep(step[:count], step[count:], over_sd)


def bounded_step(
    step_with: Callable[[np.ndarray], JointStep], sd: np.ndarray, held: Callable[[JointStep], np.ndarray]
) -> JointStep:
    """A joint step that takes no mass or departure beyond a bound at which it already is.

    Those that would go beyond are held, and the step is computed again. Then others may want to go beyond their bounds,
    so this is repeated until none does.

    Parameters
    ----------
    step_with : the step for given prior standard deviations (q,) of masses and departures; 0 holds one where it is.
    sd : (q,) prior standard deviations.
    held : says of a step which (q,) masses and departures are at a bound and would go beyond it.

    Returns
    -------
    JointStep
        Changes of all; zero for those that are held.
    """
    fixed = np.zeros(sd.size, bool)
    while True:
        step = step_with(np.where(fixed, 0.0, sd))
        now = fixed | held(step)
        if (now == fixed).all():
            return step
        fixed = now
