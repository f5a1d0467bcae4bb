"""Figures of predicted passes: axle load against time as in Figure 9a of the paper, suspension force, speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from sysid.plot.style import MUTED, axes_grid, axes_or_new, axle_color, outer_labels, styled, thin

if TYPE_CHECKING:
    from sysid.prediction.predicted_passes import PassPrediction, SpeedSweep

#: Colour of the speeds that were driven.
DRIVEN = "#009e73"
#: Quantiles 5, 50 and 95 % of a force, (axles, T) each; without draws only the middle one.
_Force = tuple[np.ndarray | None, np.ndarray, np.ndarray | None]


@styled
def load_ratio(prediction: PassPrediction, axle: int, ax: Axes | None = None) -> Axes:
    """Vertical tire force of one axle (index) over its static load, with the band of the 5 % and 95 % quantiles.

    Hatched: instants at which the axle is beyond what the driven runs reached.
    """
    ax = axes_or_new(ax)
    force = prediction.tire_force_q05_N, prediction.tire_force_q50_N, prediction.tire_force_q95_N
    _draw_history(prediction, force, axle, float(prediction.static_load_N[axle]), ax)
    ax.axhline(1.0, color=MUTED, lw=0.8, ls=":")
    ax.set_ylabel("dynamic / static load [-]")
    return ax


def _draw_history(prediction: PassPrediction, force: _Force, axle: int, unit_N: float, ax: Axes) -> None:
    """Force of one axle over the pass in multiples of `unit_N`, with its band where there is one."""
    color = axle_color(axle)
    low, median, high = force
    if low is None or high is None:
        ax.plot(*thin(prediction.time_s, median[axle] / unit_N, most=900), color=color, label="least squares")
    else:
        values = (f[axle] / unit_N for f in (low, median, high))
        time, lower, middle, upper = thin(prediction.time_s, *values, most=900)
        ax.fill_between(time, lower, upper, color=color, alpha=0.3, lw=0, label="90 % band")
        ax.plot(time, middle, color=color, label="median")
    ax.axhline(0.0, color=MUTED, lw=0.8)
    _hatch_beyond(prediction, axle, ax)
    ax.set_title(f"axle {axle + 1}")
    met = "meets the bump" if prediction.road is None else "meets the road"
    met = met if prediction.bridge is None else "is on the bridge"
    ax.set_xlabel(f"time after axle 1 {met} [s]")


def _hatch_beyond(prediction: PassPrediction, axle: int, ax: Axes) -> None:
    """Hatch the instants at which an axle is beyond the driven runs, over the whole height of the axes."""
    if prediction.beyond is None or not prediction.beyond[axle].any():
        return
    edges = np.flatnonzero(np.diff(np.concatenate([[0], prediction.beyond[axle].astype(int), [0]])))
    time, step = prediction.time_s, float(prediction.time_s[1] - prediction.time_s[0])
    spans = [(float(time[a]), (b - a) * step) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    ax.broken_barh(
        spans,
        (0.0, 1.0),
        transform=ax.get_xaxis_transform(),
        facecolor="none",
        edgecolor=MUTED,
        hatch="////",
        lw=0.0,
        zorder=0,
        label="beyond the driven runs",
    )


@styled
def load_ratios(prediction: PassPrediction, per_row: int = 3) -> np.ndarray:
    """Load ratios of all axles of one pass on common axes; returns the axes (rows, per_row)."""
    count = len(prediction.static_load_N)
    per_row = min(per_row, count)
    rows = -(-count // per_row)
    # Labels stand at the left and below alone.
    grid = axes_grid(rows, per_row, (3.3, 1.7), (0.5, 0.1, 0.45, 0.3, 0.2, 0.4), sharex=True, sharey=True)
    for ax in grid.flat[count:]:
        ax.set_axis_off()
    for axle, ax in zip(range(count), grid.flat, strict=False):
        load_ratio(prediction, axle, ax)
        ax.legend(loc="upper right")
    outer_labels(grid, count)
    return grid


@styled
def suspension_force(prediction: PassPrediction, axle: int, ax: Axes | None = None) -> Axes:
    """Force of spring, damper and friction of one axle (index) on the body, as in Figure 9b of the paper.

    Raises ValueError where the prediction holds no suspension forces.
    """
    ax = axes_or_new(ax)
    force = prediction.suspension_force_N
    if force is None:
        raise ValueError("The prediction holds no suspension forces; run the stage 'predict' again.")
    _draw_history(prediction, (force.q05, force.q50, force.q95), axle, 1e3, ax)
    ax.set_ylabel("suspension force [kN]")
    return ax


@styled
def axle_load_against_speed(sweep: SpeedSweep, static_load_N: np.ndarray, ax: Axes | None = None) -> Axes:
    """Peak load of every axle against speed [kN], with bands; shaded where runs of this load case were driven.

    Open marks where speed, tire deflection, travel or damper speed go beyond what the driven runs reached: the loads
    that have a star elsewhere.

    Parameters
    ----------
    static_load_N : static axle loads (axles,) [N] of the load case.
    """
    ax = axes_or_new(ax)
    kilonewtons = np.asarray(static_load_N) / 1e3
    if sweep.driven_m_s is not None:
        ax.axvspan(*(3.6 * v for v in sweep.driven_m_s), color=DRIVEN, alpha=0.16, lw=0, label="driven")
    past = np.broadcast_to(sweep.extrapolated[:, None], sweep.peak_ratio.q50.shape)
    _draw_against_speed(sweep, kilonewtons, ax, past if sweep.beyond is None else past | sweep.beyond)
    ax.set_ylim(bottom=0.0)
    ax.set_ylabel("peak axle load [kN]")
    ax.legend(loc="upper left", ncols=2)
    return ax


@styled
def load_ratio_against_speed(sweep: SpeedSweep, ax: Axes | None = None) -> Axes:
    """Peak dynamic load ratio of every axle against speed, with bands; grey beyond the speeds that were driven.

    Open marks where tire deflection, travel or damper speed of the axle goes beyond what the driven runs reached.
    """
    ax = axes_or_new(ax)
    speed = 3.6 * sweep.speed_m_s
    beyond = speed[0] if sweep.driven_m_s is None else 3.6 * sweep.driven_m_s[1]
    if beyond < speed[-1]:
        ax.axvspan(beyond, speed[-1], color=MUTED, alpha=0.12, lw=0, label="not driven")
    _draw_against_speed(sweep, np.ones(sweep.peak_ratio.q50.shape[1]), ax, sweep.beyond)
    ax.axhline(1.0, color=MUTED, lw=0.8, ls=":")
    ax.set_ylabel("peak dynamic / static load [-]")
    ax.legend(loc="upper left")
    return ax


def _draw_against_speed(sweep: SpeedSweep, unit: np.ndarray, ax: Axes, beyond: np.ndarray | None) -> None:
    """Peak ratio of every axle times its `unit` (axles,), with its band where there is one; open marks `beyond`."""
    speed, ratio = 3.6 * sweep.speed_m_s, sweep.peak_ratio
    for axle, factor in enumerate(unit):
        color = axle_color(axle)
        if ratio.q05 is not None and ratio.q95 is not None:
            low, high = factor * ratio.q05[:, axle], factor * ratio.q95[:, axle]
            ax.fill_between(speed, low, high, color=color, alpha=0.3, lw=0)
        middle = factor * ratio.q50[:, axle]
        ax.plot(speed, middle, color=color, marker="o", ms=3, label=f"axle {axle + 1}")
        if beyond is not None:
            past = beyond[:, axle]
            ax.plot(speed[past], middle[past], ls="", marker="o", ms=3, color=color, mfc="white")
    if beyond is not None and beyond.any():
        ax.plot([], [], ls="", marker="o", ms=3, color=MUTED, mfc="white", label="beyond the driven runs")
    ax.set_xlabel("speed [km/h]")
