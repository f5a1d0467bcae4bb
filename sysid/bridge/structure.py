"""A bridge as a moving vehicle meets it: influence lines of its load effects, and its natural modes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.interpolate import PPoly

#: Kinds of load effects and their units; an influence line is per newton of load.
EffectKind = Literal["moment", "shear", "deflection", "other"]
EFFECT_UNITS: dict[EffectKind, str] = {"moment": "N m", "shear": "N", "deflection": "m", "other": ""}


@dataclass(frozen=True)
class Curve:
    """Piecewise polynomial along the bridge, zero before its first and behind its last station.

    Where it jumps, `at` gives the value behind the jump.
    """

    pieces: PPoly

    def at(self, station_m: np.ndarray) -> np.ndarray:
        """Values at stations of any shape; curves of n columns add an axis (..., n)."""
        station = np.asarray(station_m, float)
        first, last = self.pieces.x[[0, -1]]
        inside = (station >= first) & (station <= last)
        found = self.pieces(np.clip(station, first, last))
        return np.where(inside.reshape(inside.shape + (1,) * (found.ndim - inside.ndim)), found, 0.0)

    @property
    def breaks_m(self) -> np.ndarray:
        """Stations between which the curve is one polynomial."""
        return np.asarray(self.pieces.x)


def straight_pieces(station_m: np.ndarray, values: np.ndarray) -> Curve:
    """The straight lines between points, values (m,) or (m, n); where a station stands twice the curve jumps."""
    steps = np.diff(station_m)
    whole = np.flatnonzero(steps > 0.0)
    widths = steps[whole].reshape((-1,) + (1,) * (values.ndim - 1))
    slopes = (values[whole + 1] - values[whole]) / widths
    return Curve(PPoly(np.stack([slopes, values[whole]]), np.append(station_m[whole], station_m[-1])))


@dataclass(frozen=True)
class InfluenceLine:
    """What a unit load does to one load effect: I(s) per newton at station s.

    `jump_m` is where the line of a shear force jumps, None for others.
    """

    name: str
    kind: EffectKind
    curve: Curve
    station_m: float | None = None
    jump_m: float | None = None


@dataclass(frozen=True)
class BridgeModes:
    """Natural modes, n of them.

    `frequency_hz`, `damping_ratio`, `modal_mass_kg` (n,); `shape` has n columns [-]; `effects` (effects, n) is what a
    unit of each mode's amplitude does to every load effect of the bridge [its unit per m].
    """

    frequency_hz: np.ndarray
    damping_ratio: np.ndarray
    modal_mass_kg: np.ndarray
    shape: Curve
    effects: np.ndarray

    @property
    def angular_frequency(self) -> np.ndarray:
        """Natural angular frequencies (n,) [rad/s]."""
        return np.asarray(2.0 * np.pi * self.frequency_hz)


@dataclass(frozen=True)
class Bridge:
    """A bridge of a length [m] from its first to its last station, with the influence lines of its load effects.

    Without `modes` it takes no part in the motion: loads move along the influence lines.
    """

    name: str
    length_m: float
    lines: tuple[InfluenceLine, ...]
    modes: BridgeModes | None = None
