"""Figures of axle loads over rough roads: along the road, spectra, range pairs, against speed and class."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter

from sysid.plot.predictions import DRIVEN
from sysid.plot.style import MUTED, axes_or_new, axle_color, label, styled, thin

if TYPE_CHECKING:
    from sysid.prediction.predicted_passes import PassPrediction, RoadLoads
    from sysid.prediction.quantiles import Quantiles


@styled
def axle_load_along_road(prediction: PassPrediction, axle: int, axle_x_m: float, ax: Axes | None = None) -> Axes:
    """Load of one axle (index) along the road [kN], with its band and the load at rest.

    Parameters
    ----------
    axle_x_m : place of the axle behind axle 1 [m].
    """
    ax = axes_or_new(ax)
    color = axle_color(axle)
    station = prediction.speed_m_s * prediction.time_s - axle_x_m
    end = station[-1] if prediction.road is None else prediction.road.length_m
    shown = (station >= 0.0) & (station <= end)
    bands = (prediction.tire_force_q50_N, prediction.tire_force_q05_N, prediction.tire_force_q95_N)
    middle, low, high = (None if f is None else 1e-3 * f[axle, shown] for f in bands)
    if middle is not None and low is not None and high is not None:
        place, middle, low, high = thin(station[shown], middle, low, high, most=1200)
        ax.fill_between(place, low, high, color=color, alpha=0.3, lw=0, label="90 % band")
        ax.plot(place, middle, color=color, lw=0.8, label="median")
    elif middle is not None:
        ax.plot(*thin(station[shown], middle, most=1200), color=color, lw=0.8, label="least squares")
    ax.axhline(1e-3 * prediction.static_load_N[axle], color="black", lw=0.9, ls="--", label="at rest")
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel("station [m]")
    ax.set_ylabel("axle load [kN]")
    ax.set_title(f"axle {axle + 1}")
    return ax


@styled
def load_spectrum(road: RoadLoads, ax: Axes | None = None) -> Axes:
    """Power spectral density of every axle load [kN2/Hz], with its band."""
    ax = axes_or_new(ax)
    shown = road.frequency_hz > 0.0
    _bands(ax, road.frequency_hz[shown], road.spectrum_N2_Hz, 1e-6, shown)
    _logarithmic(ax, "xy")
    top = 1e-6 * float(road.spectrum_N2_Hz.q50[:, shown].max(initial=0.0))
    if top > 0.0:
        ax.set_ylim(1e-5 * top, 3.0 * top)
    ax.set_xlabel("frequency [Hz]")
    ax.set_ylabel("density of axle load [kN\u00b2/Hz]")
    ax.legend(loc="lower left")
    return ax


@styled
def range_pairs(road: RoadLoads, ax: Axes | None = None) -> Axes:
    """How often per kilometre every axle load goes to and fro by more than a share of the load at rest."""
    ax = axes_or_new(ax)
    every = np.ones(road.range_levels.size, bool)
    _bands(ax, road.range_levels, road.tire_ranges_per_km, 1.0, every)
    _logarithmic(ax, "y")
    most = float(road.tire_ranges_per_km.q50.max(initial=0.0))
    ax.set_ylim(0.5, max(2.0 * most, 10.0))
    ax.set_xlim(0.0, float(road.range_levels[(road.tire_ranges_per_km.q50 > 0.3).any(axis=0)].max(initial=0.5)))
    ax.set_xlabel("range / load at rest [-]")
    ax.set_ylabel("larger ranges per km")
    ax.legend(loc="upper right")
    return ax


def _logarithmic(ax: Axes, which: str) -> None:
    """Logarithmic axes with plain numbers: figures set no mathematics."""
    ax.set(**{f"{name}scale": "log" for name in which})
    for axis in (getattr(ax, f"{name}axis") for name in which):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())


def _bands(ax: Axes, x: np.ndarray, values: Quantiles, factor: float, shown: np.ndarray) -> None:
    """A curve per axle of values (axles, m) against x, with its band."""
    for axle, row in enumerate(values.q50):
        if values.q05 is not None and values.q95 is not None:
            low, high = (factor * q[axle, shown] for q in (values.q05, values.q95))
            ax.fill_between(x, low, high, color=axle_color(axle), alpha=0.25, lw=0)
        ax.plot(x, factor * row[shown], color=axle_color(axle), label=f"axle {axle + 1}")


@styled
def road_load_against_speed(
    passes: Sequence[PassPrediction], driven_m_s: tuple[float, float] | None, ax: Axes | None = None
) -> Axes:
    """Peak load of every axle over one road against speed [kN], with its band; shaded where runs were driven.

    Parameters
    ----------
    driven_m_s : lowest and highest speed of the runs of the load case, None without any.
    """
    ax = axes_or_new(ax)
    ordered = sorted(passes, key=lambda p: p.speed_m_s)
    speed = np.array([3.6 * p.speed_m_s for p in ordered])
    if driven_m_s is not None:
        ax.axvspan(*(3.6 * v for v in driven_m_s), color=DRIVEN, alpha=0.16, lw=0, label="driven")
    for axle in range(len(ordered[0].static_load_N)):
        color = axle_color(axle)
        loads = [p.axle_load_kN for p in ordered]
        low = [float(q.q05[axle]) for q in loads if q.q05 is not None]
        high = [float(q.q95[axle]) for q in loads if q.q95 is not None]
        if len(low) == len(high) == speed.size:
            ax.fill_between(speed, low, high, color=color, alpha=0.25, lw=0)
        ax.plot(speed, [q.q50[axle] for q in loads], color=color, marker="o", ms=3, label=f"axle {axle + 1}, peak")
        ax.axhline(1e-3 * ordered[0].static_load_N[axle], color=color, lw=0.7, ls="--")
    ax.plot([], [], color=MUTED, lw=0.7, ls="--", label="at rest")
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel("speed [km/h]")
    ax.set_ylabel("axle load [kN]")
    ax.legend(loc="best", ncols=2, fontsize=7)
    return ax


@styled
def damage_against_speed(
    passes: Sequence[PassPrediction], driven_m_s: tuple[float, float] | None, ax: Axes | None = None
) -> Axes:
    """Road stress factor of the whole vehicle against speed, a curve per road, with its band.

    Parameters
    ----------
    driven_m_s : as in :func:`road_load_against_speed`.
    """
    ax = axes_or_new(ax)
    if driven_m_s is not None:
        ax.axvspan(*(3.6 * v for v in driven_m_s), color=DRIVEN, alpha=0.16, lw=0, label="driven")
    roads: dict[str, list[tuple[float, Quantiles]]] = {}
    for p in sorted(passes, key=lambda p: p.speed_m_s):
        if p.road is not None:
            roads.setdefault(p.shape, []).append((3.6 * p.speed_m_s, p.road.vehicle_stress))
    for k, (name, points) in enumerate(roads.items()):
        speed, factors = [v for v, _ in points], [q for _, q in points]
        low = [float(q.q05[0]) for q in factors if q.q05 is not None]
        high = [float(q.q95[0]) for q in factors if q.q95 is not None]
        if len(low) == len(high) == len(speed):
            ax.fill_between(speed, low, high, color=axle_color(k), alpha=0.25, lw=0)
        ax.plot(speed, [q.q50[0] for q in factors], color=axle_color(k), marker="o", ms=3, label=label(name, 40))
    ax.axhline(1.0, color=MUTED, lw=0.8, ls=":")
    ax.set_xlabel("speed [km/h]")
    ax.set_ylabel("road stress factor of the vehicle [-]")
    ax.legend(loc="upper left")
    return ax
