"""Figures of the posterior: marginals against priors, pairs, traces and correlations."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator, NullLocator

from sysid.plot.style import (
    INK,
    axes_grid,
    axes_or_new,
    axle_color,
    channel_axes,
    display,
    empty_grid,
    label,
    shared_legend,
    styled,
)

if TYPE_CHECKING:
    from sysid.estimation.fit.fit_result import FitResult
    from sysid.estimation.parameters.estimate import ParameterEstimate
    from sysid.posterior.sampled_posterior import Posterior

_MOST_POINTS = 1500


@styled
def marginal(posterior: Posterior, name: str, fit: FitResult | None = None, ax: Axes | None = None) -> Axes:
    """Histogram of one parameter's draws with its 90 % credible interval, and its prior where `fit` knows it."""
    ax = axes_or_new(ax, 3.0, 2.2)
    parameter = _parameter(fit, name)
    draws = _draws(posterior, name)
    values, unit = display(draws, parameter.unit if parameter else "")
    color = axle_color(parameter.axle if parameter else None)
    density, edges = np.histogram(values, bins=40, density=True)
    ax.stairs(density, edges, fill=True, color=color, alpha=0.45, label="posterior")
    low, high = np.quantile(values, [0.05, 0.95])
    ax.plot([low, high], [0.0, 0.0], color=color, lw=5, solid_capstyle="butt", clip_on=False, label="90 % interval")
    if parameter is not None:
        span = np.linspace(*_span(values, parameter), 200)
        factor = float(display(np.array(1.0), parameter.unit)[0])
        prior = _prior_density(parameter, span / factor) / factor
        ax.plot(span, prior, color=INK, lw=1.0, ls="--", label="prior")
    ax.set_yticks([])
    ax.spines["left"].set_visible(False)
    ax.set_xlabel(f"{label(name, 24)} [{unit}]" if unit else label(name, 24))
    ax.set_ylim(bottom=0.0)
    return ax


