"""Figures of what the data say: priors against results, and profiles of the deviance."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from matplotlib.axes import Axes

from sysid.plot.style import MUTED, axes_or_new, axle_color, label, styled

if TYPE_CHECKING:
    from sysid.estimation.results import FitResult
    from sysid.posterior.results import Posterior

_Z90 = 1.6448536269514722


@styled
def prior_against_posterior(fit: FitResult, posterior: Posterior | None = None, ax: Axes | None = None) -> Axes:
    """90 % intervals of every parameter over its prior median: grey before the data, coloured by axle after them.

    Before sampling the coloured bars are those of least squares.
    """
    ax = axes_or_new(ax, 6.4, 0.8 + 0.17 * len(fit.parameters))
    summaries = {} if posterior is None else {s.name: s for s in posterior.summaries}
    for row, p in enumerate(fit.parameters):
        prior = math.exp(_Z90 * p.prior_sd)
        ax.plot([1.0 / prior, prior], [row, row], color=MUTED, alpha=0.35, lw=6, solid_capstyle="butt",
                label="prior" if row == 0 else None)  # fmt: skip
        s = summaries.get(p.name)
        factor = math.exp(_Z90 * p.sd / p.value)
        low, middle, high = (p.value / factor, p.value, p.value * factor) if s is None else (s.q05, s.q50, s.q95)
        color = axle_color(p.axle)
        ends = [low / p.prior_median, high / p.prior_median]
        ax.plot(ends, [row, row], color=color, lw=2.5, solid_capstyle="butt")
        ax.plot([middle / p.prior_median], [row], "o" if p.identified else "x", color=color, ms=3.5)
    ax.set_xscale("log")
    ax.set_yticks(range(len(fit.parameters)), [label(p.name, 20) for p in fit.parameters], fontsize=7)
    ax.invert_yaxis()
    ax.axvline(1.0, color=MUTED, lw=0.8, ls=":")
    ticks = [0.2, 0.5, 0.8, 1.0, 1.25, 2.0, 5.0]
    low, high = ax.get_xlim()
    shown = [t for t in ticks if low <= t <= high]
    ax.set_xticks(shown, [f"{t:g}" for t in shown])
    ax.set_xticks([], minor=True)
    ax.set_xlabel("value over prior median [-]")
    return ax
