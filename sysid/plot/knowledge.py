"""Figures of what the data say: priors against results, and profiles of the deviance."""

from __future__ import annotations

import math
import textwrap
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from sysid.display import Z90
from sysid.plot.style import FAINT, INK, MUTED, axes_or_new, axle_color, display, label, styled

if TYPE_CHECKING:
    from sysid.estimation.fit.fit_result import FitResult
    from sysid.estimation.fit.profiles import ProfileLikelihood
    from sysid.planning.advice_records import Advice, Prospect
    from sysid.posterior.sampled_posterior import Posterior


@styled
def prior_against_posterior(fit: FitResult, posterior: Posterior | None = None, ax: Axes | None = None) -> Axes:
    """90 % intervals of every parameter over its prior median: grey before the data, coloured by axle after them.

    Before sampling the coloured bars are those of least squares.
    """
    ax = axes_or_new(ax, 6.4, 0.8 + 0.17 * len(fit.parameters))
    summaries = {} if posterior is None else {s.name: s for s in posterior.summaries}
    for row, p in enumerate(fit.parameters):
        prior = math.exp(Z90 * p.prior_sd)
        ax.plot([1.0 / prior, prior], [row, row], color=MUTED, alpha=0.35, lw=6, solid_capstyle="butt",
                label="prior" if row == 0 else None)  # fmt: skip
        s = summaries.get(p.name)
        factor = math.exp(Z90 * p.sd / p.value)
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


@styled
def likelihood_profile(profile: ProfileLikelihood, ax: Axes | None = None) -> Axes:
    """Adjusted deviance of one parameter over its value, beside the parabola of the covariance, with 90 % intervals."""
    ax = axes_or_new(ax, 3.65, 2.4)
    values, unit = display(profile.value, profile.unit)
    factor = values[0] / profile.value[0]
    width = math.log(profile.covariance_interval[1] / profile.best) / Z90
    fine = np.linspace(math.log(profile.value[0]), math.log(profile.value[-1]), 200)
    ax.plot(factor * np.exp(fine), ((fine - math.log(profile.best)) / width) ** 2, color=MUTED, ls="--", lw=1.0,
            label="covariance")  # fmt: skip
    ax.plot(values, profile.adjusted, "o-", color=INK, ms=3.0, lw=1.2, label="profile")
    ax.axhline(Z90**2, color=MUTED, lw=0.8, ls=":")
    for end in profile.interval:
        if math.isfinite(end):
            ax.plot([factor * end], [Z90**2], "|", color=INK, ms=9)
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel(f"{label(profile.name, 24)} [{unit}]")
    ax.set_ylabel("deviance [-]")
    ax.legend(loc="upper center")
    return ax


@styled
def next_runs(advice: Advice, ax: Axes | None = None) -> Axes:
    """Relative standard deviations of k and c now, after each further run or sensor, and with exact masses.

    Per row the worst of all k and c, which is named, and their median; dotted lines mark what is known now.
    """
    groups = [g for g in ((advice.now,), advice.runs, advice.sensors, advice.masses) if g]
    rows = [p for group in groups for p in group]
    # Half a row of air between what is known now, runs, sensors and masses.
    place = np.concatenate([np.full(len(group), 0.5 * i) for i, group in enumerate(groups)]) + np.arange(len(rows))
    ax = axes_or_new(ax, 7.4, 1.1 + 0.24 * float(place[-1]))
    worst = [advice.worst(p) for p in rows]
    high, middle = 100.0 * np.array([sd for _, sd in worst]), 100.0 * np.array([advice.median(p) for p in rows])
    ax.hlines(place, middle, high, color=FAINT, lw=2.0)
    for now, color in ((high[0], INK), (middle[0], MUTED)):
        ax.axvline(now, color=color, lw=0.8, ls=":")
    ax.plot(high, place, "o", color=INK, ms=5.0, label="worst of k and c")
    ax.plot(middle, place, "o", color="white", markeredgecolor=MUTED, ms=5.0, label="median of k and c")
    for (name, _), x, y in zip(worst, high, place, strict=True):
        ax.annotate(label(name, 16), (x, y), (6, 0), textcoords="offset points", va="center", fontsize=7, color=MUTED)
    ax.set_yticks(place, ["known now", *(_prospect(p) for p in rows[1:])], fontsize=7)
    ax.set_ylim(float(place[-1]) + 0.7, -0.7)
    ax.set_xlim(0.0, 1.12 * float(high.max()))
    ax.set_xlabel("relative standard deviation [%]")
    ax.legend(loc="upper center", bbox_to_anchor=(0.4, 1.0 + 0.42 / (1.1 + 0.24 * float(place[-1]))), ncols=2)
    return ax


def _prospect(p: Prospect) -> str:
    """The run, the sensor or what is exact, on two lines where one would be long."""
    return "\n".join(textwrap.wrap(label(f"exact {p.exact}" if p.exact else p.label, 80), 50))
