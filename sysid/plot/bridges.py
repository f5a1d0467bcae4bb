"""Figures of load effects on bridges: the truck at its worst place, effects against time, amplification over speed."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from sysid.plot.style import MUTED, axes_or_new, axle_color, label, styled

if TYPE_CHECKING:
    from sysid.prediction.bridge_effects import BridgeLoads, LoadEffect
    from sysid.prediction.predicted_passes import PassPrediction

#: Units of figures: factor from SI and unit of a load effect, and of its influence line.
_EFFECT = {"N m": (1e-3, "kN m"), "N": (1e-3, "kN"), "m": (1e3, "mm"), "": (1.0, "")}
_LINE = {"N m": (1.0, "kN m per kN"), "N": (1.0, "kN per kN"), "m": (1e9, "mm per MN"), "": (1.0, "per N")}


@styled
def influence_line(loads: BridgeLoads, effect: LoadEffect, axle_x_m: Sequence[float], ax: Axes | None = None) -> Axes:
    """Influence line of a load effect with the axles where it is at its extreme, static load arrows downward.

    Parameters
    ----------
    axle_x_m : places of the axles behind axle 1 [m].
    """
    ax = axes_or_new(ax)
    factor, unit = _LINE[effect.unit]
    line = factor * loads.influence[effect.line]
    ax.fill_between(loads.station_m, 0.0, line, color=MUTED, alpha=0.2, lw=0)
    ax.plot(loads.station_m, line, color="black", lw=1.2)
    ax.axhline(0.0, color="black", lw=1.5)
    axles = np.asarray(axle_x_m, float)
    behind = float(axles.max()) + loads.gap_m
    top = 1.25 * max(float(line.max()), 0.0) + 0.25 * float(np.ptp(line))
    for vehicle in range(loads.vehicles):
        for i, x in enumerate(axles):
            at = effect.front_m - x - vehicle * behind
            if not 0.0 <= at <= loads.length_m:
                continue
            height = float(np.interp(at, loads.station_m, line))
            ax.annotate("", (at, height), (at, top), arrowprops={"arrowstyle": "->", "color": axle_color(i), "lw": 1.6})
            ax.annotate(f"{i + 1}", (at, top), ha="center", va="bottom", color=axle_color(i), fontsize=8)
    ax.set_ylim(top=1.18 * top)
    ax.set_xlabel(f"station [m]; {effect.sense} with axle 1 at {effect.front_m:.1f} m, driving to the right")
    ax.set_ylabel(unit)
    ax.set_title(label(effect.name, 48))
    return ax


@styled
def effect_history(loads: BridgeLoads, effect: LoadEffect, ax: Axes | None = None) -> Axes:
    """A load effect against time, static and dynamic with its band."""
    ax = axes_or_new(ax)
    factor, unit = _EFFECT[effect.unit]
    band, k = loads.history, effect.line
    if band.q05 is not None and band.q95 is not None:
        ax.fill_between(loads.time_s, factor * band.q05[k], factor * band.q95[k], color="#0072b2", alpha=0.3, lw=0,
                        label="90 % band")  # fmt: skip
    ax.plot(loads.time_s, factor * band.q50[k], color="#0072b2", lw=1.2, label="dynamic")
    ax.plot(loads.time_s, factor * loads.static[k], color="black", lw=1.0, ls="--", label="static")
    ax.axhline(0.0, color=MUTED, lw=0.8)
    ax.set_xlabel("time after axle 1 is at the first support [s]")
    ax.set_ylabel(unit)
    ax.set_title(f"{label(effect.title, 36)}: amplification {effect.amplification.q50[0]:.3f}")
    ax.legend(loc="best")
    return ax


@styled
def amplification_against_speed(
    passes: Sequence[PassPrediction], ax: Axes | None = None, shown: Collection[str] | None = None
) -> Axes:
    """Dynamic over static of load effects against speed, with their bands: passes over one bridge.

    Parameters
    ----------
    shown : titles of the load effects, all of them if None.
    """
    ax = axes_or_new(ax)
    of_bridge = sorted((p for p in passes if p.bridge is not None), key=lambda p: p.speed_m_s)
    speed = np.array([3.6 * p.speed_m_s for p in of_bridge])
    curves: dict[str, list[LoadEffect]] = {}
    for p in of_bridge:
        for e in p.bridge.effects if p.bridge is not None else ():
            if shown is None or e.title in shown:
                curves.setdefault(e.title, []).append(e)
    for k, (title, effects) in enumerate(curves.items()):
        if len(effects) != speed.size:
            continue
        bands = [e.amplification for e in effects]
        middle = np.array([b.q50[0] for b in bands])
        low = [b.q05[0] for b in bands if b.q05 is not None]
        high = [b.q95[0] for b in bands if b.q95 is not None]
        if len(low) == len(high) == speed.size:
            ax.fill_between(speed, low, high, color=axle_color(k), alpha=0.2, lw=0)
        ax.plot(speed, middle, color=axle_color(k), marker="o", ms=3, label=label(title))
    ax.axhline(1.0, color=MUTED, lw=0.8, ls=":")
    ax.set_xlabel("speed [km/h]")
    ax.set_ylabel("dynamic / static load effect [-]")
    ax.legend(loc="best", fontsize=7)
    return ax
