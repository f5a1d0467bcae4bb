"""Figures of predicted passes: wheel load against time as in Figure 9a of the paper, suspension force, speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from sysid.plot.style import MUTED, axes_or_new, axle_color, figure, styled, thin

if TYPE_CHECKING:
    from sysid.prediction.predicted_passes import PassPrediction, SpeedSweep


@styled
def load_ratio(prediction: PassPrediction, axle: int, ax: Axes | None = None) -> Axes:
    """Vertical tire force of one axle (index) over its static load, with the band of the 5 % and 95 % quantiles."""
    ax = axes_or_new(ax)
    static = prediction.static_load_N[axle]
    color = axle_color(axle)
    middle = prediction.tire_force_q50_N[axle] / static
    low, high = prediction.tire_force_q05_N, prediction.tire_force_q95_N
    if low is None or high is None:
        ax.plot(*thin(prediction.time_s, middle, most=900), color=color, label="least squares")
    else:
        time, middle, lower, upper = thin(prediction.time_s, middle, low[axle] / static, high[axle] / static, most=900)
        ax.fill_between(time, lower, upper, color=color, alpha=0.3, lw=0, label="90 % band")
        ax.plot(time, middle, color=color, label="median")
    ax.axhline(1.0, color=MUTED, lw=0.8, ls=":")
    ax.axhline(0.0, color=MUTED, lw=0.8)
    ax.set_title(f"axle {axle + 1}")
    ax.set_xlabel("time after axle 1 meets the bump [s]")
    ax.set_ylabel("dynamic / static load [-]")
    return ax


@styled
def load_ratios(prediction: PassPrediction, per_row: int = 3) -> np.ndarray:
    """Load ratios of all axles of one pass on common axes; returns the axes (rows, per_row)."""
    count = len(prediction.static_load_N)
    per_row = min(per_row, count)
    rows = -(-count // per_row)
    fig = figure(3.65 * per_row, 2.1 * rows + 0.3)
    grid = fig.subplots(rows, per_row, squeeze=False, sharex=True, sharey=True)
    for ax in grid.flat[count:]:
        ax.set_axis_off()
    for axle, ax in zip(range(count), grid.flat, strict=False):
        load_ratio(prediction, axle, ax)
        ax.legend(loc="upper right")
        if axle % per_row:
            ax.set_ylabel("")
        if axle < count - per_row:
            ax.set_xlabel("")
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
    color = axle_color(axle)
    middle = force.q50[axle] / 1e3
    if force.q05 is None or force.q95 is None:
        ax.plot(*thin(prediction.time_s, middle, most=900), color=color, label="least squares")
    else:
        low, high = force.q05[axle] / 1e3, force.q95[axle] / 1e3
        time, middle, low, high = thin(prediction.time_s, middle, low, high, most=900)
        ax.fill_between(time, low, high, color=color, alpha=0.3, lw=0, label="90 % band")
        ax.plot(time, middle, color=color, label="median")
    ax.axhline(0.0, color=MUTED, lw=0.8)
    ax.set_title(f"axle {axle + 1}")
    ax.set_xlabel("time after axle 1 meets the bump [s]")
    ax.set_ylabel("suspension force [kN]")
    return ax


@styled
def load_ratio_against_speed(sweep: SpeedSweep, ax: Axes | None = None) -> Axes:
    """Peak dynamic load ratio of every axle against speed, with bands; grey beyond the speeds that were driven."""
    ax = axes_or_new(ax)
    speed, ratio = 3.6 * sweep.speed_m_s, sweep.peak_ratio
    beyond = speed[0] if sweep.driven_m_s is None else 3.6 * sweep.driven_m_s[1]
    if beyond < speed[-1]:
        ax.axvspan(beyond, speed[-1], color=MUTED, alpha=0.12, lw=0, label="not driven")
    for axle in range(ratio.q50.shape[1]):
        color = axle_color(axle)
        if ratio.q05 is not None and ratio.q95 is not None:
            ax.fill_between(speed, ratio.q05[:, axle], ratio.q95[:, axle], color=color, alpha=0.3, lw=0)
        ax.plot(speed, ratio.q50[:, axle], color=color, marker="o", ms=3, label=f"axle {axle + 1}")
    ax.axhline(1.0, color=MUTED, lw=0.8, ls=":")
    ax.set_xlabel("speed [km/h]")
    ax.set_ylabel("peak dynamic / static load [-]")
    ax.legend(loc="upper left")
    return ax
