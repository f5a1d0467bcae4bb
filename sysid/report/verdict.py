"""The first screen in words: what are k and c, can they be used, what should be done next."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

from sysid.estimates.suspension_values import AxleEstimates, Estimate, Quantity
from sysid.estimation.fit.thresholds import MISFIT
from sysid.report import stops
from sysid.report.cells import suspension_values
from sysid.report.numbers import count, interval, listing, number, percent, speed
from sysid.results.contents import Judgement, Results, Trust

Tone = Literal["good", "caution", "stop"]

# Half width of a 90 % interval, relative to the value, above which a parameter is called poorly known.
WIDE = 0.2

_ANSWER: dict[Trust, tuple[Tone, str]] = {
    "use": ("good", "Yes"),
    "with_care": ("caution", "Yes, with care"),
    "do_not_bet": ("stop", "Do not bet on them"),
    "not_yet": ("stop", "Not yet"),
}
_QUANTITIES: tuple[tuple[Quantity, str, str], ...] = (
    ("stiffness", "Stiffness k", "kN/m"),
    ("damping", "Damping c", "kN\u00a0s/m"),
)


@dataclass(frozen=True)
class Verdict:
    """Badge, answer in a word or two, and the sentences under the three questions of the first screen."""

    tone: Tone
    badge: str
    badge_tone: Tone
    answer: str
    what: tuple[str, ...]
    use: tuple[str, ...]
    todo: tuple[str, ...]
    synthetic: bool


def verdict(results: Results) -> Verdict:
    """Judge the results of all stages that have run."""
    judgement = judge(results)
    tone, answer = _ANSWER[judgement.trust]
    return Verdict(
        tone=tone,
        badge=_badge(results),
        badge_tone=_badge_tone(results),
        answer="Not for decisions" if results.status == "preview" else answer,
        what=tuple(_what(results)),
        use=judgement.reasons,
        todo=tuple(_todo(results)),
        synthetic=is_synthetic(results),
    )


def judge(results: Results) -> Judgement:
    """Whether the numbers of all stages that have run may be used, and why."""
    against, unexplained, cautions = _against(results), _unexplained(results), _cautions(results)
    reasons = (*against, *unexplained, *cautions)
    if against:
        return Judgement("not_yet", reasons)
    if unexplained:
        return Judgement("do_not_bet", reasons)
    if cautions:
        return Judgement("with_care", reasons)
    return Judgement("use", ("The calibration has converged and no check of this report found a problem.",))


def is_misfit(residual_over_noise: float) -> bool:
    """Whether a residual, rounded as it is printed, is too large for noise; False where it is unknown."""
    return math.isfinite(residual_over_noise) and round(residual_over_noise, 2) >= MISFIT


def is_synthetic(results: Results) -> bool:
    """Whether title or notes of the campaign say that its data were computed, not measured."""
    text = f"{results.campaign.title} {results.campaign.notes}"
    return re.search(r"\b(synthetic|virtual|simulated campaign)\b", text, re.IGNORECASE) is not None


def _badge(results: Results) -> str:
    if results.status == "preview":
        return "PREVIEW"
    if results.posterior is not None:
        return "CONVERGED" if results.status == "converged" else "NOT CONVERGED"
    if results.fit is not None:
        return "LEAST SQUARES ONLY" if results.fit.converged else "NOT CONVERGED"
    return "FIRST ESTIMATES ONLY" if results.drops is not None else "NO ESTIMATES YET"


def _badge_tone(results: Results) -> Tone:
    if results.status == "converged" and results.posterior is not None:
        return "good"
    return "stop" if results.status == "preview" or _badge(results).startswith("N") else "caution"


def _what(results: Results) -> list[str]:
    sentences = []
    for quantity, name, unit in _QUANTITIES:
        rows = suspension_values(results, quantity)
        estimates = [e for e in (row.best for row in rows) if e is not None]
        best = [e for e in estimates if e.identified]
        if estimates and not best:
            sentences.append(f"{name} is not determined by these data on any axle.")
        if not best:
            continue
        values = [e.value / 1e3 for e in best]
        text = f"{name} is {_range(values)}\u00a0{unit} per axle"
        widths = [w for w in (_relative_half_width(e) for e in best) if math.isfinite(w)]
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
            f"At {speed(p.speed_m_s)}\u00a0km/h ({p.load_case}) the largest wheel load is "
            f"{number(float(p.peak_ratio_q50[axle]))} times the static one, on axle {axle + 1}"
            + (f" (90\u00a0% interval {band})" if band else "")
            + (": an extrapolation, see the caution." if any(e.axle == axle for e in p.trust) else ".")
        )
    return sentences


def _against(results: Results) -> list[str]:
    sentences = []
    # Least squares have a sentence of their own.
    no_fit = results.fit is not None and not results.fit.converged
    if results.status == "preview":
        sentences.append("This is a preview with shortened sampling. Its intervals are not reliable.")
    elif results.status == "not_converged" and results.posterior is not None and not no_fit:
        why = results.posterior.message.rstrip(".")
        sentences.append("The calibration has not converged" + (f": {why}." if why else "."))
    if results.fit is None:
        sentences.append(
            "The drop values are starting points: tires in series and coupled axles bias equations (1)–(3)."
            if results.drops is not None
            else "No stage that estimates k and c has run yet."
        )
    elif not results.fit.converged:
        sentences.append(f"The least-squares fit did not converge: {results.fit.message.rstrip('.')}.")
    return sentences


def _unexplained(results: Results) -> list[str]:
    if results.fit is None or not is_misfit(results.fit.misfit):
        return []
    return [
        f"Do not bet on these intervals: the residuals are {number(results.fit.misfit, 2)} times the noise (median "
        "over channels). The truck does something that the model does not describe, and values may be wrong by "
        "more than their intervals. The figures of measured and simulated signals show where."
    ]


def _cautions(results: Results) -> list[str]:
    sentences = [] if results.fit is None else list(results.fit.proposals)
    if results.fit is not None and results.posterior is None:
        sentences.append("The posterior has not been sampled: intervals come from the least-squares covariance.")
    if unidentified := _unidentified(results):
        sentences.append(f"The data do not determine {listing(unidentified)}: these values repeat the prior.")
    if wide := _wide(results):
        sentences.append(f"The 90\u00a0% interval is wider than \u00b1{percent(WIDE)} for {listing(wide)}.")
    if results.validation is not None and (rows := results.validation.channels):
        bad = [r for r in rows if is_misfit(r.residual_over_noise)]
        if bad:
            sentences.append(
                f"In {len(bad)} of {count(len(rows), 'channel record')} the residual is at least {MISFIT:g} times "
                "what the sensor shows before the bump: there the model, not the noise, limits the accuracy."
            )
    return sentences + stops.cautions(results)


def _todo(results: Results) -> list[str]:
    steps = []
    if results.fit is None:
        steps.append("Run the stage 'fit': it corrects the drop values with the full vehicle model and the bump runs.")
    elif results.status == "preview":
        steps.append("Run again without --quick before you use these numbers.")
    elif not results.fit.converged:
        steps.append(
            "Do what the other warnings say. Declare the travel of suspensions that may reach their stops, or give a "
            "prior to a parameter that is not determined; then fit again."
        )
    elif results.posterior is None:
        steps.append(
            "Run the stage 'sample': its intervals also hold combinations of parameters that the data cannot separate."
        )
    elif results.status == "not_converged":
        steps.append(
            "Run the stage 'sample' again with --resume and a larger --max-steps: it continues where it stopped."
        )
    if results.quality is not None:
        rejected = [f"{c.column} of {c.file}" for c in results.quality.channels if c.verdict == "rejected"]
        if rejected:
            steps.append(f"Check the sensors of {count(len(rejected), 'rejected channel')}: {listing(rejected, 4)}.")
    if axles := _axles_without_drops(results):
        steps.append(
            f"For {listing(axles)} no drop gives a decrement; repeat the drops towed and with the engine off, or rely "
            "on the fitted values."
        )
    if unidentified := _unidentified(results):
        steps.append(f"Add runs at another speed or load to identify {listing(unidentified)}.")
    if results.advice is not None and results.advice.statements:
        steps.append(" ".join(results.advice.statements[:2]))
    elif unidentified:
        steps.append("Run the stage 'advise': it says which further run or sensor would help most.")
    steps += stops.remedies(results)
    if results.fit is not None and results.predictions is None and results.campaign.predictions:
        steps.append("Run the stage 'predict' for the wheel loads of the passes in the campaign file.")
    if results.status == "converged" and results.posterior is not None:
        steps.append(
            "Take k and c from parameters.csv"
            + (" and wheel-load histories from predictions/*.csv" if results.predictions is not None else "")
            + "; they are the numbers of this report."
        )
    return steps


def _best_rows(results: Results) -> list[tuple[str, AxleEstimates, Estimate]]:
    rows: list[tuple[str, AxleEstimates, Estimate]] = []
    for quantity, name, _ in _QUANTITIES:
        symbol = name[-1]
        for row in suspension_values(results, quantity):
            if row.best is not None:
                rows.append(
                    (
                        f"{symbol} of axle {row.axle + 1}" + (f" ({row.load_case})" if row.load_case else ""),
                        row,
                        row.best,
                    )
                )
    return rows


def _unidentified(results: Results) -> list[str]:
    return [] if results.fit is None else [name for name, _, best in _best_rows(results) if not best.identified]


def _wide(results: Results) -> list[str]:
    if results.fit is None:
        return []
    return [name for name, _, best in _best_rows(results) if best.identified and _relative_half_width(best) > WIDE]


def _axles_without_drops(results: Results) -> list[str]:
    if results.drops is None:
        return []
    pooled = [e for e in results.drops.pooled if e.method == "paper"]
    return [f"axle {e.axle + 1}" for e in pooled if not e.usable]


def _relative_half_width(e: Estimate) -> float:
    return (e.high - e.low) / 2.0 / abs(e.value) if e.value else math.nan


def _range(values: list[float]) -> str:
    low, high = number(min(values)), number(max(values))
    return low if low == high else f"{low} to {high}"


def _finite(value: float) -> float:
    return value if math.isfinite(value) else -math.inf
