"""Measured against simulated histories, as in Figures 7 and 8 of the paper, and what is left between them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator

from sysid.display import Z90
from sysid.plot.style import (
    INK,
    MEASURED,
    MUTED,
    WARNING,
    axes_or_new,
    axle_color,
    channel_axes,
    display,
    figure,
    label,
    styled,
    thin,
)

if TYPE_CHECKING:
    from sysid.estimation.fit.fit_result import FitResult
    from sysid.estimation.residuals.run_history import RunHistory

POSTERIOR, READING = "90 % posterior", "90 % new readings"
_ALPHA = {POSTERIOR: 0.45, READING: 0.16}

_KIND = {
    "suspension_deflection": "suspension deflection",
    "axle_acceleration": "acceleration",
    "body_acceleration": "body acceleration",
    "pitch_rate": "pitch rate",
    "bellows_extension": "extension of the bellows by its pressure",
}


def channel_title(history: RunHistory, row: int) -> str:
    """What a channel shows, in words: kind, axle (counting from 1) where it has one, and the column of the log."""
    axle = history.axles[row]
    kind = _KIND.get(history.kinds[row], history.kinds[row])
    place = "" if axle is None else f"axle {axle + 1}, "
    return f"{place}{kind} ({history.columns[row]})"


@styled
def overlay(
    history: RunHistory,
    column: str,
    ax: Axes | None = None,
    residual_ax: Axes | None = None,
    legend: bool = True,
    most_points: int = 1500,
    show_bands: bool = True,
) -> Axes:
    """One channel of one run: measured and simulated on `ax`, measured minus simulated on `residual_ax` if given.

    With `ax` None a figure with both is made.  After sampling the darker band holds 90 % of the posterior's
    simulations, the lighter one 90 % of new readings: posterior and residual scatter together.  Before, the band about
    zero holds 90 % of the scatter that the fit assigns to the channel: +- 1.645 times its residual scale.  Clipped
    samples, whose true value lies beyond the reading, are marked.  Raises KeyError if the run has no such column.
    """
    if column not in history.columns:
        raise KeyError(f"run {history.file} has no column {column}; it has {', '.join(history.columns)}")
    row = history.columns.index(column)
    if ax is None:
        ax, residual_ax = figure(6.4, 3.8).subplots(2, 1, sharex=True, height_ratios=(2, 1))
    measured, unit = display(history.measured[row], history.si_units[row])
    simulated, _ = display(history.simulated[row], history.si_units[row])
    axle = history.axles[row]
    color = INK if axle is None else axle_color(axle)
    bands = _bands(history, row) if show_bands else {}
    _fill(ax, history.time_s, bands, color, most_points, named=residual_ax is None)
    # Measured broad and pale below, simulated narrow above: both stay visible where they agree.
    ax.plot(*thin(history.time_s, measured, most=most_points), color=MEASURED, lw=2.6, label="measured")
    ax.plot(*thin(history.time_s, simulated, most=most_points), color=color, lw=1.0, label="simulated")
    clipped = np.asarray(history.censored[row]) != 0
    if clipped.any():
        ax.plot(history.time_s[clipped], measured[clipped], "x", ms=4, color=WARNING, ls="", label="clipped")
    ax.set_title(label(channel_title(history, row), 60))
    quantity = _KIND.get(history.kinds[row], history.kinds[row]).split()[-1]
    ax.set_ylabel(label(f"{quantity} [{unit}]", 30) if legend else f"[{unit}]")
    if legend:
        _legend_above(ax, 0.2)
    if residual_ax is None:
        ax.set_xlabel("time [s]")
    else:
        residual = np.where(clipped, np.nan, measured - simulated)
        residual_ax.plot(*thin(history.time_s, residual, most=most_points), color=MUTED, lw=0.8)
        residual_ax.axhline(0.0, color=INK, lw=0.6)
        reach = Z90 * float(display(np.asarray(history.noise_sd[row]), history.si_units[row])[0])
        if bands:
            about = {name: (low - simulated, high - simulated) for name, (low, high) in bands.items()}
            _fill(residual_ax, history.time_s, about, color, most_points)
            _legend_above(residual_ax, 0.45)
        elif np.isfinite(reach):
            residual_ax.axhspan(-reach, reach, color=color, alpha=0.2, lw=0)
        residual_ax.set_ylabel("meas. −\nsim.")
        residual_ax.set_xlabel("time [s]")
    return ax


def _legend_above(ax: Axes, room: float) -> None:
    """A legend in room of its own above the curves, a share of their height: it hides no peak."""
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + room * (high - low))
    ax.legend(loc="upper right", ncols=3)


def _bands(history: RunHistory, row: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Ends of the bands of a channel in display units, the wider one first; none before sampling."""
    bands = {}
    for name, band in ((READING, history.reading_band), (POSTERIOR, history.band)):
        if band is not None and np.isfinite(band.high[row]).all():
            unit = history.si_units[row]
            bands[name] = (display(band.low[row], unit)[0], display(band.high[row], unit)[0])
    return bands


