"""What a part that nobody declared promises: a score test, which needs no fit with the part.

With the amplitude s of a part (the share of a rocker; the motion of a frame that bends at a given frequency, 1 where it
does), 0 at the optimum at hand, and everything that would move with it, z (parameters, declared masses and tires within
their tolerances, speeds and starts of the runs), one linear step from there gains

    2 (cost(0) - cost(s)) = u^2 / v,    u = g_s - H_sz (H_zz + P)^-1 g_z,    v = H_ss - H_sz (H_zz + P)^-1 H_zs,

at s = -u / v; g is the gradient, H the information of the data and P that of the priors (C. R. Rao, Large sample tests
of statistical hypotheses concerning several parameters, Mathematical Proceedings of the Cambridge Philosophical Society
44 (1948), doi:10.1017/S0305004100023987).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.campaign.records import Campaign
from sysid.errors import CampaignError
from sysid.estimation.fit.law_evidence import LawEvidence
from sysid.estimation.fit.optimum import Optimum
from sysid.estimation.parameters.undeclared_parts import UndeclaredParts
from sysid.estimation.uncertainty.residual_columns import difference_columns


@dataclass(frozen=True)
class PartCandidate:
    """A part that may be there: `words` for it, itself at amplitude `step` (`tried`) and with free values (`unknown`).

    Below `least` amplitude it is not fitted; `plausible` says of a fit with it whether its values are.
    """

    words: str
    tried: UndeclaredParts
    unknown: UndeclaredParts
    step: float
    least: float
    plausible: Callable[[Optimum], bool]


@dataclass(frozen=True)
class PartScore:
    """What a candidate would `gain` by one linear step, and its `amplitude` after it."""

    candidate: PartCandidate
    gain: float
    amplitude: float


def part_scores(campaign: Campaign, optimum: Optimum, candidates: Sequence[PartCandidate]) -> tuple[PartScore, ...]:
    """Score test of every candidate at the optimum of a fit without it, the largest gain first.

    Candidates that the vehicle cannot have (a frame without room for its mass) are left out.
    """
    problem, trials, possible = optimum.problem, [], []
    for candidate in candidates:
        try:
            model = problem.model.with_vehicle(candidate.tried.on(campaign.vehicle), campaign.load_cases)
        except CampaignError:
            continue
        trials.append((model, candidate.step))
        possible.append(candidate)
    if not possible:
        return ()
    columns = difference_columns(problem.model, problem.model, problem.weights, *problem.unpack(optimum.vector), trials)
    pull, information = LawEvidence(campaign, optimum).without_known(optimum, columns)
    v = np.diag(information)
    scores = [PartScore(c, float(pull[k] ** 2 / v[k]), float(-pull[k] / v[k])) for k, c in enumerate(possible)]
    return tuple(sorted(scores, key=lambda s: -s.gain))
