"""Readings that end at a level without a declared range: those of an amplifier or converter that clips."""

from __future__ import annotations

import numpy as np

# Readings in a row that count as clipped: with a noise of 15 steps three of them are equal by chance once in 3,000
# peaks, and a campaign has a few hundred peaks; four, once in 150,000.
CLIPPED_ROW = 4


def runs_of(mask: np.ndarray) -> list[tuple[int, int]]:
    """First and past-the-last index of every run of True."""
    edges = np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))
    return list(zip(np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist(), strict=True))


def quantum(value: np.ndarray) -> float:
    """Smallest step between different readings: the resolution of the written digits."""
    levels = np.unique(value[np.isfinite(value)])
    if levels.size < 2:
        return 0.0
    steps = np.diff(levels)
    return float(np.min(steps[steps > 1e-9 * np.ptp(levels)], initial=np.inf))


def clip_levels(value: np.ndarray) -> tuple[float | None, float | None]:
    """Levels (upper, lower) at which a channel clips without having declared it, None where it does not.

    A clipped channel has many readings at its extreme: four or more in a row, or some at several peaks. They are more
    than the readings in the next 2 % of its range. A signal that only reaches a peak, smooth or noisy, has more
    readings in that range. A resolution coarser than 0.5 % of the range piles up by itself and is not judged.

    Parameters
    ----------
    value : (n,) readings, NaN where missing.
    """
    q = quantum(value)
    finite = value[np.isfinite(value)]
    if finite.size < 20 or q <= 0.0 or not np.isfinite(q) or q > 5e-3 * np.ptp(finite):
        return None, None
    upper = _clip_side(value, q)
    lower = _clip_side(-value, q)
    lower = None if lower is None else -lower
    # Amplifiers clip at +- the same level: one reading there is enough on the second side.
    if upper is not None and lower is None and abs(float(finite.min()) + upper) < 0.75 * q:
        lower = float(finite.min())
    if lower is not None and upper is None and abs(float(finite.max()) + lower) < 0.75 * q:
        upper = float(finite.max())
    return upper, lower


def mark_clipped(value: np.ndarray, censored: np.ndarray) -> float | None:
    """Mark the readings (n,) of a channel that clips without having declared it as bounds, 1 above and -1 below.

    Returns
    -------
    float or None
        The level at which it clips, None where it does not.
    """
    upper, lower = clip_levels(value)
    slack = 0.25 * quantum(value)
    if upper is not None:
        censored[value >= upper - slack] = 1
    if lower is not None:
        censored[value <= lower + slack] = -1
    return max((abs(v) for v in (upper, lower) if v is not None), default=None)


def _clip_side(value: np.ndarray, q: float) -> float | None:
    top = float(np.nanmax(value))
    at_top = value >= top - 0.25 * q
    just_below = (value > top - 0.02 * np.ptp(value[np.isfinite(value)])) & ~at_top
    # A resolution of a hundredth of the range meets its top more than once by chance, but not twice in a row.
    lengths = [stop - start for start, stop in runs_of(at_top)]
    in_a_row = max(lengths) >= CLIPPED_ROW or sum(n >= 2 for n in lengths) >= 2 or at_top.sum() >= 8
    return top if at_top.sum() >= 3 and in_a_row and at_top.sum() > just_below.sum() else None
