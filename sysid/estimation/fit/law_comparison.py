"""Which suspension laws the data support: linear ones against richer families, by an information criterion.

Two sets of laws are compared under the same weights and footprint maps, those of the richest one:

    gain = 2 (cost_poor - cost_rich) - (p_rich - p_poor) ln n

where cost is half the sum of squares with priors, masses and tires may be slightly wrong
(:mod:`sysid.estimation.fit.law_evidence`), and n is the number of residuals over their variance inflation. This is the
difference of the Bayesian information criterion (G. Schwarz, Estimating the dimension of a model, Annals of Statistics
6 (1978), doi:10.1214/aos/1176344136) with an effective sample size; a gain above 10 counts as decisive (R. E. Kass and
A. E. Raftery, Bayes factors, JASA 90 (1995), doi:10.1080/01621459.1995.10476572).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from sysid.campaign.records import Campaign
from sysid.campaign.vehicle_records import Vehicle
from sysid.estimation.fit.fit_result import LawComparison, LawTrial, UndecidedLaw
from sysid.estimation.fit.law_evidence import Judged, LawEvidence
from sysid.estimation.fit.law_screen import deciding_gain, promising
from sysid.estimation.fit.optimum import Optimum, effective_residuals
from sysid.estimation.fit.search_plan import base, first_sight, rough_trial, trial
from sysid.estimation.fit.stop_search import (
    axles_with,
    with_nearer_stops,
    with_released_stops,
    with_stops_that_act,
    without_on_axle,
)
from sysid.estimation.fit.thresholds import DECISIVE
from sysid.estimation.fit.undecided_laws import WORDS, by_score, by_trial, family_words
from sysid.estimation.parameters.law_families import (
    BILINEAR_FAMILIES,
    FAMILIES,
    HELPER,
    LEAF_FRICTION,
    STOPS,
    Laws,
    with_elements,
    with_plain_friction,
    without_family,
    without_knees,
)
from sysid.estimation.parameters.suspension_elements import law_name, quantities
from sysid.estimation.weights.reweighting import reweighted

#: How much clearer than decisive a test has to be for a fit without an element to be left out.
SURE = 5.0
#: All elements that were added, in words.
_ALL = "anything but the laws of the campaign file"


def compare_laws(
    campaign: Campaign,
    poor_laws: Laws,
    rich_laws: Laws,
    poor: Optimum,
    fitted: Callable[..., Optimum],
    *,
    preview: bool = False,
) -> tuple[Optimum, LawComparison]:
    """The preferred laws' optimum and all trials; every gain is over the laws of the campaign file.

    For a `preview`, elements with a decisive expected gain are added and those that Wald's test finds needless are
    removed, without a trial of each.
    """
    richest = rich_laws
    rich_laws, rich = _enriched(campaign, poor_laws, rich_laws, poor, fitted, preview)
    if rich is None:
        optimum = fitted(poor_laws, poor)
        cost, names = optimum.minimum.cost, _names(poor_laws)
        trial = LawTrial(names, optimum.problem.count, cost, optimum.misfit, 0.0)
        return optimum, LawComparison((trial,), names, by_score(campaign, poor_laws, richest, optimum, ()))
    size = effective_residuals(rich)
    if preview:
        laws = _without_needless(LawEvidence(campaign, rich).judge(rich), rich_laws, _poorer(campaign, poor_laws), size)
        chosen = rich if laws == rich_laws else fitted(laws, rich, first_sight)
        names = _names(laws)
        trial = LawTrial(names, chosen.problem.count, chosen.minimum.cost, chosen.misfit, float("nan"))
        return chosen, LawComparison((trial,), names, untried=True)
    trials = _Trials(LawEvidence(campaign, rich), fitted, rich_laws, rich, poor_laws, poor, size)
    for poorer, words, deciding in _poorer(campaign, poor_laws):
        trials.judge_without(poorer(trials.laws), words, deciding)
    acting = with_stops_that_act(trials.laws, trials.best.optimum)
    trials.take(tuple(law | (given & {STOPS}) for law, given in zip(acting, poor_laws, strict=True)))
    # One axle may reach its stops, or have helper leaves, and another not: each has to show its own.
    for element, words in ((HELPER, "helper leaves"), (STOPS, "stops within the travel that the runs reach")):
        for axle in axles_with(element, campaign.vehicle, trials.laws, poor_laws):
            without = without_on_axle(element, campaign.vehicle, trials.laws, axle)
            trials.judge_without(without, f"{words} (axle {axle + 1})")
    laws, undecided = trials.chosen()
    if laws == rich_laws and trials.best.optimum is rich and rich.minimum.converged:
        chosen = rich
    else:
        # Trials ran under the rich laws' weights and maps; the result stands on its own.
        chosen = fitted(laws, poor if laws == poor_laws else trials.best.optimum)
    undecided += by_score(campaign, laws, richest, chosen, _families_in(campaign.vehicle, rich_laws))
    return chosen, LawComparison(tuple(trials.made), _names(laws), undecided)


#: Laws without what they may lack, what that is in words, and the gain that decides for it.
Poorer: TypeAlias = tuple[Callable[[Laws], Laws], str, float]


def _poorer(campaign: Campaign, declared: Laws) -> Iterator[Poorer]:
    """What laws may lack, in the order in which it is judged."""
    axles = campaign.vehicle.axles
    plain = deciding_gain((LEAF_FRICTION, "leaf"))
    yield partial(with_plain_friction, declared=declared), WORDS[LEAF_FRICTION], plain
    for family in FAMILIES:
        without = partial(without_family, axles, declared=declared, family=family)
        yield without, family_words(family), deciding_gain(family)
    yield partial(without_knees, declared=declared), "knees in the laws of dampers", DECISIVE
    for family in BILINEAR_FAMILIES:
        yield partial(without_family, axles, declared=declared, family=family), family_words(family), DECISIVE


def _without_needless(judged: Judged, laws: Laws, poorer: Iterable[Poorer], size: float) -> Laws:
    """The laws without elements of which Wald's test says that the criterion is no worse without them."""
    kept, lost = laws, 0.0
    for without, _, deciding in poorer:
        less = without(kept)
        if less == kept:
            continue
        removed = _removed(judged, laws, less)
        with_it = removed.rise - removed.count * np.log(size)
        if with_it - lost < deciding:
            kept, lost = less, with_it
    return kept


