"""Stiffness and damping of every axle from all methods that have run, and which of them is the most informed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from sysid.display import Z90

if TYPE_CHECKING:
    from sysid.estimation.fit.fit_result import FitResult
    from sysid.estimation.parameters.estimate import ParameterEstimate
    from sysid.posterior.sampled_posterior import Posterior
    from sysid.sdof.drop_results import DropEstimate, DropSummary

Quantity = Literal["stiffness", "damping"]
Source = Literal["paper", "corrected", "free_decay", "model", "fitted", "posterior"]


@dataclass(frozen=True)
class Estimate:
    """One value with its 90 % interval in SI units; `low` and `high` are NaN where no interval is known.

    `kind` names the interval in words; `note` says why a value is missing or what it means; `alone` is False for a drop
    that is not to be used without the fit.
    """

    source: Source
    value: float
    low: float
    high: float
    kind: str
    usable: bool = True
    identified: bool = True
    note: str = ""
    alone: bool = True


@dataclass(frozen=True)
class AxleEstimates:
    """All estimates of one quantity of one axle (index); `load_case` None means shared by all load cases."""

    axle: int
    load_case: str | None
    drop_load_case: str | None
    estimates: dict[Source, Estimate]

    @property
    def best(self) -> Estimate | None:
        """The most informed usable estimate: posterior, fit, drops by full model, corrected, free decay, paper."""
        for source in ("posterior", "fitted", "model", "corrected", "free_decay", "paper"):
            estimate = self.estimates.get(source)
            if estimate is not None and estimate.usable and math.isfinite(estimate.value):
                return estimate
        return None


def suspension_estimates(
    quantity: Quantity, drops: DropSummary | None, fit: FitResult | None, posterior: Posterior | None
) -> tuple[AxleEstimates, ...]:
    """Estimates of `quantity` per axle and, where they differ, per load case, front to rear.

    90 % intervals: exp(ln value +- 1.645 s), s = sqrt(ln(1 + (sd/value)^2)) of drops (scatter of repeats, tolerances of
    declared quantities) and s = sd/value of parameters that the fit keeps as logarithms; of the posterior its 5 % and
    95 % quantiles.
    """
    pooled = () if drops is None else drops.pooled
    fitted = () if fit is None else tuple(p for p in fit.parameters if p.quantity == quantity and p.axle is not None)
    summaries = {} if posterior is None else {s.name: s for s in posterior.summaries}
    keys: dict[tuple[int, str | None], str | None] = {}
    for p in fitted:
        cases = list(dict.fromkeys(e.load_case for e in pooled if e.axle == p.axle))
        shown = p.load_case if p.load_case in cases else None
        keys[(int(p.axle or 0), p.load_case)] = (cases[0] if cases else None) if p.load_case is None else shown
    for e in pooled:
        known = [k for k in keys if k[0] == e.axle]
        if e.load_case not in [keys[k] for k in known]:
            keys[(e.axle, e.load_case)] = e.load_case
    order = list(keys)
    result = []
    for key in sorted(order, key=lambda k: (k[0], order.index(k))):
        by_source: dict[Source, Estimate] = {}
        for e in pooled:
            if e.axle == key[0] and e.load_case == keys[key]:
                by_source[e.method] = _from_drop(e, quantity)
        # Drops of a further load case stand beside the value that all load cases share.
        of_row = [p for p in fitted if (p.axle, p.load_case) == key]
        for p in of_row or [p for p in fitted if (p.axle, p.load_case) == (key[0], None)]:
            if "fitted" not in by_source:
                by_source["fitted"] = _from_fit(p)
                if p.name in summaries:
                    s = summaries[p.name]
                    by_source["posterior"] = Estimate(
                        "posterior", s.q50, s.q05, s.q95, "90 % credible interval", identified=p.identified
                    )
        result.append(AxleEstimates(key[0], key[1], keys[key], by_source))
    return tuple(result)


def distinct(rows: Sequence[AxleEstimates]) -> list[AxleEstimates]:
    """Rows with a best estimate of their own: one that load cases share counts once."""
    found: dict[tuple[int, Estimate | None], AxleEstimates] = {}
    for row in rows:
        found.setdefault((row.axle, row.best), row)
    return list(found.values())


def _from_drop(e: DropEstimate, quantity: Quantity) -> Estimate:
    value, sd = (e.stiffness, e.stiffness_sd) if quantity == "stiffness" else (e.damping, e.damping_sd)
    # Records that cannot be used alone have standard deviations of many times the value.  A lognormal variable of that
    # mean and spread still has a finite interval, but a very narrow one about a value that is next to zero.
    logarithmic = math.sqrt(2.0 * math.log(math.hypot(1.0, sd / value))) if value > 0.0 else math.nan
    low, high = _interval(value, sd, logarithmic)
    high = max(high, value + Z90 * sd)
    return Estimate(
        e.method,
        value,
        max(low, 0.0),
        high,
        "90 % interval of repeats and tolerances",
        e.usable,
        True,
        e.note,
        not e.caution,
    )


def _from_fit(p: ParameterEstimate) -> Estimate:
    low, high = _interval(p.value, p.sd, p.sd / p.value if p.transform == "log" else math.nan)
    return Estimate("fitted", p.value, low, high, "90 % confidence interval", identified=p.identified)


def _interval(value: float, sd: float, logarithmic: float) -> tuple[float, float]:
    """90 % interval from the standard deviation of the logarithm, where there is one, or from that of the value."""
    if math.isnan(logarithmic):
        return value - Z90 * sd, value + Z90 * sd
    factor = math.exp(Z90 * logarithmic)
    return value / factor, value * factor