def _fill(
    ax: Axes,
    time_s: np.ndarray,
    bands: dict[str, tuple[np.ndarray, np.ndarray]],
    color: str,
    most: int,
    named: bool = True,
) -> None:
    for name, (low, high) in bands.items():
        time, lower, upper = thin(time_s, low, high, most=most)
        ax.fill_between(time, lower, upper, color=color, alpha=_ALPHA[name], lw=0, label=name if named else None)


@styled
def suspension_histories(history: RunHistory, axles: tuple[int, ...]) -> np.ndarray:
    """Deflection and axle acceleration of the named `axles` (indices) of one run: Figures 7 and 8 of the paper.

    Returns the axes (2 * axles, 2): per axle a row of histories and below it the row of their differences.
    """
    fig = figure(11.0, 3.4 * len(axles))
    grid = fig.subplots(2 * len(axles), 2, sharex=True, squeeze=False, height_ratios=(2, 1) * len(axles))
    for r, axle in enumerate(axles):
        for c, kind in enumerate(("suspension_deflection", "axle_acceleration")):
            upper, lower = grid[2 * r, c], grid[2 * r + 1, c]
            rows = [
                i for i, (a, k) in enumerate(zip(history.axles, history.kinds, strict=True)) if (a, k) == (axle, kind)
            ]
            if not rows:
                upper.text(
                    0.5, 0.5, f"axle {axle + 1}: no {_KIND[kind]} recorded", ha="center", transform=upper.transAxes
                )
                continue
            overlay(history, history.columns[rows[0]], upper, lower)
            if r < len(axles) - 1:
                lower.set_xlabel("")
    return grid


@styled
def channel_grid(history: RunHistory, columns: tuple[str, ...] | None = None, per_row: int = 3) -> np.ndarray:
    """All channels of one run, or the named ones, measured against simulated; returns the axes (rows, per_row)."""
    chosen = history.columns if columns is None else columns

    def draw(column: str, ax: Axes) -> None:
        # On axes this small a band is no wider than the line in it.
        overlay(history, column, ax, legend=False, most_points=420, show_bands=False)
        ax.set_title(label(_short_title(history, history.columns.index(column)), 44))

    return channel_axes(chosen, draw, "time [s]", per_row, ((10.3 - 0.55 * (per_row - 1)) / per_row, 1.35), ticks=5)


def _short_title(history: RunHistory, row: int) -> str:
    kind = {"suspension_deflection": "deflection", "axle_acceleration": "axle acc.", "body_acceleration": "body acc."}
    kind |= {"pitch_rate": "pitch rate", "bellows_extension": "bellows"}
    axle = history.axles[row]
    place = "" if axle is None else f"axle {axle + 1} "
    return f"{place}{kind.get(history.kinds[row], history.kinds[row])} · {history.columns[row]}"


@styled
def autocorrelation(fit: FitResult, ax: Axes | None = None) -> Axes:
    """Autocorrelation of the standardised residuals and of their innovations: every channel, medians, white noise."""
    ax = axes_or_new(ax)
    evidence = fit.residual_evidence
    lag, rows = evidence.lag_s, np.atleast_2d(evidence.autocorrelation_before)
    for i, row in enumerate(rows[:: max(1, len(rows) // 60)]):
        ax.plot(lag, row, color=axle_color(0), lw=0.5, alpha=0.25, label="one channel of one run" if i == 0 else None)
    medians = (
        (evidence.autocorrelation_before, "-", "median"),
        (evidence.autocorrelation_after, "--", "median, innovations"),
    )
    for values, style, words in medians:
        finite = values[np.any(np.isfinite(values), axis=1)] if np.size(values) else values
        if np.size(finite):
            ax.plot(lag, np.nanmedian(finite, axis=0), style, color=INK, lw=1.6, label=words)
    samples = max(fit.residuals / max(len(rows), 1), 1.0)
    band = 1.96 / np.sqrt(samples)
    ax.axhspan(-band, band, color=MUTED, alpha=0.18, lw=0, label="white noise, 95 %")
    ax.axhline(0.0, color=MUTED, lw=0.6)
    ax.set_xlabel("lag [s]")
    ax.set_ylabel("autocorrelation [-]")
    ax.legend(loc="upper right")
    return ax


@styled
def residual_spectrum(fit: FitResult, ax: Axes | None = None) -> Axes:
    """Power spectrum of residuals (solid) and innovations (dashed) by kind of sensor, over that of white ones."""
    ax = axes_or_new(ax)
    evidence = fit.residual_evidence
    for i, kind in enumerate(evidence.kinds):
        words = kind.replace("_", " ")
        # Both ends of a spectrum are half a band, and the mean has been taken out.
        at, before, after = (v[1:-1] for v in (evidence.frequency_hz, evidence.before[i], evidence.after[i]))
        ax.plot(at, before, color=axle_color(i), lw=1.4, label=words)
        ax.plot(at, after, "--", color=axle_color(i), lw=1.1, label=f"{words}, innovations")
    ax.axhline(1.0, color=MUTED, lw=0.8)
    ax.set_yscale("log")
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter("{x:g}")
    ax.yaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
    ax.set_xlabel("frequency [Hz]")
    ax.set_ylabel("power over that of white residuals [-]")
    ax.legend(loc="upper right")
    return ax