class _Trials:
    """Laws that are judged one after the other against those of the campaign file, and the best so far."""

    def __init__(
        self,
        data: LawEvidence,
        fitted: Callable[..., Optimum],
        rich_laws: Laws,
        rich: Optimum,
        poor_laws: Laws,
        poor: Optimum,
        size: float,
    ):
        self._data, self._fitted, self._poor_laws, self._size = data, fitted, poor_laws, size
        # Under the weights and maps of the rich laws, as all trials.
        self.laws, self.best = rich_laws, data.judge(rich)
        # If the result is clear, the cost of the poor laws need not be known exactly.
        sure = _sure(self.best, rich_laws, poor_laws, size)
        self._base = data.judge(fitted(poor_laws, rich, rough_trial if sure else trial))
        names, cost = _names(poor_laws), self._base.evidence.cost
        self.made = [LawTrial(names, self._base.count, cost, poor.misfit, 0.0)]
        self.made.append(_trial(rich_laws, self.best, self._gain(self._base, self.best)))
        self._judged: set[tuple[Laws, Laws]] = set()
        self._open: list[tuple[Laws, UndecidedLaw]] = []
        # What decides between the best laws and those of the campaign file.
        self._left_to_all, self._deciding = False, DECISIVE

    def _gain(self, other: Judged, optimum: Judged) -> float:
        extra = optimum.count - other.count
        return float(2.0 * (other.evidence.cost - optimum.evidence.cost) - extra * np.log(self._size))

    def judge_without(self, laws: Laws, words: str, deciding: float = DECISIVE) -> None:
        """Take poorer laws unless the criterion becomes worse by what decides; `words` for what they lack."""
        if laws == self.laws or (self.laws, laws) in self._judged:
            return
        if laws == self._poor_laws:
            # The best laws as a whole are compared with these in the end.
            self._left_to_all, self._deciding = True, deciding
            return
        if _sure(self.best, self.laws, laws, self._size):
            return
        self._judged.add((self.laws, laws))
        candidate = self._fit(laws)
        gain = self._gain(candidate, self.best)
        lacks = tuple(more - less for more, less in zip(self.laws, laws, strict=True))
        self._open += [(lacks, law) for law in by_trial(words, candidate, self.best, gain, deciding)]
        if gain < deciding:
            self.laws, self.best = laws, candidate

    def take(self, laws: Laws) -> None:
        """Take other laws for reasons of their own."""
        if laws != self.laws:
            self.laws, self.best = laws, self._fit(laws)

    def _fit(self, laws: Laws) -> Judged:
        candidate = self._data.judge(self._fitted(laws, self.best.optimum, trial))
        self.made.append(_trial(laws, candidate, self._gain(self._base, candidate)))
        return candidate

    def chosen(self) -> tuple[Laws, tuple[UndecidedLaw, ...]]:
        """The laws of the campaign file or the best of the trials, and what is not decided about them."""
        gain = self._gain(self._base, self.best)
        of_all = by_trial(_ALL, self._base, self.best, gain, self._deciding)
        if gain < self._deciding:
            return self._poor_laws, of_all
        # What a later trial has changed is no longer open.
        kept = [law for lacks, law in self._open if _still_so(lacks, law.is_chosen, self.laws)]
        return self.laws, (*kept, *(of_all if self._left_to_all else ()))


