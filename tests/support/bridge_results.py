"""Load effects of a made-up pass over a bridge of 20 m."""

from __future__ import annotations

import numpy as np

from sysid.prediction.bridge_effects import BridgeLoads, CodeEffect, LoadEffect
from sysid.prediction.predicted_passes import PassPrediction
from sysid.prediction.quantiles import Quantiles


def band(value: float) -> Quantiles:
    """A median with a tenth on both sides."""
    return Quantiles(*(np.array([value * f]) for f in (0.9, 1.0, 1.1)))


def loads(amplification: float = 1.2) -> BridgeLoads:
    """Moment and deflection at mid-span, static 300 kN m and 2 mm."""
    station, time = np.linspace(0.0, 20.0, 41), np.linspace(0.0, 2.0, 21)
    line = np.stack([np.minimum(station, 20.0 - station) / 2, 1e-9 * station * (20.0 - station)])
    history = np.stack([3e5 * np.sin(np.pi * time / 2), 2e-3 * np.sin(np.pi * time / 2)])
    effects = tuple(
        LoadEffect(k, name, kind, unit, "largest", band(size), band(size), band(amplification * size),
                   band(amplification), 12.0, np.array([size, 0.0]), (CodeEffect("LM1", 2 * size),))
        for k, (name, kind, unit, size) in enumerate(
            [("moment at 10 m", "moment", "N m", 3e5), ("deflection at 10 m", "deflection", "m", 2e-3)])
    )  # fmt: skip
    quantiles = Quantiles(0.9 * history, history, 1.1 * history)
    return BridgeLoads("river", 20.0, "", 1, 10.0, ("moment at 10 m", "deflection at 10 m"), ("N m", "m"), station,
                       line, effects, time, history, quantiles, np.array([4.0]), 3)  # fmt: skip


def over(speed: float, of_bridge: BridgeLoads) -> PassPrediction:
    """A pass of three axles at a speed [m/s] with these load effects."""
    time = np.linspace(0.0, 2.0, 21)
    force = np.full((3, 21), 5e4)
    ratio = np.full(3, 1.1)
    return PassPrediction("laden", speed, time, force, force, force, np.full(3, 5e4), ratio, ratio, ratio,
                          np.zeros(3, bool), shape="bridge river", bridge=of_bridge)  # fmt: skip
