"""Expected gain of an undeclared part: a score test, which needs no fit with the part.

s is the amplitude of a part: the share of a rocker, or the bending motion of a frame at a given frequency (1 for a
frame that bends). It is 0 at the present optimum. z are all unknowns that would move with it: parameters, declared
masses and tires within their tolerances, speeds and starts of the runs. One linear step from the present optimum gains

    2 (cost(0) - cost(s)) = u^2 / v    at s = -u / v,

or u' V^-1 u at -V^-1 u with one amplitude per load case; u and v are gradient and information of s with z eliminated
(:mod:`sysid.estimation.uncertainty.normal_equations`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from sysid.campaign.records import Campaign
from sysid.errors import CampaignError
from sysid.estimation.fit.law_evidence import LawEvidence
from sysid.estimation.fit.optimum import Optimum
from sysid.estimation.fit.thresholds import DECISIVE
from sysid.estimation.parameters.undeclared_parts import UndeclaredParts
from sysid.estimation.uncertainty.normal_equations import NormalEquations
from sysid.estimation.uncertainty.residual_columns import difference_columns

#: Values that differ by load case are tried for at most so many load cases: combinations are their power.
_MOST_LOAD_CASES = 3


@dataclass(frozen=True)
class PartCandidate:
    """A part that may be there: `words` for it, itself at amplitude `step` (`tried`) and with free values (`unknown`).

    Below `least` amplitude it is not fitted; `plausible` says whether its values after a fit are plausible. Candidates
    of one `family` may have other values in every load case: `joined` makes a part of one of them for each load case.
    """

    words: str
    tried: UndeclaredParts
    unknown: UndeclaredParts
    step: float
    least: float
    plausible: Callable[[Optimum], bool]
    family: str = ""
    joined: Callable[[Mapping[str, UndeclaredParts]], UndeclaredParts] | None = None


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
            tried = candidate.tried.in_campaign(campaign)
            model = problem.model.with_vehicle(tried.vehicle, tried.load_cases)
        except CampaignError:
            continue
        trials.append((model, candidate.step))
        possible.append(candidate)
    if not possible:
        return ()
    columns = difference_columns(problem.model, problem.model, problem.weights, *problem.unpack(optimum.vector), trials)
    apart = LawEvidence(campaign, optimum).by_load_case(optimum, columns)
    cases = tuple(dict.fromkeys(campaign.bump_runs[r].load_case for g in problem.model.groups for r in g.runs))
    # One amplitude in all load cases.
    alike = apart.along(np.repeat(np.eye(len(possible)), len(cases), axis=0)).score_tests()
    scores = [PartScore(c, float(gain), float(step)) for c, gain, step in zip(possible, *alike, strict=True)]
    if 1 < len(cases) <= _MOST_LOAD_CASES:
        # Values are declared for the first load case.
        places = {case: cases.index(case) for case in campaign.load_cases if case in cases}
        scores += _by_load_case(possible, apart, places)
    return tuple(sorted(scores, key=lambda s: -s.gain))


def _by_load_case(
    candidates: Sequence[PartCandidate], equations: NormalEquations, cases: Mapping[str, int]
) -> list[PartScore]:
    """The best score of every family whose candidates differ by load case; `cases` with their places."""
    best: dict[str, PartScore] = {}
    families: dict[str, list[int]] = {}
    for k, candidate in enumerate(candidates):
        if candidate.joined is not None:
            families.setdefault(candidate.family, []).append(k)
    for family, members in families.items():
        for chosen in product(members, repeat=len(cases)):
            of = [k * len(cases) + place for k, place in zip(chosen, cases.values(), strict=True)]
            apart = equations.only(of)
            amplitudes = apart.step()
            # Every further value must give enough gain.
            gain = 2.0 * apart.gain - DECISIVE * (len(set(chosen)) - 1)
            first = candidates[chosen[0]]
            known = family in best and best[family].gain >= gain
            if known or amplitudes.min() <= first.least or len(set(chosen)) == 1 or first.joined is None:
                continue
            unknown = first.joined({case: candidates[k].tried for case, k in zip(cases, chosen, strict=True)})
            best[family] = PartScore(replace(first, unknown=unknown), gain, float(amplitudes.min()))
    return list(best.values())
