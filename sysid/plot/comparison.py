"""Stiffness and damping of every axle side by side: paper, corrected, fitted, posterior, each with its interval."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from matplotlib.axes import Axes

from sysid.display import Z90
from sysid.plot.style import INK, axes_or_new, axle_color, label, styled
from sysid.sdof.drop_results import DropEstimate, DropSummary

if TYPE_CHECKING:
    from sysid.estimation.fit.fit_result import FitResult
    from sysid.estimation.parameters.estimate import ParameterEstimate
    from sysid.posterior.sampled_posterior import Posterior

Quantity = Literal["stiffness", "damping"]
Source = Literal["paper", "corrected", "free_decay", "model", "fitted", "posterior"]

SOURCES: tuple[Source, ...] = ("paper", "corrected", "free_decay", "model", "fitted", "posterior")
SOURCE_LABELS: dict[Source, str] = {
    "paper": "paper, eq. (1)–(3)",
    "corrected": "corrected",
    "free_decay": "free-decay model",
    "model": "drop fitted by the full model",
    "fitted": "fitted to the runs",
    "posterior": "posterior",
}
_MARKERS: dict[Source, str] = {
    "paper": "o",
    "corrected": "s",
    "free_decay": "^",
    "model": "v",
    "fitted": "D",
    "posterior": "o",
}


@dataclass(frozen=True)
class Estimate:
    """One value with its 90 % interval in SI units; `low` and `high` are NaN where no interval is known.

    `kind` names the interval in words; `note` says why a value is missing or what it means.
    """

    source: Source
    value: float
    low: float
    high: float
    kind: str
    usable: bool = True
    identified: bool = True
    note: str = ""


@dataclass(frozen=True)
class AxleEstimates:
    """All estimates of one quantity of one axle (index); `load_case` None means shared by all load cases."""

    axle: int
    load_case: str | None
    drop_load_case: str | None
    estimates: dict[Source, Estimate]

    @property
    def best(self) -> Estimate | None:
        """The most informed usable estimate: posterior, else fitted, else corrected, else paper."""
        for source in ("posterior", "fitted", "model", "corrected", "free_decay", "paper"):
            found = self.estimates.get(source)
            if found is not None and found.usable and math.isfinite(found.value):
                return found
        return None


def suspension_estimates(
    quantity: Quantity, drops: DropSummary | None, fit: FitResult | None, posterior: Posterior | None
) -> tuple[AxleEstimates, ...]:
    """Collect the estimates of `quantity` per axle and, where they differ, per load case, front to rear.

    90 % intervals: drops value +- 1.645 sd (scatter over the repeats and tolerances of declared quantities), fit
    exp(ln value +- 1.645 sd/value) for parameters kept as logarithms, posterior its 5 % and 95 % quantiles.
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
        found: dict[Source, Estimate] = {}
        for e in pooled:
            if e.axle == key[0] and e.load_case == keys[key]:
                found[e.method] = _from_drop(e, quantity)
        for p in fitted:
            if (p.axle, p.load_case) == key and "fitted" not in found:
                found["fitted"] = _from_fit(p)
                if p.name in summaries:
                    s = summaries[p.name]
                    found["posterior"] = Estimate(
                        "posterior", s.q50, s.q05, s.q95, "90 % credible interval", identified=p.identified
                    )
        result.append(AxleEstimates(key[0], key[1], keys[key], found))
    return tuple(result)


def _from_drop(e: DropEstimate, quantity: Quantity) -> Estimate:
    value, sd = (e.stiffness, e.stiffness_sd) if quantity == "stiffness" else (e.damping, e.damping_sd)
    kind = "90 % interval of repeats and tolerances"
    return Estimate(e.method, value, value - Z90 * sd, value + Z90 * sd, kind, e.usable, True, e.note)


def _from_fit(p: ParameterEstimate) -> Estimate:
    if p.transform == "log" and p.value > 0.0:
        factor = math.exp(Z90 * p.sd / p.value) if math.isfinite(p.sd) else math.nan
        low, high = p.value / factor, p.value * factor
    else:
        low, high = p.value - Z90 * p.sd, p.value + Z90 * p.sd
    return Estimate("fitted", p.value, low, high, "90 % confidence interval", identified=p.identified)


@styled
def comparison(rows: tuple[AxleEstimates, ...], quantity: Quantity, ax: Axes | None = None) -> Axes:
    """Estimates of all axles one below the other: marker = source, colour = axle, bar = 90 % interval."""
    ax = axes_or_new(ax, 6.4, 0.9 + 0.5 * max(len(rows), 1))
    present = [s for s in SOURCES if any(s in r.estimates for r in rows)]
    named: set[Source] = set()
    for index, row in enumerate(rows):
        for place, source in enumerate(present):
            e = row.estimates.get(source)
            if e is None or not (e.usable and math.isfinite(e.value)):
                continue
            y = index + 0.7 * ((place + 0.5) / len(present) - 0.5)
            filled = source in ("posterior", "fitted")
            color = axle_color(row.axle)
            if math.isfinite(e.low) and math.isfinite(e.high):
                ax.plot(np.array([e.low, e.high]) / 1e3, [y, y], color=color, lw=2.2 if filled else 1.2)
            ax.plot(
                e.value / 1e3, y, ls="", marker=_MARKERS[source], ms=5, color=color, mfc=color if filled else "white"
            )
            named.add(source)
    # Legend in grey: the shape tells the source, the colour the axle.
    for source in present:
        if source in named:
            filled = source in ("posterior", "fitted")
            marker = _MARKERS[source]
            ax.plot(
                [], [], ls="", marker=marker, ms=5, color=INK, mfc=INK if filled else "white", label=_legend(source)
            )
    ax.set_yticks(range(len(rows)), [_row_name(r) for r in rows])
    ax.set_ylim(len(rows) - 0.5, -0.5)
    ax.set_xlim(left=min(0.0, ax.get_xlim()[0]))
    ax.set_xlabel("stiffness k [kN/m]" if quantity == "stiffness" else "damping c [kN s/m]")
    if named:
        ax.figure.legend(loc="outside upper center", ncols=3)
    return ax


def _legend(source: Source) -> str:
    return SOURCE_LABELS[source]


def _row_name(row: AxleEstimates) -> str:
    return f"axle {row.axle + 1}" + (f"\n{label(row.load_case, 16)}" if row.load_case else "")
