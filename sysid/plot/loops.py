"""Force-displacement and force-rate curves of the suspensions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from matplotlib.axes import Axes

from sysid.plot.style import axes_grid, axes_or_new, axle_color, styled

if TYPE_CHECKING:
    from sysid.estimates.loops import SuspensionLoops


@styled
def suspension_loop(
    loops: SuspensionLoops, against: Literal["extension", "rate"] = "extension", ax: Axes | None = None
) -> Axes:
    """Force of every suspension over one harmonic cycle, against extension [mm] or its rate [m/s]."""
    ax = axes_or_new(ax, 4.2, 3.0)
    across = 1e3 * loops.extension_m if against == "extension" else loops.rate_m_s
    for axle, force in zip(loops.axles, loops.force_N, strict=True):
        ax.plot(across, force / 1e3, color=axle_color(axle), label=f"axle {axle + 1}")
    ax.axhline(0.0, color="0.7", lw=0.7, zorder=0)
    ax.set_xlabel("extension [mm]" if against == "extension" else "rate of extension [m/s]")
    ax.set_ylabel("force less static [kN]")
    return ax


@styled
def suspension_loop_pair(loops: SuspensionLoops) -> np.ndarray:
    """Force against extension and against its rate, side by side; returns the axes (1, 2)."""
    axes = axes_grid(1, 2, (3.3, 2.6), (0.7, 0.2, 0.6, 0.4, 0.8, 0.0))
    suspension_loop(loops, "extension", axes[0, 0])
    suspension_loop(loops, "rate", axes[0, 1])
    axes[0, 1].legend(fontsize="small", ncols=2)
    axes[0, 0].set_title(loops.load_case)
    return axes
