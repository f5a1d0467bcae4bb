"""Law elements about which the data do not decide: how likely they are, and how far they would move the parameters.

A law is chosen from a gain of :data:`~sysid.estimation.fit.thresholds.DECISIVE` on: there, having the element and not
having it count as equally likely. With the gain g as twice the logarithm of a Bayes factor, the element has the weight

    w = 1 / (1 + exp(-(g - DECISIVE) / 2)),

or with another deciding gain where one would bet on the element before any data
(:func:`sysid.estimation.fit.law_screen.deciding_gain`).

The parameters x of both choices differ by delta, each with masses and tires free. With the chosen ones kept as the
estimate, the choice that was not made adds w' delta delta' to their covariance, w' its weight (the second moment of the
mixture about the estimate; J. A. Hoeting et al., Bayesian model averaging: a tutorial, Statistical Science 14 (1999),
doi:10.1214/ss/1009212519).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from scipy.special import expit

from sysid.campaign.records import Campaign
from sysid.estimation.fit.fit_result import UndecidedLaw
from sysid.estimation.fit.law_evidence import Judged, LawEvidence
from sysid.estimation.fit.law_screen import LawCandidate, Screen, deciding_gain, families_of
from sysid.estimation.fit.optimum import Optimum, effective_residuals
from sysid.estimation.fit.thresholds import DECISIVE
from sysid.estimation.parameters.law_families import BILINEAR, HELPER, KNEED, LEAF_FRICTION, STOPS, Laws
from sysid.estimation.parameters.suspension_elements import ELEMENTS, quantities

#: Weight of the choice that was not made below which it is left out.
LEAST_WEIGHT = 0.05
#: Elements in words; others have the meaning of the table of elements.
WORDS = {
    "friction": "friction",
    KNEED: "dampers that are not linear",
    BILINEAR: "dampers that are not symmetric",
    "gas_spring": "springs that stiffen when compressed",
    LEAF_FRICTION: "friction that grows with the load on leaves and falls with speed",
    HELPER: "helper leaves",
    STOPS: "stops within the travels that the runs reach",
}


def weight_of(gain: float, deciding: float = DECISIVE) -> float:
    """Weight of laws with a gain over others, one half at the gain that decides."""
    return float(expit(0.5 * (gain - deciding)))


def family_words(family: tuple[str, str]) -> str:
    """A family of elements in words."""
    element, suspension = family
    return f"{WORDS.get(element, ELEMENTS[element].meaning)} ({suspension} suspensions)"


def by_trial(
    words: str, poor: Judged, rich: Judged, gain: float, deciding: float = DECISIVE
) -> tuple[UndecidedLaw, ...]:
    """Whether the data decide between the optima of two laws; `gain` of the richer one, and what decides."""
    chosen = gain >= deciding
    here, there = (rich, poor) if chosen else (poor, rich)
    other, own = _by_name(there), _by_name(here)
    names = tuple(name for name in own if name in other)
    shift = tuple(other[name] - own[name] for name in names)
    return _if_open(UndecidedLaw(words, gain, weight_of(gain, deciding), chosen, names, shift))


def by_score(
    campaign: Campaign, laws: Laws, rich_laws: Laws, optimum: Optimum, tried: Collection[tuple[str, str]]
) -> tuple[UndecidedLaw, ...]:
    """Elements that the laws of an optimum lack and that were not fitted, by a linear step from the optimum.

    Parameters
    ----------
    laws, rich_laws : of every axle, those of `optimum` and the richest ones.
    tried : families about which a fit has decided.
    """
    families = {f: members for f, members in families_of(campaign.vehicle, laws, rich_laws).items() if f not in tried}
    if not families:
        return ()
    listed = [c for members in families.values() for c in members]
    screen, size = Screen(campaign, LawEvidence(campaign, optimum), optimum, listed), effective_residuals(optimum)
    names = optimum.problem.model.parameters.names
    found: list[UndecidedLaw] = []
    for family, members in families.items():
        possible = _possible(screen, members)
        if possible:
            # As in a fit, every parameter that the elements bring counts, not only those that decide.
            gain = screen.gain(possible, size) - _further_parameters(possible) * np.log(size)
            # A linear step promises more than a fit keeps: it makes no law likelier than not.
            weight, shift = min(weight_of(gain, deciding_gain(family)), 0.5), screen.shift(possible)
            found += _if_open(UndecidedLaw(family_words(family), gain, weight, False, names, tuple(shift.tolist())))
    return tuple(found)


def spread_rows(undecided: Sequence[UndecidedLaw], names: Sequence[str]) -> np.ndarray:
    """Rows (k, p) whose squares R'R the undecided laws add to the covariance of the log parameters `names`."""
    rows = np.zeros((len(undecided), len(names)))
    for row, law in zip(rows, undecided, strict=True):
        shift = dict(zip(law.names, law.shift, strict=True))
        row[:] = np.sqrt(law.doubt) * np.array([shift.get(name, 0.0) for name in names])
    return rows


def _by_name(judged: Judged) -> dict[str, float]:
    """Log parameters with masses and tires free."""
    parameters = judged.optimum.problem.model.parameters
    values = judged.optimum.vector[: judged.optimum.problem.count] + judged.evidence.step
    return dict(zip(parameters.names, values.tolist(), strict=True))


def _further_parameters(members: Sequence[LawCandidate]) -> int:
    """Parameters of the elements of some candidates that do not decide whether the elements act."""
    rest = [q for q in quantities(frozenset(c.element for c in members)) if not q.decides]
    places = {c.axles for c in members if not c.quantity.shared}
    return sum(1 if q.shared else len(places) for q in rest)


def _if_open(law: UndecidedLaw) -> tuple[UndecidedLaw, ...]:
    return (law,) if law.doubt >= LEAST_WEIGHT else ()


def _possible(screen: Screen, members: Sequence[LawCandidate]) -> list[LawCandidate]:
    """Members without those that would go below zero: friction that pushes is no friction."""
    kept = list(members)
    while kept:
        amounts = screen.amounts(kept)
        against = [c for c, a in zip(kept, amounts, strict=True) if c.quantity.neutral == 0.0 and a < 0.0]
        if not against:
            break
        kept = [c for c in kept if c not in against]
    return kept
