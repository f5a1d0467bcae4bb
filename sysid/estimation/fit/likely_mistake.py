"""The likely mistake in a campaign whose residuals do not fit: one wrong sign, lag, scale, place or load case.

A score test, as in :mod:`sysid.estimation.fit.part_score`, needs no further fit. All residuals are in units of the
noise of the instruments (or of what the channels show before the bump), so that a sensor that contradicts the others
keeps its weight. a is the amplitude of a mistake, and z are all unknowns that would move with it: parameters, masses
and tires within their tolerances, speeds and starts of the runs. One linear step from the present fit explains u^2 / v
of the sum of squares, at a = -u / v. It is compared with the residuals beyond the noise that remain after a step of z
alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from sysid.arrays import UnknownsOfFit
from sysid.campaign.records import Campaign
from sysid.estimation.fit.causes import Cause
from sysid.estimation.fit.mistake_candidates import Directions, MistakeCandidate
from sysid.estimation.fit.optimum import Optimum
from sysid.estimation.fit.thresholds import MISFIT
from sysid.estimation.residuals.by_group import too_many
from sysid.estimation.residuals.problem import Problem
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.uncertainty.allowance_columns import allowance_columns
from sysid.estimation.uncertainty.allowances import without_friction
from sysid.estimation.uncertainty.departure_scale import PLAUSIBLE
from sysid.estimation.uncertainty.information import information_with
from sysid.estimation.uncertainty.normal_equations import NormalEquations

#: Share of the squares beyond the noise that one mistake must explain to be named.
NAMED_SHARE = 0.4
#: Another mistake that explains this fraction of the share of the best one is named with it.
AS_GOOD = 0.8
#: Candidates that are looked at together: what their columns take in memory.
_AT_ONCE = 12


@dataclass(frozen=True)
class MistakeScore:
    """A possible mistake: the `share` of the squares beyond the noise that it explains, and its `amplitude`.

    The amplitude is 1 if one linear step goes exactly as far as the full mistake.
    """

    candidate: MistakeCandidate
    share: float
    amplitude: float

    @property
    def whole(self) -> bool:
        """Whether one linear step goes about as far as the full mistake."""
        return self.candidate.is_whole(self.amplitude)


def mistake_scores(campaign: Campaign, optimum: Optimum, *, whatever_left: bool = False) -> tuple[MistakeScore, ...]:
    """Score test of every possible mistake, the largest share first; none where residuals are those of the noise.

    With `whatever_left` also where they are below :data:`MISFIT`, if they are above the noise at all.
    """
    problem = optimum.problem.with_weights(_plain_weights(optimum))
    model = problem.model
    (total, count), least = _squares(problem, optimum.vector), _least(whatever_left)
    if total < least * count:
        return ()
    allowances = without_friction(campaign, model.parameters, model.felt)
    plausible = [PLAUSIBLE[d.kind] for d in allowances.departures.directions]
    sd = np.concatenate([allowances.masses.sd, plausible])
    values, motion = problem.unpack(optimum.vector)
    prior_pull, prior = model.parameters.prior_pull(values)
    known = allowance_columns(model, allowances, problem.weights, values, motion)
    directions = iter(Directions(campaign, model, problem.weights, values, motion))
    scored = []
    at_once = _AT_ONCE if not too_many(model, _AT_ONCE) else 1
    while chosen := list(islice(directions, at_once)):
        data = information_with(campaign, problem, optimum.vector, *known, *(columns for _, columns in chosen))
        with_candidates = np.concatenate([sd, np.full(len(chosen), np.inf)])
        equations = NormalEquations.of(data.matrix, data.score, prior=prior, pull=prior_pull, sd=with_candidates)
        all_else = slice(problem.count + sd.size)
        left = total - 2.0 * equations.only(all_else).gain - count
        if left <= (least - 1.0) * count:
            break
        tests = zip(*equations.eliminate(all_else).left.score_tests(), strict=True)
        for (candidate, _), (gain, amplitude) in zip(chosen, tests, strict=True):
            scored.append(MistakeScore(candidate, float(gain) / left, float(amplitude)))
    problem.forget()
    return _best_sizes(scored)


def leaves_more_than_noise(optimum: Optimum, *, whatever_left: bool = False) -> bool:
    """Whether residuals are so far above the noise that a mistake is looked for, as in :func:`mistake_scores`."""
    problem = optimum.problem.with_weights(_plain_weights(optimum))
    total, count = _squares(problem, optimum.vector)
    problem.forget()
    return total >= _least(whatever_left) * count


def _least(whatever_left: bool) -> float:
    return 1.0 if whatever_left else MISFIT**2


def _squares(problem: Problem, vector: UnknownsOfFit) -> tuple[float, float]:
    """Sum of squares of the residuals, and the number of readings behind it."""
    lins = problem.linearise(vector)
    total = sum(float(np.sum(np.asarray(r) ** 2)) for lin in lins for r in (lin.residual, lin.gain_residual))
    count = sum(
        float(group.measured[:, np.isfinite(noise)].sum())
        for group, noise in zip(problem.model.groups, problem.weights.noise_sd, strict=True)
    )
    return total, count


def _best_sizes(scores: Sequence[MistakeScore]) -> tuple[MistakeScore, ...]:
    """The best size of every mistake, the largest share first; a size reached by one full step is preferred."""
    best: dict[MistakeCandidate, MistakeScore] = {}
    for score in sorted(scores, key=lambda s: (s.whole, s.share)):
        best[replace(score.candidate, size=0.0, hz=0.0)] = score
    return tuple(sorted(best.values(), key=lambda s: -s.share))


def _plain_weights(optimum: Optimum) -> Weights:
    """Noise of the instruments, or of the rolling truck if that is larger, for all readings."""
    noise = tuple(np.maximum(i, r) for i, r in zip(optimum.instrument, optimum.rolling, strict=True))
    known = tuple(
        np.where(np.isfinite(n) & (n > 0.0) & np.isfinite(used), n, np.inf)
        for n, used in zip(noise, optimum.problem.weights.noise_sd, strict=True)
    )
    return Weights(known, tuple(np.ones_like(n) for n in known))


def likely_mistake(campaign: Campaign, optimum: Optimum, *, whatever_left: bool = False) -> tuple[Cause, ...]:
    """The one mistake that explains most of the misfit, none where none explains a large share.

    Parameters
    ----------
    campaign : as fitted.
    optimum : of the laws that were chosen.
    whatever_left : whether it is looked for in residuals near the noise, too.
    """
    return named_mistake(campaign, mistake_scores(campaign, optimum, whatever_left=whatever_left))


def named_mistake(campaign: Campaign, scores: Sequence[MistakeScore]) -> tuple[Cause, ...]:
    """The cause that scores name, the largest share first; none or one."""
    possible = [s for s in scores if s.whole]
    if not possible or possible[0].share < NAMED_SHARE:
        return ()
    best = possible[0]
    rivals = [s for s in possible[1:] if s.share > AS_GOOD * best.share]
    if len(rivals) > 1:
        return ()
    percent = f"{100.0 * min(best.share, 1.0):.0f} %"
    sentence = (
        f"One mistake would explain {percent} of what the residuals hold beyond the noise: probably "
        f"{best.candidate.at(best.amplitude).sentence(campaign)}."
    )
    for rival in rivals:
        share = f"{100.0 * min(rival.share, 1.0):.0f} %"
        sentence += f" It may as well ({share}) be that {rival.candidate.at(rival.amplitude).sentence(campaign)}."
    return (Cause(best.candidate.cause, sentence),)
