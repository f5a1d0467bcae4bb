"""Whether k and c of all stages that have run may be used, and why: the verdict that every output carries.

What speaks against k and c is measured in k and c: parts of the data that disagree about them by more than chance
(:mod:`sysid.estimation.uncertainty.part_agreement`).  How large residuals are over the noise says how good the sensors
are as much as how good the model is, so it decides only where the parts are too few to tell.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

from sysid.estimates.suspension_values import AxleEstimates, Estimate, Quantity, distinct
from sysid.estimation.fit.thresholds import MISFIT
from sysid.numbers import count, listing, number, percent
from sysid.results import pass_limits
from sysid.results.contents import Judgement, ReasonKind, Results, Trust

if TYPE_CHECKING:
    from sysid.estimation.fit.fit_result import FitResult
    from sysid.estimation.uncertainty.identifiability import Identifiability
    from sysid.estimation.uncertainty.part_agreement import PartDifference

#: Half width of a 90 % interval, relative to the value, above which a parameter is called poorly known.
WIDE = 0.2
#: Most differences between parts that are named, the largest over what is accepted first.
_NAMED = 3

_SYMBOLS: tuple[tuple[Quantity, str], ...] = (("stiffness", "k"), ("damping", "c"))


class Reason(NamedTuple):
    """A reason for a verdict, by its kind and in a sentence."""

    kind: ReasonKind
    sentence: str


def judge(results: Results) -> Judgement:
    """Whether k and c may be used, and why; the severest reasons decide.

    Warnings of what was left out of the data (rows, channels, runs) are no reasons: the intervals do without it.
    """
    notes = tuple(map(in_words, _notes(results)))
    levels: tuple[tuple[Trust, list[Reason]], ...] = (
        ("not_yet", _against(results)),
        ("do_not_bet", _unexplained(results)),
        ("use_within", _limits(results)),
    )
    found = list(dict.fromkeys(reason for _, reasons in levels for reason in reasons))
    trust: Trust = next((level for level, reasons in levels if reasons), "use")
    if not found:
        found = [Reason("none", "The calibration has converged, and separate parts of the data give the same k and c.")]
    return Judgement(trust, tuple(in_words(r.sentence) for r in found), tuple(r.kind for r in found), notes)


#: What a parameter of one axle is called in a sentence, by the first part of its name.
_NOUNS = {
    "k": "k",
    "c": "c",
    "F": "the dry friction",
    "q": "the damper's asymmetry",
    "knee": "the damper's knee",
    "stop": "the bump stop",
    "kt": "the tire stiffness",
    "ct": "the tire damping",
}
# Not within names of files or columns.
_NAME = re.compile(rf"(?<![\w\[./'\-])({'|'.join(_NOUNS)})_(\d+)(?:\[([^\]]*)\])?(?![\w\['\-]|\.\w)")


def in_words(sentence: str) -> str:
    """A sentence with parameters of single axles in words: ``the bump stop of axle 1`` for ``stop_1``."""
    return _NAME.sub(
        lambda found: f"{_NOUNS[found[1]]} of axle {found[2]}" + (f" ({found[3]})" if found[3] else ""), sentence
    )


def is_misfit(residual_over_noise: float) -> bool:
    """Whether a residual, rounded as it is printed, is too large for noise; False where it is unknown."""
    return math.isfinite(residual_over_noise) and round(residual_over_noise, 2) >= MISFIT


def _against(results: Results) -> list[Reason]:
    reasons = []
    # Least squares have a sentence of their own.
    no_fit = results.fit is not None and not results.fit.converged
    if results.status == "preview":
        reasons.append(Reason("preview", "This is a preview with shortened sampling. Its intervals are not reliable."))
    elif results.status == "not_converged" and results.posterior is not None and not no_fit:
        why = results.posterior.message.rstrip(".")
        sentence = "The calibration has not converged" + (f": {why}." if why else ".")
        reasons.append(Reason("not_converged", sentence))
    if results.fit is None:
        sentence = (
            "The drop values are starting points: tires in series and coupled axles bias equations (1)–(3)."
            if results.drops is not None
            else "No stage that estimates k and c has run yet."
        )
        reasons.append(Reason("no_fit", sentence))
    elif not results.fit.converged:
        message = results.fit.message.rstrip(".")
        reasons.append(Reason("not_converged", f"The least-squares fit did not converge: {message}."))
    return reasons


def _unexplained(results: Results) -> list[Reason]:
    """Why values may be wrong by more than their intervals."""
    reasons = []
    if results.fit is not None:
        if forbidding := [d for d in results.fit.parts if d.forbids]:
            reasons.append(Reason("parts_disagree", _disagreement(forbidding)))
        elif any(d.scattered for d in results.fit.parts):
            reasons.append(Reason("parts_disagree", f"{_scatter(results.fit.parts)} Values may be wrong by more."))
        elif is_misfit(results.fit.misfit) and (untold := _untold(results)):
            reasons.append(
                Reason(
                    "unexplained",
                    f"The residuals are {number(results.fit.misfit, 2)} times the noise (median over channels): the "
                    "truck does something that the model does not describe. The data are too few to tell what this "
                    f"does to {listing(untold)}.",
                )
            )
        if reasons:
            reasons += [Reason(c.kind, c.sentence) for c in results.fit.causes]
        reasons += [Reason("impossible_value", s) for s in results.fit.impossible]
        if apart := _balance_apart(results):
            reasons.append(Reason("balance_disagrees", apart))
    if results.posterior is not None:
        reasons += [Reason("sampler", w) for w in results.posterior.against_intervals]
    return reasons


def _disagreement(differences: Iterable[PartDifference]) -> str:
    """What parts of the data say of k and c, in a sentence."""
    from sysid.estimation.uncertainty.part_agreement import ACCEPTED

    order = sorted(differences, key=lambda d: -abs(d.difference) / ACCEPTED[d.quantity])
    # The complement of a part says the same of the same parameter.
    largest = list({d.parameter: d for d in reversed(order)}.values())[::-1][:_NAMED]
    clauses = [
        f"{_parameter_words(d)} {percent(abs(math.expm1(d.difference)))} "
        f"{'higher' if d.difference > 0.0 else 'lower'} by {d.part} than by {d.rest} "
        f"(chance alone: {percent(d.sd)})"
        for d in largest
    ]
    return (
        f"Parts of the data disagree: {'; '.join(clauses)}. The truck does something that the model does not describe, "
        "and values may be wrong by more than their intervals."
    )


def _scatter(differences: Iterable[PartDifference]) -> str:
    """By how much parts of the data scatter beyond chance, in a sentence; every quantity once."""
    found = {d.quantity: d.scatter for d in differences if d.scatter > 0.0}
    clauses = [f"{symbol} by {percent(found[q])}" for q, symbol in _SYMBOLS if q in found]
    return f"Parts of the data scatter by more than chance: {listing(clauses)} (standard deviation)."


#: Elements of laws that the force balance knows, too: with others, its k and c are those of another truck.
_BALANCED = frozenset(
    {"friction", "asymmetric_damper", "bilinear_damper", "gas_spring", "damper_bushing", "estimated_bump_stops"}
)


def _balance_apart(results: Results) -> str:
    """What the force balance, which knows no road, says against k and c of the fit, in a sentence; empty if nothing."""
    clauses = _apart(results, described=True)
    if not clauses:
        return ""
    return (
        f"The balance of forces, which knows no road, finds {listing(clauses, _NAMED)} than the calibration. One of "
        "both does not describe the truck: bump and tires are in the calibration alone."
    )


def _balance_silent(results: Results) -> list[str]:
    """Where the force balance finds another k or c and lacks a law of the fit, so that it can confirm neither."""
    clauses = _apart(results, described=False)
    if not clauses:
        return []
    return [
        f"The balance of forces finds {listing(clauses, _NAMED)} than the calibration. It lacks laws or parts "
        "that the calibration has of these axles, so that it confirms none of these values."
    ]


def _apart(results: Results, described: bool) -> list[str]:
    """k and c that balance and fit find apart, of axles whose laws of the fit the balance knows, or of the others.

    Parts that the fit has found (rockers, frames, the drive) are not in the balance, nor is the time in which wheels
    hold the speed: then it knows no axle's law.
    """
    fit, balance = results.fit, results.balance
    if fit is None or balance is None or not balance.converged:
        return []
    from scipy.stats import norm

    from sysid.balance.evidence import disagreement
    from sysid.estimation.parameters.suspension_elements import law_elements
    from sysid.estimation.uncertainty.part_agreement import ACCEPTED, CHANCE

    laws = {p.axle: law_elements(p.law) for p in fit.parameters if p.quantity == "damping"}
    whole = not fit.proposals and results.campaign.vehicle.driven_at != "road"
    chosen = {
        e.name
        for e in balance.estimates
        if e.determined and (laws.get(e.axle, _BALANCED) <= _BALANCED and whole) == described
    }
    compared = [d for d in disagreement(balance, fit) if d.name in chosen]
    edge = norm.isf(0.5 * CHANCE / max(len(compared), 1))
    apart = [(d, math.log(d.balance / d.fit)) for d in compared if abs(d.in_sd) > edge]
    return [
        f"{in_words(d.name)} {percent(abs(math.expm1(x)))} {'higher' if x > 0.0 else 'lower'} "
        f"(chance alone: {percent(abs(x / d.in_sd))})"
        for d, x in apart
        if abs(x) > ACCEPTED[d.quantity]
    ]


def _parameter_words(d: PartDifference) -> str:
    name, _, case = d.parameter.partition("[")
    symbol, _, axle = name.partition("_")
    return f"{symbol} of axle {axle}" + (f" ({case.rstrip(']')})" if case else "")


def _untold(results: Results) -> list[str]:
    """Names of fitted k and c for which no division of the data would show an error of the accepted size."""
    from sysid.estimation.uncertainty.part_agreement import ACCEPTED

    assert results.fit is not None
    identified = {p.name for p in results.fit.parameters if p.identified}
    best: dict[str, PartDifference] = {}
    for d in results.fit.parts:
        if d.parameter in identified and (d.parameter not in best or d.sd < best[d.parameter].sd):
            best[d.parameter] = d
    if not results.fit.parts:
        return ["k and c"]
    return [_parameter_words(d) for d in best.values() if d.least_seen > ACCEPTED[d.quantity]]


def _limits(results: Results) -> list[Reason]:
    """Within what k and c may be used: which values are not determined, and what they rest on that is in doubt."""
    reasons = []
    if results.fit is not None and results.posterior is None:
        sentence = "The posterior has not been sampled: intervals come from the least-squares covariance."
        reasons.append(Reason("not_sampled", sentence))
    if results.fit is not None:
        reasons += [Reason("undeclared_part", s) for s in results.fit.proposals]
        reasons += [Reason(c.kind, c.sentence) for c in results.fit.causes if not c.modelled]
        reasons += [Reason("doubtful_input", s) for s in results.fit.doubts]
        if widened := [d for d in results.fit.parts if d.seen and not d.forbids]:
            sentence = _disagreement(widened).split(". ")[0]
            reasons.append(Reason("parts_disagree", f"{sentence}. The intervals are widened by as much."))
        elif not any(d.forbids for d in results.fit.parts) and any(d.scatter > 0.0 for d in results.fit.parts):
            sentence = f"{_scatter(results.fit.parts)} The intervals are widened by half as much."
            reasons.append(Reason("parts_disagree", sentence))
    if results.quality is not None:
        reasons += [Reason("doubtful_input", s) for s in results.quality.contradictions]
    if names := unidentified_values(results):
        sentence = f"The data do not determine {listing(names)}: these values repeat the prior."
        reasons.append(Reason("undetermined", sentence))
    if wide := _wide(results):
        sentence = f"The 90\u00a0% interval is wider than \u00b1{percent(WIDE)} for {listing(wide)}."
        reasons.append(Reason("wide", sentence))
    return reasons


def _notes(results: Results) -> list[str]:
    """What else to know of the results."""
    sentences = _balance_silent(results)
    if results.posterior is not None:
        sentences += [w for w in results.posterior.warnings if w not in results.posterior.against_intervals]
    if results.fit is not None and results.fit.identifiability is not None:
        sentences += _undetermined(results.fit, results.fit.identifiability)
    if results.fit is not None and is_misfit(results.fit.misfit):
        sentences.append(
            f"The residuals are {number(results.fit.misfit, 2)} times the noise (median over channels): the model, not "
            "the noise, limits the accuracy."
        )
    if results.validation is not None and (rows := results.validation.channels):
        bad = [r for r in rows if is_misfit(r.residual_over_noise)]
        if bad:
            sentences.append(
                f"In {len(bad)} of {count(len(rows), 'channel record')} the residual is at least {MISFIT:g} times "
                "what the sensor shows before the bump: there the model, not the noise, limits the accuracy."
            )
    return sentences + pass_limits.cautions(results)


def _best_rows(results: Results) -> list[tuple[str, AxleEstimates, Estimate]]:
    rows: list[tuple[str, AxleEstimates, Estimate]] = []
    for quantity, symbol in _SYMBOLS:
        for row in distinct(results.suspension(quantity)):
            if row.best is not None:
                rows.append(
                    (
                        f"{symbol} of axle {row.axle + 1}" + (f" ({row.load_case})" if row.load_case else ""),
                        row,
                        row.best,
                    )
                )
    return rows


def unidentified_values(results: Results) -> list[str]:
    """Names of the fitted k and c that the data do not determine."""
    return [] if results.fit is None else [name for name, _, best in _best_rows(results) if not best.identified]


def _undetermined(fit: FitResult, determined: Identifiability) -> tuple[str, ...]:
    """What the data do not determine beside single values of k and c and beside tires."""
    from sysid.estimation.uncertainty.identifiability import group_statements, is_tire

    said = {p.name for p in fit.parameters if p.quantity in ("stiffness", "damping")}
    return group_statements(
        [
            g
            for g in determined.groups
            if not (all(is_tire(name) for name in g.names) or (g.known == 0 and said.issuperset(g.names)))
        ]
    )


def _wide(results: Results) -> list[str]:
    if results.fit is None:
        return []
    return [name for name, _, best in _best_rows(results) if best.identified and relative_half_width(best) > WIDE]


def relative_half_width(e: Estimate) -> float:
    """Half of the 90 % interval of an estimate over its value, NaN where the value is 0."""
    return (e.high - e.low) / 2.0 / abs(e.value) if e.value else math.nan
