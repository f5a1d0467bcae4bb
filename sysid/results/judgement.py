"""Whether the numbers of all stages that have run may be used, and why: the verdict that every output carries."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sysid.estimates.suspension_values import AxleEstimates, Estimate, Quantity, distinct
from sysid.estimation.fit.thresholds import MISFIT
from sysid.numbers import count, listing, number, percent
from sysid.results import pass_limits
from sysid.results.contents import Judgement, Results

if TYPE_CHECKING:
    from sysid.estimation.fit.fit_result import FitResult
    from sysid.estimation.uncertainty.identifiability import Identifiability

#: Half width of a 90 % interval, relative to the value, above which a parameter is called poorly known.
WIDE = 0.2

_SYMBOLS: tuple[tuple[Quantity, str], ...] = (("stiffness", "k"), ("damping", "c"))


def judge(results: Results) -> Judgement:
    """Whether the numbers of all stages that have run may be used, and why; the severest reason decides.

    Warnings of what was left out of the data (rows, channels, runs) are no reasons: the intervals do without it.
    """
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
    """Why values may be wrong by more than their intervals."""
    sentences = _misfit(results)
    if results.posterior is not None:
        sentences += results.posterior.against_intervals
    return sentences


def _misfit(results: Results) -> list[str]:
    if results.fit is None or not is_misfit(results.fit.misfit):
        return []
    return [
        f"Do not bet on these intervals: the residuals are {number(results.fit.misfit, 2)} times the noise (median "
        "over channels). The truck does something that the model does not describe, and values may be wrong by "
        "more than their intervals. The figures of measured and simulated signals show where."
    ]


def _cautions(results: Results) -> list[str]:
    sentences = [] if results.fit is None else [*results.fit.proposals, *results.fit.doubts]
    if results.quality is not None:
        sentences += results.quality.contradictions
    if results.posterior is not None:
        sentences += [w for w in results.posterior.warnings if w not in results.posterior.against_intervals]
    if results.fit is not None and results.posterior is None:
        sentences.append("The posterior has not been sampled: intervals come from the least-squares covariance.")
    if names := unidentified_values(results):
        sentences.append(f"The data do not determine {listing(names)}: these values repeat the prior.")
    if results.fit is not None and results.fit.identifiability is not None:
        sentences += _undetermined(results.fit, results.fit.identifiability)
    if wide := _wide(results):
        sentences.append(f"The 90\u00a0% interval is wider than \u00b1{percent(WIDE)} for {listing(wide)}.")
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
