"""What is known of each axle so far, whether that is enough, and which test comes next; all from `result.json`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from sysid.display import Z90
from sysid.sdof.averages import mean_with_scatter
from sysid.watch.records import AxleState, KnownAxle, KnownValue, PlannedTest, StopRule
from sysid.wording import shorten

#: From the best to the worst.
_STATES: tuple[AxleState, ...] = ("known", "wide", "unknown")
_QUANTITIES = ("stiffness", "damping")
_SYMBOLS = {"stiffness": "k", "damping": "c"}
#: Reasons against k and c that no further quiet time mends: values may be wrong by more than their intervals.
_FORBIDS = frozenset(
    ("parts_disagree", "balance_disagrees", "unexplained", "impossible_value", "not_converged", "no_fit")
)

#: Quantities that are not known and named.
_NAMED = 4
#: A run that lowers what is missing by less than this share is not worth naming.
_WORTH = 0.05

#: k or c of one axle (from 1) in one load case (None: in all) by its quantity.
Place = tuple[int, str | None, str]


def of_document(document: Mapping[str, Any], older: bool = False) -> dict[Place, KnownValue]:
    """Stiffness and damping in a `result.json`: those of the fit, where there is none those of the force balance.

    Parameters
    ----------
    older : whether it is of fewer logs than are there.
    """
    known: dict[Place, KnownValue] = {}
    for e in (document.get("balance") or {}).get("estimates", ()):
        if e["determined"] and e["quantity"] in _QUANTITIES and e["value"]:
            half = (e["q95"] - e["q05"]) / (2.0 * e["value"])
            known[e["axle"], e["load_case"], e["quantity"]] = KnownValue(e["value"], half, "balance", older)
    fitted: dict[Place, KnownValue] = {}
    for p in document.get("parameters", ()):
        value, sd = p["least_squares"]["value"], p["least_squares"]["sd"]
        if p["quantity"] in _QUANTITIES and p["run"] is None and p["axle"] and p["identified"] and value and sd:
            fitted[p["axle"], p["load_case"], p["quantity"]] = KnownValue(value, Z90 * sd / value, "fit", older)
    replaced = {(axle, quantity) for axle, _, quantity in fitted}
    return {place: v for place, v in known.items() if (place[0], place[2]) not in replaced} | fitted


def of_drops(documents: Iterable[Mapping[str, Any]]) -> dict[Place, KnownValue]:
    """Mean of the drops of every axle and load case by the free decay, from one `result.json` for each drop."""
    single: dict[Place, list[tuple[float, float]]] = {}
    for document in documents:
        for e in document.get("drops", ()):
            if e["file"] is None or e["method"] != "free_decay" or not e["usable"]:
                continue
            for quantity in _QUANTITIES:
                value, sd = e[quantity], e[f"{quantity}_sd"]
                if value and sd:
                    single.setdefault((e["axle"], e["load_case"], quantity), []).append((value, sd))
    known = {}
    for place, values in single.items():
        value, sd = np.array(values).T
        # What the drops of an axle share, masses and models, does not average out.
        mean, error = mean_with_scatter(value, np.diag(sd**2))
        known[place] = KnownValue(float(mean), Z90 * max(float(error), float(sd.min())) / float(mean), "drops")
    return known


def known_axles(names: Sequence[str], *sources: Mapping[Place, KnownValue]) -> tuple[KnownAxle, ...]:
    """Rows front to rear; of the sources the first one that knows a quantity of an axle decides it.

    Parameters
    ----------
    names : of the axles.
    """
    rows: list[KnownAxle] = []
    for axle, name in enumerate(names, start=1):
        values: dict[tuple[str | None, str], KnownValue] = {}
        for quantity in _QUANTITIES:
            found = next((s for s in sources if any((p[0], p[2]) == (axle, quantity) for p in s)), {})
            values |= {(p[1], p[2]): v for p, v in found.items() if (p[0], p[2]) == (axle, quantity)}
        cases = list(dict.fromkeys(case for case, _ in values))
        own: list[str | None] = [case for case in cases if case is not None]
        for case in own or [None]:
            k, c = (values.get((case, q)) or values.get((None, q)) for q in _QUANTITIES)
            rows.append(KnownAxle(axle, name, case, k, c))
    return tuple(rows)


def axle_states(known: Sequence[KnownAxle], rule: StopRule) -> dict[int, AxleState]:
    """What is known of each axle (from 1), the least of k and c in any load case."""
    states: dict[int, AxleState] = {}
    for row in known:
        values = ((row.stiffness, rule.stiffness), (row.damping, rule.damping))
        state: AxleState = "known"
        if any(value is None for value, _ in values):
            state = "unknown"
        elif not all(value is not None and value.half_width <= asked for value, asked in values):
            state = "wide"
        states[row.axle] = max(states.get(row.axle, "known"), state, key=_STATES.index)
    return states


def missing(
    known: Sequence[KnownAxle],
    rule: StopRule,
    document: Mapping[str, Any],
    planned: Sequence[PlannedTest],
    load_cases: Sequence[str],
    waits: Sequence[str],
) -> tuple[str, ...]:
    """Why the day is not at its end; nothing where all that is asked for is known.

    Parameters
    ----------
    document : `result.json` of all that is there, empty where it has not been computed; waits : what is still to come
        or to be filled in.
    """
    said = list(waits)
    driven = {test.load_case for test in planned if test.there and test.kind == "bump_run"}
    said += [f"No run in load case '{shorten(case)}'." for case in load_cases if case not in driven]
    said += _too_wide(known, {"stiffness": rule.stiffness, "damping": rule.damping})
    if not document.get("parameters"):
        said.append("No fit of all that is there has ended yet.")
        return tuple(said)
    verdict = document.get("verdict") or {}
    for kind, reason in zip(verdict.get("kinds", ()), verdict.get("reasons", ()), strict=False):
        if kind in _FORBIDS:
            said.append(str(reason))
    return tuple(said)


def _too_wide(known: Sequence[KnownAxle], asked: Mapping[str, float]) -> list[str]:
    """What is not known, in one sentence, and what is known too little, the worst first."""
    unknown, wide = [], []
    for row in known:
        case = "" if row.load_case is None else f" ({shorten(row.load_case)})"
        for quantity in _QUANTITIES:
            value: KnownValue | None = getattr(row, quantity)
            name = f"{_SYMBOLS[quantity]} of axle {row.axle}{case}"
            if value is None:
                unknown.append(name)
            elif not value.half_width <= asked[quantity]:
                text = f"{name} is known within {_percent(value)}; asked: {100.0 * asked[quantity]:g} %."
                wide.append((value.half_width / asked[quantity], text))
    said = [f"Not known: {', '.join(unknown[:_NAMED])}{', ...' if len(unknown) > _NAMED else ''}."] if unknown else []
    return said + [text for _, text in sorted(wide, reverse=True)]


def next_tests(
    planned: Sequence[PlannedTest], document: Mapping[str, Any], enough: bool, rule: StopRule
) -> tuple[str, ...]:
    """What to do next, in sentences: the test that the list has next, the run that helps most, what the advice says."""
    if enough:
        return ("Enough: stop. What was asked for is known.",)
    to_come = [test for test in planned if not test.there]
    said = [f"Next in the list: {to_come[0].words} ({len(to_come)} to come)."] if to_come else []
    advice = document.get("advice") or {}
    said += _most_useful_run(advice, document.get("parameters", ()), rule)
    said += [str(sentence) for sentence in advice.get("statements", ())]
    return tuple(said)


def _most_useful_run(
    advice: Mapping[str, Any], parameters: Sequence[Mapping[str, Any]], rule: StopRule
) -> tuple[str, ...]:
    """The run after which least is missing: the sum by which half widths exceed what is asked, in shares of it."""
    asked = {p["name"]: getattr(rule, p["quantity"]) for p in parameters if p["quantity"] in _QUANTITIES}

    def over(row: Mapping[str, Any]) -> dict[str, float]:
        known = row.get("relative_sd", {})
        return {name: Z90 * sd / asked[name] for name, sd in known.items() if name in asked}

    def missing_after(row: Mapping[str, Any]) -> float:
        return sum(max(ratio - 1.0, 0.0) for ratio in over(row).values())

    now, runs = advice.get("now", {}), advice.get("runs", ())
    best: Mapping[str, Any] = min(runs, key=missing_after, default={})
    if not missing_after(best) < (1.0 - _WORTH) * missing_after(now):
        return ()
    ratios, then = over(now), over(best)
    worst = max(ratios, key=lambda name: ratios[name])
    before, after, limit = (100.0 * asked[worst] * r for r in (ratios[worst], then[worst], 1.0))
    return (
        f"The run that would bring most of what is asked: {best['speed_km_h']:.4g} km/h, {shorten(best['load_case'])} "
        f"({worst} from ± {before:.2g} % to ± {after:.2g} %; asked: {limit:g} %).",
    )


def _percent(value: KnownValue) -> str:
    return f"± {100.0 * value.half_width:.2g} %" if math.isfinite(value.half_width) else "no bounds"