@styled
def marginals(
    posterior: Posterior, names: tuple[str, ...], fit: FitResult | None = None, per_row: int = 7
) -> np.ndarray:
    """Marginals of the named parameters side by side; returns the axes (rows, per_row)."""
    rows = max(1, -(-len(names) // per_row))
    per_row = max(1, -(-len(names) // rows))
    grid = axes_grid(rows, per_row, (1.5, 1.1), (0.12, 0.12, 0.48, 0.35, 0.12, 0.55))
    for ax in grid.flat[len(names) :]:
        ax.set_axis_off()
    for ax, name in zip(grid.flat, names, strict=False):
        marginal(posterior, name, fit, ax)
        # Labels at the very ends would run into those of the neighbour.
        ax.locator_params(axis="x", nbins=4, prune="both")
    shared_legend(grid[0, 0].figure)
    return grid


@styled
def corner(posterior: Posterior, names: tuple[str, ...], fit: FitResult | None = None) -> np.ndarray:
    """Pairs of the named parameters, thinned draws below the diagonal, marginals on it; returns the axes (p, p).

    Above the diagonal there are none, but None.
    """
    count = len(names)
    fig, places = empty_grid(count, count, (0.85, 0.85), (0.85, 0.1, 0.6, 0.1, 0.08, 0.08))
    grid = np.full((count, count), None)
    columns = []
    for name in names:
        parameter = _parameter(fit, name)
        values, unit = display(_draws(posterior, name), parameter.unit if parameter else "")
        columns.append((values, f"{label(name, 16)}\n[{unit}]", axle_color(parameter.axle if parameter else None)))
    for r, (y, y_label, color) in enumerate(columns):
        for c, (x, x_label, _) in enumerate(columns[: r + 1]):
            ax = grid[r, c] = fig.add_subplot(places[r, c])
            ax.grid(False)
            # Ticks that no label goes with cost most of the drawing time.
            if r < count - 1:
                ax.xaxis.set_major_locator(NullLocator())
            if c > 0 or r == 0:
                ax.yaxis.set_major_locator(NullLocator())
            if c == r:
                density, edges = np.histogram(x, bins=25)
                ax.stairs(density, edges, fill=True, color=color, alpha=0.5)
            else:
                step = max(1, len(x) // _MOST_POINTS)
                ax.plot(x[::step], y[::step], ",", color=INK, alpha=0.35, rasterized=True)
            if r == count - 1:
                ax.set_xlabel(x_label, fontsize=7)
                ax.xaxis.set_major_locator(MaxNLocator(3))
                ax.tick_params(axis="x", labelsize=6, length=2)
            if c == 0 and r > 0:
                ax.set_ylabel(y_label, fontsize=7)
                ax.yaxis.set_major_locator(MaxNLocator(3))
                ax.tick_params(axis="y", labelsize=6, length=2)
    return grid


@styled
def trace(posterior: Posterior, name: str, fit: FitResult | None = None, ax: Axes | None = None) -> Axes:
    """Mean over the walkers of one parameter, step by step, one line per independent ensemble."""
    ax = axes_or_new(ax, 3.0, 1.8)
    index = posterior.names.index(name)
    parameter = _parameter(fit, name)
    values, unit = display(posterior.draws[..., index].mean(axis=2), parameter.unit if parameter else "")
    steps = np.arange(values.shape[1]) * max(posterior.thin, 1)
    keep = slice(None, None, max(1, len(steps) // 300))
    for ensemble, row in enumerate(values):
        ax.plot(steps[keep], row[keep], lw=0.8, color=axle_color(ensemble), label=f"ensemble {ensemble + 1}")
    ax.set_xlabel("step after burn-in")
    ax.set_ylabel(f"[{unit}]" if unit else "")
    ax.set_title(label(name, 24))
    return ax


@styled
def traces(posterior: Posterior, names: tuple[str, ...], fit: FitResult | None = None, per_row: int = 4) -> np.ndarray:
    """Traces of the named parameters; returns the axes (rows, per_row)."""
    per_row = min(per_row, max(len(names), 1))

    def draw(name: str, ax: Axes) -> None:
        trace(posterior, name, fit, ax)

    return channel_axes(names, draw, "step after burn-in", per_row, (2.15, 1.0), ticks=4)


@styled
def correlation(matrix: np.ndarray, names: tuple[str, ...], ax: Axes | None = None) -> Axes:
    """Correlation matrix (p, p) of the named parameters, blue negative, red positive; large values are printed."""
    count = len(names)
    side = min(9.0, 0.32 * count + 2.2)
    ax = axes_or_new(ax, side + 0.8, side)
    picture = ax.imshow(matrix, cmap="RdBu_r", vmin=-1.0, vmax=1.0, interpolation="none", rasterized=True)
    for r in range(count):
        for c in range(count):
            value = matrix[r, c]
            if r != c and math.isfinite(value) and abs(value) >= 0.5:
                color = "white" if abs(value) > 0.7 else INK
                ax.text(c, r, f"{value:.1f}", ha="center", va="center", fontsize=6, color=color)
    shown = [label(n, 18) for n in names]
    ax.set_xticks(range(count), shown, rotation=90, fontsize=7)
    ax.set_yticks(range(count), shown, fontsize=7)
    ax.grid(False)
    bar = ax.figure.colorbar(picture, ax=ax, label="correlation [-]", shrink=0.7)
    if bar.solids is not None:
        bar.solids.set_rasterized(True)
    return ax


def posterior_correlation(posterior: Posterior) -> np.ndarray:
    """Correlation (p, p) of the draws of all ensembles; NaN for a parameter that does not vary."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.corrcoef(posterior.draws.reshape(-1, posterior.draws.shape[-1]), rowvar=False))


def _parameter(fit: FitResult | None, name: str) -> ParameterEstimate | None:
    if fit is None:
        return None
    return next((p for p in (*fit.parameters, *fit.run_parameters) if p.name == name), None)


def _draws(posterior: Posterior, name: str) -> np.ndarray:
    return posterior.draws[..., posterior.names.index(name)].ravel()


def _span(values: np.ndarray, parameter: ParameterEstimate) -> tuple[float, float]:
    # Room around the draws shows whether the prior is wider; a prior far wider must not squeeze the histogram.
    low, high = float(values.min()), float(values.max())
    margin = 0.6 * (high - low)
    return (max(low - margin, 1e-9 * high) if parameter.transform == "log" else low - margin), high + margin


def _prior_density(parameter: ParameterEstimate, x: np.ndarray) -> np.ndarray:
    """Density of the prior at `x` in SI units: lognormal for parameters kept as logarithms, else normal."""
    sd = parameter.prior_sd
    if not (math.isfinite(sd) and sd > 0.0):
        return np.full_like(x, np.nan)
    if parameter.transform == "log":
        z = (np.log(x) - math.log(parameter.prior_median)) / sd
        return np.asarray(np.exp(-0.5 * z**2) / (x * sd * math.sqrt(2.0 * math.pi)))
    z = (x - parameter.prior_median) / sd
    return np.exp(-0.5 * z**2) / (sd * math.sqrt(2.0 * math.pi))
