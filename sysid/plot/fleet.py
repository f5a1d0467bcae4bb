"""Figures of a fleet: trucks by stiffness and damping, how far each is drawn to its type, and loads of a population."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from sysid.plot.style import (
    FAINT,
    INK,
    MUTED,
    WARNING,
    axes_grid,
    axes_or_new,
    axle_color,
    display,
    label,
    outer_labels,
    shared_legend,
    styled,
)

#: Trucks with a row of their own in a figure, and those whose names stand beside their marks.
MOST_ROWS = 40
_MOST_NAMES = 12
#: Trucks that stand out whose names are written: more would cover the others.
_MOST_STANDING = 40


@styled
def truck_map(
    stiffness: np.ndarray,
    damping: np.ndarray,
    names: Sequence[str],
    standing_out: Collection[int] = (),
    new: tuple[np.ndarray, np.ndarray] | None = None,
    axle: int = 0,
    ax: Axes | None = None,
) -> Axes:
    """Trucks by k and c of one axle.

    Parameters
    ----------
    stiffness, damping : 5 %, 50 % and 95 % of every truck (3, trucks), SI.
    names : of the trucks.
    standing_out : indices of trucks that are not like the others.
    new : 5 % and 95 % of k and of c of a truck that nobody has measured (2,) each; drawn as a box.
    axle : index, for the colour.
    """
    ax = axes_or_new(ax, 4.6, 3.6)
    k, k_unit = display(stiffness, "N/m")
    c, c_unit = display(damping, "N s/m")
    if new is not None:
        (k_low, k_high), (c_low, c_high) = display(new[0], "N/m")[0], display(new[1], "N s/m")[0]
        box = Rectangle((k_low, c_low), k_high - k_low, c_high - c_low, color=FAINT, alpha=0.5, lw=0, zorder=0)
        box.set_label("90 % of new trucks")
        ax.add_patch(box)
    many = len(names) > MOST_ROWS
    apart = np.isin(np.arange(len(names)), list(standing_out))
    for of, color in ((~apart, axle_color(axle)), (apart, WARNING)):
        if of.any():
            _crosses(ax, k[:, of], c[:, of], color, faint=many)
    colors = [WARNING if t else axle_color(axle) for t in apart]
    ax.scatter(k[1], c[1], s=4 if many else 14, c=colors, lw=0, zorder=3)
    named = np.flatnonzero(apart)[:_MOST_STANDING] if len(names) > _MOST_NAMES else range(len(names))
    for t in named:
        at = (float(k[1, t]), float(c[1, t]))
        ax.annotate(label(names[t], 16), at, (4, 4), textcoords="offset points", fontsize=7, color=colors[t])
    ax.margins(0.08)
    ax.set_xlabel(f"stiffness k [{k_unit}]")
    ax.set_ylabel(f"damping c [{c_unit}]")
    if new is not None:
        ax.legend(loc="best")
    return ax


def _crosses(ax: Axes, x: np.ndarray, y: np.ndarray, color: str, faint: bool) -> None:
    """Both intervals (3, trucks) of every truck; one line draws all, so that thousands take no time."""
    gap = np.full(x.shape[1], np.nan)
    across = np.stack([x[0], x[2], gap, x[1], x[1], gap])
    along = np.stack([y[1], y[1], gap, y[0], y[2], gap])
    # Bars of hundreds of trucks would hide each other.
    ax.plot(across.T.ravel(), along.T.ravel(), color=color, lw=0.3 if faint else 1.0, alpha=0.4 if faint else 1.0)


@styled
def shrinkage(
    alone: np.ndarray,
    drawn: np.ndarray,
    mean: np.ndarray,
    trucks: Sequence[str],
    parameters: Sequence[str],
    standing_out: Collection[tuple[int, int]] = (),
) -> np.ndarray:
    """Every truck from its own campaigns (grey) and with what the others say (coloured), over the mean of the type.

    Parameters
    ----------
    alone, drawn : 5 %, 50 % and 95 % (3, trucks, parameters) in natural units.
    mean : median of the type (parameters,).
    standing_out : pairs of indices (truck, parameter).
    """
    rows = _furthest(drawn[1] / mean)
    per_row = min(3, len(parameters))
    count = -(-len(parameters) // per_row)
    height = 0.35 + 0.17 * len(rows)
    grid = axes_grid(count, per_row, (2.7, height), (1.0, 0.15, 0.5, 0.6, 0.15, 0.55))
    for ax in grid.flat[len(parameters) :]:
        ax.set_axis_off()
    for i, (ax, name) in enumerate(zip(grid.flat, parameters, strict=False)):
        for place, t in enumerate(rows):
            color = WARNING if (t, i) in standing_out else axle_color(0)
            first = place == 0
            separate, with_others = alone[:, t, i] / mean[i], drawn[:, t, i] / mean[i]
            if np.isfinite(separate).all():
                ax.plot(separate[[0, 2]], [place] * 2, color=MUTED, alpha=0.4, lw=5, solid_capstyle="butt",
                        label="own campaigns" if first else None)  # fmt: skip
            ax.plot(with_others[[0, 2]], [place] * 2, color=color, lw=1.6, label="with all trucks" if first else None)
            ax.plot(with_others[1], place, "o", color=color, ms=3.5)
        ax.axvline(1.0, color=INK, lw=0.8, ls=":")
        ax.set_title(label(name, 24))
        ax.set_yticks(range(len(rows)), [label(trucks[t], 14) for t in rows] if i % per_row == 0 else [], fontsize=7)
        ax.set_ylim(len(rows) - 0.4, -0.6)
        ax.set_xlabel("over the mean of the type [-]")
        ax.locator_params(axis="x", nbins=5)
    outer_labels(grid, len(parameters))
    shared_legend(grid[0, 0].figure)
    return grid


@styled
def population_loads(names: Sequence[str], axles: Sequence[int], ratios: np.ndarray, ax: Axes | None = None) -> Axes:
    """Peak dynamic load ratios of new trucks: 5 %, 50 %, 95 % (3, rows), one row per pass and axle (index)."""
    ax = axes_or_new(ax, 9.6, 0.9 + 0.22 * len(names))
    place = np.arange(len(names))
    colors = [axle_color(a) for a in axles]
    ax.hlines(place, ratios[0], ratios[2], colors=colors, lw=2.4)
    ax.scatter(ratios[1], place, s=18, c=colors, zorder=3)
    ax.set_yticks(place, [label(n, 40) for n in names], fontsize=7)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.axvline(1.0, color=MUTED, lw=0.8, ls=":")
    ax.set_xlabel("peak dynamic load ratio [-]")
    return ax


def _furthest(ratio: np.ndarray) -> list[int]:
    """Trucks that get a row: all of them, or those furthest from the mean, in the order of the fleet."""
    far = np.abs(np.log(ratio)).max(axis=1)
    return sorted(int(t) for t in np.argsort(-far)[:MOST_ROWS])
