"""The first screen in words: what are k and c, can they be used, what should be done next."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from sysid.estimates.suspension_values import Quantity, distinct
from sysid.numbers import count, interval, listing, number, percent, speed
from sysid.results.contents import Judgement, Results, Trust
from sysid.results.headline import LoadsAnswer, answer_words, loads_answer
from sysid.results.judgement import in_words, judge, relative_half_width
from sysid.results.next_steps import next_steps

Tone = Literal["good", "caution", "stop"]

_TONE: dict[Trust, Tone] = {"use": "good", "use_within": "caution", "do_not_bet": "stop", "not_yet": "stop"}
_QUANTITIES: tuple[tuple[Quantity, str, str], ...] = (
    ("stiffness", "Stiffness k", "kN/m"),
    ("damping", "Damping c", "kN\u00a0s/m"),
)


@dataclass(frozen=True)
class Verdict:
    """What the first screen says.

    Badge, answer in a word or two, the sentences for it, the first of which decides, `notes` on what else to know,
    `loads` on whether predicted loads may be used (None before any), all further `cautions`, each
    once, and the steps that would help, the next one first; `what` says the numbers in sentences.
    """

    tone: Tone
    badge: str
    badge_tone: Tone
    answer: str
    what: tuple[str, ...]
    use: tuple[str, ...]
    notes: tuple[str, ...]
    loads: LoadsAnswer | None
    cautions: tuple[str, ...]
    todo: tuple[str, ...]
    synthetic: bool


def verdict(results: Results) -> Verdict:
    """What the first screen says of the results of all stages that have run."""
    judgement = results.judgement or judge(results)
    return Verdict(
        tone=_TONE[judgement.trust],
        badge=_badge(results),
        badge_tone=_badge_tone(results, judgement),
        answer=answer_words(results, judgement),
        what=tuple(_what(results)),
        use=judgement.reasons,
        notes=judgement.notes,
        loads=loads_answer(results, judgement),
        cautions=_cautions(results, judgement),
        todo=next_steps(results, judgement),
        synthetic=results.campaign.details.synthetic,
    )


def _cautions(results: Results, judgement: Judgement) -> tuple[str, ...]:
    """All reasons but the first, notes, and all warnings but those of passes, which stand beside these."""
    of_passes = set() if results.predictions is None else {w for p in results.predictions.passes for w in p.warnings}
    warnings = (in_words(w) for w in results.all_warnings if w not in of_passes)
    sentences = [*judgement.reasons[1:], *judgement.notes, *warnings]
    said = dict.fromkeys(s for s in sentences if s != judgement.reasons[0])
    return tuple(said)


def _badge(results: Results) -> str:
    if results.status == "preview":
        return "PREVIEW"
    if results.posterior is not None:
        return "CONVERGED" if results.status == "converged" else "NOT CONVERGED"
    if results.fit is not None:
        return "LEAST SQUARES ONLY" if results.fit.converged else "NOT CONVERGED"
    return "FIRST ESTIMATES ONLY" if results.drops is not None else "NO ESTIMATES YET"


def _badge_tone(results: Results, judgement: Judgement) -> Tone:
    if judgement.trust == "do_not_bet":
        # No green beside such an answer: a chain that has converged does not make it better.
        return "caution"
    if results.status == "converged" and results.posterior is not None:
        return "good"
    return "stop" if results.status == "preview" or _badge(results).startswith("N") else "caution"


def _what(results: Results) -> list[str]:
    sentences = []
    for quantity, name, unit in _QUANTITIES:
        rows = distinct(results.suspension(quantity))
        estimates = [e for e in (row.best for row in rows) if e is not None]
        best = [e for e in estimates if e.identified]
        if estimates and not best:
            sentences.append(f"{name} is not determined by these data on any axle.")
        if not best:
            continue
        values = [e.value / 1e3 for e in best]
        text = f"{name} is {_range(values)}\u00a0{unit} per axle"
        widths = [w for w in (relative_half_width(e) for e in best) if math.isfinite(w)]
        kinds = list(dict.fromkeys(e.kind for e in best))
        if widths:
            ends = dict.fromkeys(f"\u00b1{percent(w)}" for w in (min(widths), max(widths)))
            # The interval of the drops leaves out the error of the method: it does not say how well a value is known.
            verb = "read to within" if results.fit is None else "each known to"
            text += f", {verb} {' to '.join(ends)} ({listing(kinds)})"
        if len(best) < len(estimates):
            unknown = len(estimates) - len(best)
            text += f"; {unknown} of {count(len(estimates), 'value')} cannot be determined from these data"
        sentences.append(text + ".")
    if not sentences:
        return ["No stiffness or damping has been estimated yet."]
    sentences += [share.words for share in results.load_shares]
    if results.fit is None:
        sentences.append("These are first estimates from the plank drops; on a truck they are biased, see below.")
    return sentences + _wheel_loads(results)


def _wheel_loads(results: Results) -> list[str]:
    if results.predictions is None:
        return []
    sentences = []
    for p in results.predictions.passes:
        axle = max(range(len(p.static_load_N)), key=lambda i: _finite(float(p.peak_ratio_q50[i])))
        low = None if p.peak_ratio_q05 is None else float(p.peak_ratio_q05[axle])
        high = None if p.peak_ratio_q95 is None else float(p.peak_ratio_q95[axle])
        band = interval(low, high, 2)
        sentences.append(
            f"At {speed(p.speed_m_s)}\u00a0km/h ({p.load_case}) the largest ratio of an axle load to the static one is "
            f"{number(float(p.peak_ratio_q50[axle]))}, on axle {axle + 1}"
            + (f" (90\u00a0% interval {band})" if band else "")
            + (": an extrapolation, see the caution." if any(e.axle == axle for e in p.trust) else ".")
        )
    return sentences


def _range(values: list[float]) -> str:
    low, high = number(min(values)), number(max(values))
    return low if low == high else f"{low} to {high}"


def _finite(value: float) -> float:
    return value if math.isfinite(value) else -math.inf
