"""Stiffness and damping of every axle side by side: paper, corrected, fitted, posterior, each with its interval."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes

from sysid.estimates.suspension_values import AxleEstimates, Estimate, Quantity, Source
from sysid.plot.style import INK, axes_or_new, axle_color, label, styled

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


@styled
def comparison(rows: tuple[AxleEstimates, ...], quantity: Quantity, ax: Axes | None = None) -> Axes:
    """Estimates of all axles one below the other: marker = source, colour = axle, bar = 90 % interval.

    Once there is a fit, drops that are not to be used alone are left out: their intervals would set the scale.
    """
    ax = axes_or_new(ax, 6.4, 0.9 + 0.5 * max(len(rows), 1))
    fitted = any(e.source in ("posterior", "fitted") for r in rows for e in r.estimates.values())

    def shown(e: Estimate | None) -> bool:
        return e is not None and e.usable and math.isfinite(e.value) and (e.alone or not fitted)

    present = [s for s in SOURCES if any(shown(r.estimates.get(s)) for r in rows)]
    named: set[Source] = set()
    for index, row in enumerate(rows):
        for place, source in enumerate(present):
            e = row.estimates.get(source)
            if e is None or not shown(e):
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
