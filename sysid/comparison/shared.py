"""Which errors two campaigns share: masses that were declared once, one weighing, one scale, the tires of one truck."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from sysid.comparison.stored import StoredError, StoredResult
from sysid.numbers import listing

#: Positions of axles of one truck in two campaign files differ by less [m].
_SAME_PLACE_M = 0.05
#: Declared values of one property in two campaign files differ by less than this share.
_SAME_VALUE = 1e-6
#: Errors that two campaigns estimate as far apart as would happen by chance with this probability are not shared.
_APART = 1e-3
#: Campaigns are compared along directions in which the data of both take at least this share of the prior variance
#: away: where one says nothing, it contradicts nobody.
_SAID = 0.1
#: What is bound to the load on the truck, and so to its weighing.
_OF_LOAD = ("axle_load_factor", "pitch_inertia_factor", "cg_height_factor")
_SCALE = "axle_load_scale_factor"
_TIRES = ("envelope", "footprint", "spokes", "tire_load", "tire_damping")
_WORDS = {
    "unsprung_mass_factor": "unsprung masses",
    "hitch_height_factor": "hitch heights",
    "axle_load_factor": "weighed axle loads",
    "pitch_inertia_factor": "pitch inertias",
    "cg_height_factor": "heights of centres of gravity",
    _SCALE: "the scale",
}


@dataclass(frozen=True)
class SharedErrors:
    """Pairs of indices (first, second) of errors that are one, in words; `remarks` say what is not and why.

    `undecided` says in words why nothing is called changed, empty where that can be said. If the campaigns do not agree
    on the masses, one of them carried another load than its file says, or a fit ended where it should not have: neither
    is a change of a suspension.
    """

    pairs: tuple[tuple[int, int], ...]
    words: tuple[str, ...]
    remarks: tuple[str, ...]
    undecided: str = ""


def one_truck(first: StoredResult, second: StoredResult) -> tuple[bool, str]:
    """Whether two campaigns are of one truck, and a sentence that says why."""
    a, b = first.test.get("vehicle_id"), second.test.get("vehicle_id")
    if a and b:
        return a == b, f"Both are of truck {a}." if a == b else f"The trucks are {a} and {b}."
    same = len(first.x_m) == len(second.x_m) and bool(
        np.all(np.abs(np.array(first.x_m) - np.array(second.x_m)) < _SAME_PLACE_M)
    )
    if not same:
        return False, "Number or positions of the axles differ: these are two trucks."
    return (
        True,
        "Both are taken for one truck, as their axles are at the same places; vehicle_id in [campaign] says it.",
    )


def shared_errors(first: StoredResult, second: StoredResult, same_truck: bool) -> SharedErrors:
    """Errors that both campaigns have in common.

    Parameters
    ----------
    same_truck : whether both are of one truck.
    """
    weighings = _one_weighing(first, second) if same_truck else []
    scale = bool(weighings) or _same_name(first, second, "scale")
    pairs: list[tuple[int, int]] = []
    taken: set[int] = set()
    for i, a in enumerate(first.errors):
        if (a.kind == _SCALE and not scale) or (a.kind != _SCALE and not same_truck):
            continue
        for j, b in enumerate(second.errors):
            if j not in taken and _is_one(a, b, weighings):
                pairs.append((i, j))
                taken.add(j)
                break
    remarks = []
    if same_truck and not weighings:
        known = "" if scale else "; if one scale weighed both, give it one name with scale in [campaign] of both"
        remarks.append(f"The axle loads of no load case are the same in both: weighed anew{known}.")
    kept = _not_apart(first, second, pairs, remarks)
    kinds = dict.fromkeys(first.errors[i].kind for i, _ in kept)
    words = [w for kind, w in _WORDS.items() if kind in kinds]
    if any(kind in _TIRES for kind in kinds):
        words.append("contact of the tires with the bump")
    contradict = any(first.errors[i].kind in _WORDS for i in {i for i, _ in pairs} - {i for i, _ in kept})
    undecided = "the campaigns contradict each other about the masses" if contradict else ""
    return SharedErrors(tuple(kept), tuple(words), tuple(remarks), undecided)


def _same_name(first: StoredResult, second: StoredResult, key: str) -> bool:
    return bool(first.test.get(key)) and first.test.get(key) == second.test.get(key)


def _one_weighing(first: StoredResult, second: StoredResult) -> list[tuple[str, str]]:
    """Load cases (first, second) with the same readings of the scale for every axle."""
    return [
        (a, b)
        for a, loads in first.axle_loads_kg.items()
        for b, others in second.axle_loads_kg.items()
        if np.allclose(loads, others, rtol=_SAME_VALUE, atol=0.0)
        and (a == b or (a not in second.axle_loads_kg and b not in first.axle_loads_kg))
    ]


def _is_one(a: StoredError, b: StoredError, weighings: Sequence[tuple[str, str]]) -> bool:
    if (a.kind, a.beam, a.place) != (b.kind, b.beam, b.place):
        return False
    if abs(a.declared - b.declared) > _SAME_VALUE * abs(a.declared):
        return False
    if a.kind in _OF_LOAD and not weighings:
        return False
    # What holds for all load cases of a campaign is bound to any of them.
    cases = [(x, y) for x, y in weighings if a.load_case in (None, x) and b.load_case in (None, y)]
    return bool(cases) or (a.load_case is None and b.load_case is None and a.kind not in _OF_LOAD)


def _not_apart(
    first: StoredResult, second: StoredResult, pairs: Sequence[tuple[int, int]], remarks: list[str]
) -> list[tuple[int, int]]:
    """The pairs without kinds of errors on which the campaigns do not agree.

    With H_a, H_b the information of both about common errors w ~ N(0, I) in units of their prior, the estimates Y_a h_a
    and Y_b h_b, Y = (H + I)^-1, differ by u ~ N(0, M M' + Y_a H_a Y_a + Y_b H_b Y_b), M = Y_a H_a - Y_b H_b.
    """
    kept = list(pairs)
    for kinds, words in ((_TIRES, "the tires' contact"), ((*_WORDS,), "the masses")):
        of_kind = [(i, j) for i, j in kept if first.errors[i].kind in kinds]
        if not of_kind:
            continue
        rows, columns = (list(index) for index in zip(*of_kind, strict=True))
        prior_sd = np.array([max(first.errors[i].sd, second.errors[j].sd) for i, j in of_kind])
        one, other = _said(first, rows, prior_sd), _said(second, columns, prior_sd)
        apart = one.taken - other.taken
        spread = apart @ apart.T + one.spread + other.spread
        # The parallel sum of two matrices: small where either is.
        both, directions = np.linalg.eigh(2.0 * one.taken @ np.linalg.pinv(one.taken + other.taken) @ other.taken)
        seen = directions[:, both > _SAID]
        difference = seen.T @ (one.estimate - other.estimate)
        square = float(difference @ np.linalg.solve(seen.T @ spread @ seen, difference)) if seen.size else 0.0
        if seen.size and chi2.sf(square, seen.shape[1]) < _APART:
            names = listing(
                [w for kind, w in _WORDS.items() if kind in {first.errors[i].kind for i in rows}] or [words]
            )
            remarks.append(f"The campaigns do not agree on {names}: these errors do not cancel.")
            if kinds != _TIRES:
                remarks[-1] += (
                    " Nothing of the suspensions is called changed, as another load, or a fit that went wrong, would "
                    "look the same; compare the declared masses with what was on the truck, and the reports of both."
                )
            kept = [p for p in kept if p not in of_kind]
    return kept


class _Said(NamedTuple):
    """What the data of a campaign say of s errors in units of a prior: `estimate` (s,), and (s, s) the share `taken` of
    the prior variance, Y H = I - Y, and the `spread` of the estimate about what it would be without noise, Y H Y.
    """

    estimate: np.ndarray
    taken: np.ndarray
    spread: np.ndarray


def _said(result: StoredResult, chosen: Sequence[int], prior_sd: np.ndarray) -> _Said:
    """Some errors of a campaign as they would be estimated with other prior standard deviations (s,) than its own."""
    share = np.array([result.errors[k].sd for k in chosen]) / prior_sd
    inverse = np.linalg.inv(result.error_covariance[np.ix_(chosen, chosen)])
    unit = np.eye(len(chosen))
    information = (inverse - unit) / np.outer(share, share)
    covariance = np.linalg.inv(information + unit)
    covariance = 0.5 * (covariance + covariance.T)
    score = inverse @ np.array([result.errors[k].estimate for k in chosen]) / share
    taken = unit - covariance
    return _Said(covariance @ score, taken, covariance @ taken)
