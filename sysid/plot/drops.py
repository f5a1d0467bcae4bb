"""Figures of plank drops: the trace with its picked peaks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from sysid.plot.style import (
    FAINT,
    INK,
    MUTED,
    WARNING,
    axes_grid,
    axes_or_new,
    axle_color,
    figure_of,
    label,
    outer_labels,
    shared_legend,
    styled,
    thin,
)
from sysid.sdof.drop_results import DropAnalysis

#: Width of several drops side by side [in].
_WIDTH_IN = 11.0


@styled
def drop(analysis: DropAnalysis, ax: Axes | None = None, legend: bool = True) -> Axes:
    """One plank drop: measured and filtered deflection, picked peaks, settled level and decay envelope.

    Peaks that entered the averages are filled, the others open.  The envelope is the settled level plus and minus
    A exp(-delta (t - t_1) / tau_d) through the used peaks; it is left out where the record gives no decrement.
    """
    ax = axes_or_new(ax)
    reading = analysis.reading
    color = axle_color(analysis.axle)
    time, raw, filtered, model = thin(
        analysis.time_s, analysis.deflection_m, analysis.filtered_m, analysis.free_decay_m, most=700
    )
    ax.plot(time, raw * 1e3, color=FAINT, lw=1.4, label="measured")
    ax.plot(time, filtered * 1e3, color=color, label="without wheel hop")
    if np.any(np.isfinite(model)):
        ax.plot(time, model * 1e3, color=INK, lw=0.9, ls=(0, (4, 2)), label="free-decay model")
    level = reading.settled_level * 1e3
    ax.axhline(level, color=MUTED, lw=0.8, ls=":", label="settled level")
    when, value = np.asarray(reading.extremum_time_s), np.asarray(reading.extremum_value_m) * 1e3
    used = np.asarray(reading.used, dtype=bool)
    ax.plot(when[used], value[used], "o", ms=5.5, color=color, mec=INK, mew=0.8, ls="", label="peak used")
    ax.plot(when[~used], value[~used], "o", ms=5.5, mfc="white", mec=INK, mew=0.8, ls="", label="peak not used")
    _envelope(analysis, ax, level)
    if np.isfinite(analysis.release_time_s):
        ax.axvline(analysis.release_time_s, color=MUTED, lw=0.8, ls="--")
    ax.set_xlabel("time [s]")
    ax.set_ylabel("deflection [mm]")
    ax.set_title(label(analysis.file.rsplit("/", 1)[-1], 34))
    if not reading.usable:
        ax.text(0.98, 0.96, "not usable", transform=ax.transAxes, ha="right", va="top", color=WARNING, weight="bold")
    _limit(analysis, ax)
    if legend:
        ax.legend(loc="best", ncols=2)
    return ax


@styled
def drops(files: Sequence[DropAnalysis], titles: Sequence[str] | None = None, per_row: int = 3) -> np.ndarray:
    """Several plank drops side by side with one legend; returns the axes (rows, per_row)."""
    per_row = min(per_row, max(len(files), 1))
    rows = max(1, -(-len(files) // per_row))
    width = (_WIDTH_IN - 0.7 - 0.5 * (per_row - 1)) / per_row if per_row > 1 else 5.7
    grid = axes_grid(rows, per_row, (width, 1.75), (0.6, 0.1, 0.45, 0.6, 0.5, 0.5))
    for ax in grid.flat[len(files) :]:
        ax.set_axis_off()
    for i, (ax, analysis) in enumerate(zip(grid.flat, files, strict=False)):
        drop(analysis, ax, legend=False)
        if titles is not None:
            ax.set_title(titles[i])
    outer_labels(grid, len(files))
    shared_legend(figure_of(grid))
    return grid


def _envelope(analysis: DropAnalysis, ax: Axes, level_mm: float) -> None:
    reading = analysis.reading
    used = np.asarray(reading.used, dtype=bool)
    decay = reading.log_decrement / reading.damped_period if reading.damped_period else np.nan
    if not (reading.usable and np.isfinite(decay) and used.any()):
        return
    when = np.asarray(reading.extremum_time_s)[used]
    size = np.abs(np.asarray(reading.extremum_value_m)[used] * 1e3 - level_mm)
    # The amplitude that fits the used peaks in the logarithmic mean.
    positive = size > 0.0
    if not positive.any():
        return
    amplitude = np.exp(np.mean(np.log(size[positive]) + decay * (when[positive] - when[0])))
    time = np.linspace(when[0], max(when[-1] + reading.damped_period, when[0] + 1e-3), 120)
    for sign in (1.0, -1.0):
        envelope = level_mm + sign * amplitude * np.exp(-decay * (time - when[0]))
        ax.plot(time, envelope, color=MUTED, lw=0.8, label="envelope" if sign > 0 else None)


def _limit(analysis: DropAnalysis, ax: Axes) -> None:
    # The quiet seconds before the release and after the ringing say nothing: show the drop itself.
    if not np.isfinite(analysis.release_time_s):
        return
    period = analysis.reading.damped_period
    tail = 8.0 * period if np.isfinite(period) else 4.0
    start = max(analysis.release_time_s - 0.4, float(analysis.time_s[0]))
    ax.set_xlim(start, min(analysis.release_time_s + tail, float(analysis.time_s[-1])))