def _still_so(elements: Laws, has: bool, laws: Laws) -> bool:
    """Whether all axles of the laws have the elements of a trial, or none has."""
    pairs = zip(elements, laws, strict=True)
    return all(one <= law for one, law in pairs) if has else not any(one & law for one, law in pairs)


def _families_in(vehicle: Vehicle, laws: Laws) -> tuple[tuple[str, str], ...]:
    """Families of which some axle has the element."""
    found = {(e, axle.suspension) for axle, law in zip(vehicle.axles, laws, strict=True) for e in law}
    return tuple(f for f in FAMILIES if f in found)


def _enriched(
    campaign: Campaign, laws: Laws, rich_laws: Laws, optimum: Optimum, fitted: Callable[..., Optimum], preview: bool
) -> tuple[Laws, Optimum | None]:
    """Laws with all elements that have a decisive expected gain, and their optimum; None if there is no such element.

    Expected gains are computed again at the optimum of the laws with the largest expected gain.
    """
    start = laws
    while True:
        added = promising(campaign, laws, rich_laws, optimum)
        if not added:
            break
        if any(STOPS in more for more in added):
            # Other elements imitate a stop that is not there yet, and then hide its travel from the search.
            added = tuple(more & {STOPS} for more in added)
        laws = with_elements(laws, added)
        optimum = fitted(laws, optimum, first_sight)
        if any(STOPS in more for more in added):
            optimum = with_nearer_stops(laws, optimum, fitted)
    if laws == start:
        return laws, None
    if preview:
        return laws, optimum
    return laws, with_released_stops(laws, fitted(laws, optimum, base), fitted)


@dataclass(frozen=True)
class _Removed:
    """What laws lose without some elements: `count` parameters, of which `decisive` have neutral values that switch an
    element off, and the expected `rise` of twice the cost; infinite where no value does.
    """

    count: int
    decisive: int
    rise: float


def _removed(judged: Judged, laws: Laws, without: Laws) -> _Removed:
    """What the laws of an optimum lose that others do not have.

    By Wald's test (A. Wald, Tests of statistical hypotheses concerning several parameters, Transactions of the American
    Mathematical Society 54 (1943), doi:10.1090/S0002-9947-1943-0012401-3) the sum of squares would rise by (v - n)'
    C^-1 (v - n). v are the values of their parameters with covariance C, and n the neutral values, with which the
    elements have no effect.
    """
    had, kept = ([frozenset(quantities(law)) for law in side] for side in (laws, without))
    # A shared parameter goes with the last axle that has it.
    gone_everywhere = frozenset().union(*had).difference(*kept)
    optimum = judged.optimum
    parameters = optimum.problem.model.parameters.parameters
    count, index, distance = 0, [], []
    for position, p in enumerate(parameters):
        gone = gone_everywhere if p.axle is None else had[p.axle] - kept[p.axle]
        of_element = next((q for q in gone if q.quantity == p.quantity), None)
        if of_element is None:
            continue
        count += 1
        if of_element.decides:
            index.append(position)
            # Relative to the value, as the covariance of its logarithm is.
            distance.append(1.0 - of_element.neutral / float(np.exp(optimum.vector[position])))
    if not index:
        return _Removed(count, 0, np.inf)
    covariance = judged.evidence.covariance[np.ix_(index, index)]
    return _Removed(count, len(index), float(np.array(distance) @ np.linalg.solve(covariance, distance)))


def _sure(judged: Judged, laws: Laws, without: Laws, size: float) -> bool:
    """Whether elements are clearly needed, so that no fit without them has to be made.

    Far from the optimum the cost is not a parabola, so only :data:`SURE` times the deciding value is clear.
    """
    removed = _removed(judged, laws, without)
    expected = SURE * (DECISIVE + removed.decisive * np.log(size))
    return bool(removed.decisive and removed.rise > expected)


def _names(laws: Laws) -> tuple[str, ...]:
    return tuple(law_name(law) for law in laws)


def _trial(laws: Laws, judged: Judged, gain: float) -> LawTrial:
    optimum, problem = judged.optimum, judged.optimum.problem
    weights = reweighted(problem, problem.linearise(optimum.vector))
    problem.forget()
    misfit = replace(optimum, problem=problem.with_weights(weights)).misfit
    return LawTrial(_names(laws), problem.count, judged.evidence.cost, misfit, gain)
