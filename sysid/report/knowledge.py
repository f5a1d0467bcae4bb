"""What the data determine and what would be known next: tables of priors against results, and of further runs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sysid.display import NOT_DETERMINED, Z90, shown_unit
from sysid.numbers import MISSING, decimals, fixed, interval, number, percent
from sysid.report.cells import Cell, Table, table
from sysid.results import Results

if TYPE_CHECKING:
    from sysid.estimation.parameters.estimate import ParameterEstimate
    from sysid.planning.advice_records import Prospect


def shrinkage_table(results: Results) -> Table | None:
    """Prior against result of every parameter with 90 % intervals, and what is left of the prior's spread."""
    if results.fit is None:
        return None
    summaries = {} if results.posterior is None else {s.name: s for s in results.posterior.summaries}
    rows = []
    for p in results.fit.parameters:
        factor, unit = shown_unit(p.unit)
        low, high = _spread(p.prior_median * factor, p.prior_sd)
        places = decimals(p.prior_median * factor)
        s = summaries.get(p.name)
        if s is None:
            value, relative = p.value, p.sd / p.value
            ends = _spread(p.value * factor, relative)
        else:
            value, ends = s.q50, (s.q05 * factor, s.q95 * factor)
            relative = math.log(s.q95 / s.q05) / (2.0 * Z90)
        fine = decimals(value * factor, (ends[1] - ends[0]) / 2.0)
        rows.append(
            [
                p.name,
                unit,
                Cell(fixed(p.prior_median * factor, places), interval(low, high, places)),
                Cell(fixed(value * factor, fine) if p.identified else NOT_DETERMINED, interval(*ends, fine)),
                fixed(relative / p.prior_sd, 2),
                _moved(p, value),
            ]
        )
    head = (
        "parameter",
        "unit",
        "prior median [90 %]",
        ("posterior" if summaries else "least squares") + " [90 %]",
        "sd / prior sd [-]",
        "shift over prior sd [-]",
    )
    return table("Prior against result of every parameter", head, rows, text_columns=2)


def shares_table(results: Results) -> Table | None:
    """Where the variance of every k and c comes from."""
    known = None if results.fit is None else results.fit.identifiability
    if results.fit is None or known is None:
        return None
    rows = [
        [p.name, *(f"{100.0 * share:.0f}" for share in known.shares[known.names.index(p.name)])]
        for p in results.fit.parameters
        if p.quantity in ("stiffness", "damping")
    ]
    head = ("parameter", *(f"{source} [%]" for source in known.sources))
    return table("Shares of the sources of uncertainty in the variance of k and c", head, rows, text_columns=1)


def share_words(results: Results) -> tuple[str, ...]:
    """The same in words."""
    known = None if results.fit is None else results.fit.identifiability
    return () if known is None else known.share_sentences


def _spread(median: float, log_sd: float) -> tuple[float, float]:
    factor = math.exp(Z90 * log_sd)
    return median / factor, median * factor


def _moved(p: ParameterEstimate, value: float) -> str:
    return f"{math.log(value / p.prior_median) / p.prior_sd:+.1f}".replace("-", "\N{MINUS SIGN}")


def advice_table(results: Results) -> Table | None:
    """What one further run, or one with a further sensor, would bring; None where nobody has asked."""
    advice = results.advice
    if advice is None:
        return None

    def cells(p: Prospect) -> list[str]:
        name, worst = advice.worst(p)
        peak = MISSING if advice.peak is None else number(p.peak_sd, 2)
        return [p.label, f"{percent(worst)} ({name})", percent(advice.median(p)), peak]

    rows = [cells(p) for p in advice.rows]
    peak = "sd of a predicted peak ratio" if advice.peak is None else f"sd of the peak ratio, {advice.peak.label}"
    head = ("one further run", "worst sd of k and c", "median sd of k and c", peak)
    return table("What one further run would bring", head, rows)
