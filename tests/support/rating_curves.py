"""Pairs of curves for the objective rating: closed forms and one seed, none of them like another."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

#: Sample interval of every curve [s], the 10 kHz of the standard.
INTERVAL_S = 1e-4


def rating_curves() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Name -> (measured, simulated), each (n,)."""
    rng = np.random.default_rng(18571)
    pulse = _pulse(600)
    noisy = rng.standard_normal(300)
    steps = np.round(_ring(400)(0.0), 1)
    return {
        "half amplitude": (pulse(0.0), 0.5 * pulse(0.0)),
        "early": (pulse(0.02), pulse(0.0)),
        "late": (pulse(0.0), pulse(0.031)),
        "later than the standard looks": (pulse(0.0), pulse(0.3)),
        "wider and higher": (pulse(0.0), 1.2 * _pulse(600, width=0.09)(0.01)),
        "offset": (pulse(0.0), pulse(0.0) + 0.2),
        "outside every corridor": (pulse(0.0), pulse(0.0) + 0.8),
        "upside down": (pulse(0.0), -pulse(0.0)),
        "ringing, wrong frequency": (_ring(500)(0.0), _ring(500, cycles=9.0)(0.0)),
        "ringing, late and damped": (_ring(500)(0.0), 0.8 * _ring(500, decay=5.0)(0.02)),
        "noise on one side": (_ring(300)(0.0), _ring(300)(0.0) + 0.05 * noisy),
        "noise on both sides": (_ring(300)(0.0) + 0.1 * noisy, _ring(300)(0.01) + 0.1 * noisy[::-1]),
        # Equal costs decide which way a path goes where samples repeat.
        "readings in coarse steps": (steps, np.roll(steps, 7)),
        "odd number of samples": (_ring(431)(0.0), _ring(431)(0.013)),
        "few samples": (_ring(37)(0.0), 1.1 * _ring(37)(0.03)),
    }


def _pulse(n: int, width: float = 0.07) -> Callable[[float], np.ndarray]:
    x = np.arange(n) / n
    return lambda shift: np.exp(-(((x - 0.4 - shift) / width) ** 2)) - 0.3 * np.exp(-(((x - 0.6 - shift) / 0.05) ** 2))


def _ring(n: int, cycles: float = 8.0, decay: float = 3.0) -> Callable[[float], np.ndarray]:
    x = np.arange(n) / n - 0.1

    def curve(shift: float) -> np.ndarray:
        since = np.maximum(x - shift, 0.0)
        return np.exp(-decay * since) * np.sin(2.0 * np.pi * cycles * since)

    return curve
