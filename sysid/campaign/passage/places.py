"""Axles that meet the bump elsewhere than at their listed place, told from those whose sensor is upside down.

All axles are lifted by one bump, so that their velocities, laid over each other at their arrivals, have one shape. An
axle off its place has this shape at another way; a sensor that is upside down has the opposite shape at its place. The
one that fits better is the one that is said.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

#: Ways along which shapes are compared, about the arrival, and by which an axle may be off its place [m].
_WAY_M = np.arange(-0.6, 2.01, 0.04)
_NEAR_M, _FURTHEST_M, _STEP_M = 0.45, 2.5, 0.04
#: Correlation with the shape of the others that a place needs, and by how much it must be better than at the listed
#: place, either way up.
_ALIKE, _BETTER = 0.75, 0.1

Motion = tuple[np.ndarray, np.ndarray]


def found_elsewhere(
    met: Mapping[int, tuple[float, int]], rising: Mapping[int, Motion], x: Mapping[int, float], speed_m_s: float
) -> tuple[dict[int, tuple[float, int]], frozenset[int]]:
    """Arrivals of axles whose motion on the bump is that of the others, but not near their place; axles in doubt.

    Parameters
    ----------
    met
        Time [s] and direction (1 or -1) of the arrivals near the listed places, by axle.
    rising
        Times [s] and vertical velocity [m/s] of every axle.
    x
        Listed places [m].
    speed_m_s
        Speed of the run [m/s].

    Returns
    -------
    tuple
        Time [s] and direction of those alone that are found elsewhere. Axles that seem to be upside down, but whose
        motion is as much that of another place.
    """
    if len(met) < 3 or speed_m_s <= 0.0:
        return {}, frozenset()
    start = float(np.median([time - x[a] / speed_m_s for a, (time, _) in met.items()]))
    near = {a: start + x[a] / speed_m_s for a in rising}
    shapes = {a: up * _along(rising[a], near[a] + _WAY_M / speed_m_s) for a, (_, up) in met.items()}
    shapes = {a: shape / max(float(np.linalg.norm(shape)), 1e-12) for a, shape in shapes.items()}
    off = np.arange(-_FURTHEST_M, _FURTHEST_M + 0.5 * _STEP_M, _STEP_M)
    here = np.abs(off) <= _NEAR_M
    found, doubtful = {}, set()
    for axle, motion in rising.items():
        others = [shape for a, shape in shapes.items() if a != axle]
        common = np.mean(others, axis=0)
        # Where the others differ, as where several places are wrong, they are no measure of one.
        if len(others) < 2 or np.linalg.norm(common) < _ALIKE:
            continue
        lifted = 1 if sum(up for a, (_, up) in met.items() if a != axle) > 0 else -1
        tried = _along(motion, near[axle] + (off[:, None] + _WAY_M) / speed_m_s)
        size = np.linalg.norm(tried, axis=1) * np.linalg.norm(common)
        fits = tried @ common / np.maximum(size, 1e-12) * lifted
        best = int(np.argmax(fits))
        upside_down = float(-fits[here].min())
        if not here[best] and fits[best] > max(_ALIKE, float(np.abs(fits[here]).max()) + _BETTER):
            found[axle] = near[axle] + float(off[best]) / speed_m_s, lifted
        elif upside_down < max(_ALIKE, float(fits[~here].max()) + _BETTER):
            doubtful.add(axle)
    return found, frozenset(doubtful)


def _along(motion: Motion, at_s: np.ndarray) -> np.ndarray:
    return np.asarray(np.interp(at_s, *motion, left=0.0, right=0.0))
