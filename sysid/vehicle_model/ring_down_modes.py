"""Modes of a vehicle in the deflection of one suspension after a drop of a wheel or the release of a body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eig

from sysid.vehicle_model.vibration_modes import SmallMotion


@dataclass(frozen=True)
class RingDownModes:
    """Oscillating modes in one deflection, y(t) = sum_j Re(amplitude_j exp(pole_j t)), the strongest first.

    `pole` (m,) [1/s] with positive imaginary part; `amplitude` (m,) [m per m of the drop]; `strength` (m,) the square
    root of the integral of each mode's squared envelope, relative to the largest.
    """

    pole: np.ndarray
    amplitude: np.ndarray
    strength: np.ndarray


def modes_after_drop(motion: SmallMotion, axle: int, frequency_range_hz: tuple[float, float]) -> RingDownModes:
    """Modes in the deflection of suspension `axle` after its wheel has dropped by a unit height from static rest.

    The start is K x = kt w', the rest on a plank of unit height under that wheel alone; tires and suspensions are
    linear and the wheels stay on the ground.
    """
    start = np.linalg.solve(motion.stiffness, motion.tire_stiffness[axle] * motion.wheel[axle])
    return _modes(motion, motion.extension[axle], start, frequency_range_hz)


def modes_after_release(
    motion: SmallMotion, axle: int, lifted: Sequence[int], frequency_range_hz: tuple[float, float]
) -> RingDownModes:
    """Modes in the deflection of suspension `axle` after the body above the axles `lifted` was held up by a unit.

    The start is the rest with the least energy that has the body at that height above each of them.
    """
    rows = motion.above[list(lifted)]
    flexible = np.linalg.solve(motion.stiffness, rows.T)
    start = flexible @ np.linalg.pinv(rows @ flexible) @ np.ones(len(rows))
    return _modes(motion, motion.extension[axle], start, frequency_range_hz)


def _modes(
    motion: SmallMotion, row: np.ndarray, start: np.ndarray, frequency_range_hz: tuple[float, float]
) -> RingDownModes:
    count = start.size
    state = np.zeros((2 * count, 2 * count))
    state[:count, count:] = np.eye(count)
    state[count:, :count] = -np.linalg.solve(motion.mass, motion.stiffness)
    state[count:, count:] = -np.linalg.solve(motion.mass, motion.damping)
    poles, vectors = eig(state)
    parts = (row @ vectors[:count]) * np.linalg.solve(vectors, np.concatenate([start, np.zeros(count)]))
    hertz = poles.imag / (2.0 * np.pi)
    kept = (hertz >= frequency_range_hz[0]) & (hertz <= frequency_range_hz[1]) & (poles.real < 0.0)
    pole, amplitude = poles[kept], 2.0 * np.abs(parts[kept])
    strength = amplitude / np.sqrt(-2.0 * pole.real)
    order = np.argsort(-strength)
    largest = max(float(strength.max(initial=0.0)), 1e-300)
    return RingDownModes(pole[order], amplitude[order], strength[order] / largest)
