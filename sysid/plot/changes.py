"""Changes between two campaigns: a row per quantity with its 90 % interval about no change."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from sysid.plot.style import INK, MUTED, WARNING, axes_or_new, label, styled

#: Changes beyond this [%] are drawn at the edge.
_FURTHEST = 300.0


@styled
def changes(names: Sequence[str], change: np.ndarray, changed: Sequence[bool], ax: Axes | None = None) -> Axes:
    """Relative changes, one row per quantity; what has changed is red, its interval thick.

    Parameters
    ----------
    names : (n,) of the quantities.
    change : median, 5 % and 95 % of the relative change (3, n).
    changed : (n,) whether the quantity has changed.
    """
    ax = axes_or_new(ax, 6.4, 0.8 + 0.24 * max(len(names), 2))
    percent = np.clip(100.0 * np.asarray(change), -100.0, _FURTHEST)
    for place, found in enumerate(changed):
        color = WARNING if found else MUTED
        ax.plot(percent[1:, place], [place, place], color=color, lw=2.6 if found else 1.4, solid_capstyle="butt")
        ax.plot(percent[0, place], place, "o", color=color, mfc=color if found else "white", ms=5)
    ax.axvline(0.0, color=INK, lw=0.9)
    ax.set_yticks(range(len(names)), [label(name, 30) for name in names])
    for text, found in zip(ax.get_yticklabels(), changed, strict=True):
        text.set_color(WARNING if found else INK)
        text.set_fontweight("bold" if found else "normal")
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.set_xlabel("change [%]")
    ax.margins(x=0.08)
    return ax
