"""Expected gain of richer suspension laws, by a score test at the fit of poorer ones, without a fit of the richer ones.

Near the optimum of the poorer laws x the residuals are differentiated by the parameters z of the elements that the
richer laws add, each moved slightly from its neutral value. With masses and tires y free within their tolerances
(:mod:`sysid.estimation.fit.law_evidence`), gradient g and information H of the data,

    promised gain = g_z' (S_zz + I)^-1 g_z - p ln n,

where S is the information about z after x and y are eliminated, with z in units of its prior scale
(:mod:`sysid.estimation.uncertainty.normal_equations`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.campaign.records import Campaign
from sysid.campaign.vehicle_records import Axle, Vehicle
from sysid.estimation.fit.helper_travel import HELPER_TRAVEL, compressions_by_load, tried_helper_travel
from sysid.estimation.fit.law_evidence import LawEvidence
from sysid.estimation.fit.optimum import Optimum, effective_residuals
from sysid.estimation.fit.thresholds import DECISIVE
from sysid.estimation.parameters.axle_laws import ElementIndex, LawInputs
from sysid.estimation.parameters.law_families import FAMILIES, FRICTION, HELPER, LEAF_FRICTION, STOPS, Laws
from sysid.estimation.parameters.suspension_elements import TRAVELS, ElementQuantity, quantities
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.residuals.signals import simulate_runs
from sysid.estimation.uncertainty.residual_columns import ResidualColumns, difference_columns

#: Odds, before any data, of elements that one would not bet against: leaves that lie on each other rub, and whether
#: more under load and less while they slide fast is an even bet (assumptions).
ODDS = {(FRICTION, "leaf"): 10.0, (LEAF_FRICTION, "leaf"): 1.0}
#: Share of its prior scale by which a parameter is moved from its neutral value.
STEP = 0.1
#: Share of the largest expected gain that further elements must have to be fitted together with it.
WORTH = 0.05
#: Share of the largest travel in the runs at which a stop is tried, if that is less than usual.
INSIDE = 0.85
#: Share of the usual travel nearer than which no stop is tried: five standard deviations of its prior.
NEAREST = 0.55


@dataclass(frozen=True)
class LawCandidate:
    """A parameter that richer laws add: of one element on one axle, or shared by `axles`."""

    element: str
    quantity: ElementQuantity
    axles: tuple[int, ...]


def promising(campaign: Campaign, laws: Laws, rich_laws: Laws, optimum: Optimum) -> Laws:
    """Elements to add to every axle: families with a decisive expected gain in addition to those with a larger one.

    The expected gain assumes a parabola. So elements after the one with the largest gain must have :data:`WORTH` of
    that gain to be added before they are judged again.

    Parameters
    ----------
    laws, rich_laws : of every axle, those of `optimum` and the richest ones.

    Returns
    -------
    Elements by axle, none at all if no family has enough expected gain.
    """
    axles = campaign.vehicle.axles
    families = families_of(campaign.vehicle, laws, rich_laws)
    if not families:
        return ()
    screen, size = _screen(campaign, optimum, families), effective_residuals(optimum)
    taken: list[LawCandidate] = []
    chosen: list[tuple[str, str]] = []
    first = 0.0
    while len(chosen) < len(families):
        before = screen.gain(taken, size)
        open_ones = {f: screen.gain([*taken, *m], size) - before for f, m in families.items() if f not in chosen}
        enough = {f: g for f, g in open_ones.items() if g >= deciding_gain(f) and (not chosen or g >= WORTH * first)}
        if not enough:
            break
        best = max(enough, key=lambda f: enough[f])
        first = first or open_ones[best]
        chosen.append(best)
        taken += families[best]
    if not chosen:
        return ()
    return tuple(
        frozenset(e for e, kind in chosen if kind == axle.suspension and e in rich - law)
        for axle, law, rich in zip(axles, laws, rich_laws, strict=True)
    )


def deciding_gain(family: tuple[str, str]) -> float:
    """Gain in the information criterion from which on axles of one kind of suspension have an element.

    Twice the logarithm of the odds against it before any data; without such odds, what counts as decisive.
    """
    return -2.0 * float(np.log(ODDS[family])) if family in ODDS else DECISIVE


def largest_gain(campaign: Campaign, laws: Laws, rich_laws: Laws, optimum: Optimum) -> float:
    """Largest expected gain of one family of elements, 0 if there is none; arguments as :func:`promising`."""
    families = families_of(campaign.vehicle, laws, rich_laws)
    if not families:
        return 0.0
    screen, size = _screen(campaign, optimum, families), effective_residuals(optimum)
    return max(0.0, *(screen.gain(members, size) for members in families.values()))


def families_of(vehicle: Vehicle, laws: Laws, rich_laws: Laws) -> dict[tuple[str, str], list[LawCandidate]]:
    """Candidates by family, those that have any."""
    listed = candidates(vehicle, laws, rich_laws)
    members = {f: [c for c in listed if (c.element, vehicle.axles[c.axles[0]].suspension) == f] for f in FAMILIES}
    return {f: found for f, found in members.items() if found}


def _screen(campaign: Campaign, optimum: Optimum, families: Mapping[tuple[str, str], list[LawCandidate]]) -> Screen:
    listed = [c for members in families.values() for c in members]
    return Screen(campaign, LawEvidence(campaign, optimum), optimum, listed)


def candidates(vehicle: Vehicle, poor: Laws, rich: Laws) -> list[LawCandidate]:
    """The parameters that decide whether an element of the richer laws acts; axles of a group have one suspension.

    A shared parameter counts separately for every kind of suspension, because laws are compared in this way.
    """
    owner, listed = vehicle.suspension_axle, []
    for element in sorted(frozenset().union(*rich)):
        for q in quantities(frozenset({element})):
            # A bilinear damper has the asymmetry of one with a knee already.
            having = [i for i in range(len(owner)) if element in rich[i] - poor[i] and q not in quantities(poor[i])]
            if q.decides and q.shared:
                kinds = dict.fromkeys(vehicle.axles[i].suspension for i in having)
                alike = [tuple(i for i in having if vehicle.axles[i].suspension == kind) for kind in kinds]
                listed += [LawCandidate(element, q, members) for members in alike]
            elif q.decides:
                firsts = dict.fromkeys(owner[i] for i in having)
                together = [tuple(i for i in having if owner[i] == first) for first in firsts]
                listed += [LawCandidate(element, q, members) for members in together]
    return listed


class Screen:
    """Expected gains of candidates at one optimum of poorer laws."""

    def __init__(self, campaign: Campaign, evidence: LawEvidence, optimum: Optimum, listed: Sequence[LawCandidate]):
        self._listed = list(listed)
        reached = reached_travels(optimum) if any(c.element == STOPS for c in listed) else {}
        if any(c.element == HELPER for c in listed):
            reached |= {(HELPER_TRAVEL, axle): most for axle, most in compressions_by_load(optimum).items()}
        self._against = np.array([travel_penalty(campaign.vehicle, reached, c) for c in listed])
        columns = candidate_columns(campaign, optimum, listed, reached)
        self._equations, response = evidence.without_known(optimum, columns)
        self._response = response[: optimum.problem.count]

    def gain(self, members: Sequence[LawCandidate], size: float) -> float:
        """Expected gain of adding some of the candidates; `size` is the effective number of residuals n."""
        index = self._index(members)
        fall = 2.0 * self._equations.only(index).gain - float(self._against[index].sum())
        return fall - len(members) * float(np.log(size))

    def amounts(self, members: Sequence[LawCandidate]) -> np.ndarray:
        """Values (n,) of some of the candidates after one linear step, in units of their prior scales."""
        return self._equations.only(self._index(members)).step()

    def shift(self, members: Sequence[LawCandidate]) -> np.ndarray:
        """How far the log parameters (p,) of the optimum move if some of the candidates are added."""
        return np.asarray(self._response[:, self._index(members)] @ self.amounts(members))

    def _index(self, members: Sequence[LawCandidate]) -> list[int]:
        return [self._listed.index(c) for c in members]


def candidate_columns(
    campaign: Campaign, optimum: Optimum, listed: Sequence[LawCandidate], reached: Mapping[tuple[str, int], float]
) -> Sequence[ResidualColumns]:
    """Derivatives of every group's residuals by the candidates, in units of their prior scales.

    Parameters
    ----------
    reached : largest travels in the runs, see :func:`reached_travels`, and compressions of springs by loads.
    """
    problem = optimum.problem
    trials = [(_with_candidate(campaign, problem.model, candidate, reached), STEP) for candidate in listed]
    return difference_columns(problem.model, problem.model, problem.weights, *problem.unpack(optimum.vector), trials)


def reached_travels(optimum: Optimum) -> dict[tuple[str, int], float]:
    """Largest jounce and rebound [m] of every axle with a deflection sensor, in the runs as the optimum has them."""
    model = optimum.problem.model
    most: dict[tuple[str, int], float] = {}
    for signals in simulate_runs(model, *optimum.problem.unpack(optimum.vector)):
        for channel, axle in enumerate(model.layout.deflection_axles):
            for quantity, sign in zip(TRAVELS, (-1.0, 1.0), strict=True):
                travel = float(np.max(sign * signals[:, :, channel]))
                most[quantity, axle] = max(most.get((quantity, axle), 0.0), travel)
    return most


def tried_travel(median: float, reached: float | None) -> float:
    """Travel [m] at which a stop is tried: the usual `median`, or inside what the runs reach if that is less.

    A stop beyond it would show nothing. One that is nearer than :data:`NEAREST` of the median is not plausible.
    """
    return median if reached is None else max(min(median, INSIDE * reached), NEAREST * median)


def travel_penalty(vehicle: Vehicle, reached: Mapping[tuple[str, int], float], candidate: LawCandidate) -> float:
    """What the priors of their travels take from the gain of stops or helper leaves tried nearer than usual."""
    total = 0.0
    for q in quantities(frozenset({candidate.element})):
        for i in candidate.axles if q.quantity in (*TRAVELS, HELPER_TRAVEL) else ():
            median = q.median(vehicle.axles[i], 0.0)
            total += (np.log(_tried(q, median, reached.get((q.quantity, i))) / median) / q.sd) ** 2
    return float(total)


def _tried(q: ElementQuantity, median: float, reached: float | None) -> float:
    """Value at which a quantity is tried: the median of its prior, but for travels that the runs would not show."""
    if q.quantity in TRAVELS:
        return tried_travel(median, reached)
    return tried_helper_travel(median, reached) if q.quantity == HELPER_TRAVEL else median


def _with_candidate(
    campaign: Campaign, model: BumpModel, candidate: LawCandidate, reached: Mapping[tuple[str, int], float]
) -> BumpModel:
    """The model with one parameter moved from its neutral value."""
    axles = campaign.vehicle.axles
    return replace(
        model,
        arrays=tuple(
            old._replace(laws=old.laws._replace(elements=_elements(axles, old.laws, candidate, reached)))
            for old in model.arrays
        ),
    )


def _elements(
    axles: Sequence[Axle], laws: LawInputs, candidate: LawCandidate, reached: Mapping[tuple[str, int], float]
) -> dict[str, ElementIndex]:
    carried = (laws.carried_load / laws.load_growth)[0, :, 0]
    elements = dict(laws.elements)
    for q in quantities(frozenset({candidate.element})):
        given = elements.get(q.quantity)
        neutral = np.full(carried.size, q.neutral) if given is None else given.neutral.copy()
        for i in candidate.axles:
            median = _tried(q, q.median(axles[i], float(carried[i])), reached.get((q.quantity, i)))
            if q is candidate.quantity:
                # What is out at zero has its median as scale, what is out at one the spread of its logarithm.
                neutral[i] = STEP * median if q.neutral == 0.0 else q.neutral * _step(q, median)
            elif not q.decides:
                neutral[i] = median
        position = np.full(carried.size, -1) if given is None else given.position
        elements[q.quantity] = ElementIndex(position, neutral)
    return elements


def _step(q: ElementQuantity, median: float) -> float:
    """Factor by which a parameter that is out at one moves towards its prior median."""
    return float(np.exp(np.sign(np.log(median)) * STEP * q.sd))
