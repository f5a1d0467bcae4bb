"""One step towards the joint optimum of parameters, masses and departures, and what is left when the latter go.

With parameters x of prior precision P, masses and departures y ~ N(0, L^-1), and the information H and gradient g of
the data at (x, y), priors included, a Gauss-Newton step is

    (dx, dy) = -(H T + diag(P, L))^-1 g.

Gradients hold the footprints, which follow tires and loads afterwards: T = I + F, with F dz the departures to which
these amount after a step dz (:mod:`sysid.estimation.uncertainty.map_following`).

Integrated over y the data leave for x the information N = H_xx - H_xy (H_yy + L)^-1 H_yx, and y follows x by
-(H_yy + L)^-1 H_yx with the covariance (H_yy + L)^-1 about that.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sysid.arrays import Parameters, ParametersByParameters


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


def joint_scale(information: np.ndarray, prior: ParametersByParameters, sd: np.ndarray) -> np.ndarray:
    """Units (p + q,) of parameters, masses and departures in which their joint information is harmless.

    Masses and departures count in prior standard deviations, so that a scale of zero does no harm; arguments as for
    :func:`joint_step`.
    """
    count = prior.shape[0]
    return np.concatenate([1.0 / np.sqrt(np.diag(information)[:count] + np.diag(prior)), sd])


def joint_precision(information: np.ndarray, prior: ParametersByParameters, sd: np.ndarray) -> np.ndarray:
    """H + diag(P, L) in the units of :func:`joint_scale`, (p + q, p + q)."""
    count = prior.shape[0]
    scale = joint_scale(information, prior, sd)
    whole = information * np.outer(scale, scale)
    whole[:count, :count] += prior * np.outer(scale[:count], scale[:count])
    whole[count:, count:] += np.eye(sd.size)
    return np.asarray(whole)


def joint_covariance(information: np.ndarray, prior: ParametersByParameters, sd: np.ndarray) -> np.ndarray:
    """The inverse of :func:`joint_precision`, (p + q, p + q)."""
    return np.asarray(np.linalg.inv(joint_precision(information, prior, sd)))


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
    count = prior.shape[0]
    scale, whole = joint_scale(information, prior, sd), joint_precision(information, prior, sd)
    variance = np.diag(np.linalg.inv(whole))
    gradient = scale * score
    gradient[:count] += scale[:count] * pull
    gradient[count:] += np.divide(amounts, sd, where=sd > 0.0, out=np.zeros(sd.size))
    if footprint_response is not None:
        whole += (information @ footprint_response) * np.outer(scale, scale)
    step = -np.linalg.solve(whole, gradient)
    amount = step[count:] * sd
    spread = np.maximum(np.sqrt(variance[count:]) * sd, least_sd)
    over_sd = np.divide(amount, spread, where=spread > 0.0, out=np.zeros(sd.size))
    return JointStep(step[:count] * scale[:count], amount, over_sd)


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


@dataclass(frozen=True)
class Integrated:
    """What the data leave for p parameters with q masses and departures integrated out.

    `information` N (p, p); `response` (q, p) by which these follow the parameters; `factor` F (q, q) of their
    covariance F F' about that.
    """

    information: ParametersByParameters
    response: np.ndarray
    factor: np.ndarray


def integrated(information: np.ndarray, count: int, sd: np.ndarray) -> Integrated:
    """Masses and departures integrated out.

    Parameters
    ----------
    information : (p + q, p + q) of the data; `count` p.
    sd : (q,) prior standard deviations of masses and departures.
    """
    cross = sd[:, None] * information[count:, :count]
    inverse = np.linalg.inv(sd[:, None] * information[count:, count:] * sd + np.eye(sd.size))
    solved = inverse @ cross
    left = information[:count, :count] - cross.T @ solved
    factor = sd[:, None] * np.linalg.cholesky(0.5 * (inverse + inverse.T))
    return Integrated(0.5 * (left + left.T), -sd[:, None] * solved, factor)
