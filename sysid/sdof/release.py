"""When the axle leaves the plank, and where the motion first turns round."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.arrays import Samples
from sysid.sdof.smoothing import high_frequency_noise, robust_sd

_MOVE_SHARE = 0.15  # a move of this share of the range is motion, not drift or noise
_REST_SHARE = 0.01  # of the range: readings this close to the level are at rest
_SHORTEST_REST_S, _FEWEST_READINGS = 0.03, 4  # before the first move, for a level at rest
_NOISE_REST_S = 0.1  # before the release, for the scatter at rest to count as noise
_ROUNDING_S = 1e-6  # of stamps


@dataclass(frozen=True)
class Release:
    """Start of the motion in a record.

    - `time_s`: last reading at rest (the first of the record if it never rests);
    - `rest_level` and `rest_sd` before it, NaN without a rest;
    - `first_turn_s`: first turning point after the release;
    - `noise_sd` of the readings at rest or, without rest, from fourth differences.
    """

    time_s: float
    rest_level: float
    rest_sd: float
    first_turn_s: float
    noise_sd: float


def find_release(time_s: Samples, value: Samples) -> Release | None:
    """Find the last reading at rest and the first turning point after it.

    The release is searched for backwards, from the first move of 15 % of the range to the level held before it. So the
    result does not depend on the length of the plateau, an offset, a slow drift, the sign or the time origin.

    Parameters
    ----------
    time_s, value
        (n,) increasing times [s] and finite readings without spikes.

    Returns
    -------
    Release or None
        None where nothing moves by more than eight times the noise.
    """
    noise = high_frequency_noise(value)
    span = float(np.ptp(value)) if value.size else 0.0
    if value.size < 3 or span <= max(8.0 * noise, 1e-12 * float(np.abs(value).max())):
        return None
    spread = np.maximum.accumulate(value) - np.minimum.accumulate(value)
    moved = int(np.argmax(spread > max(_MOVE_SHARE * span, 8.0 * noise)))
    rest_level, rest_sd, index = np.nan, np.nan, 0
    before_s = time_s - time_s[0] + _ROUNDING_S
    if moved >= _FEWEST_READINGS and before_s[moved] >= _SHORTEST_REST_S:
        late = value[moved // 2 : moved]
        # The very end of the quiet part may already move, the first half may drift: take what lies between.
        late = late[: max(3, int(0.8 * late.size))]
        level, sd = float(np.median(late)), robust_sd(late)
        away = np.abs(value[:moved] - level) > max(3.0 * sd, _REST_SHARE * span)
        quiet = np.flatnonzero(~away)
        if quiet.size and sd < 0.1 * span:
            index = int(quiet[-1])
            rest_level, rest_sd = level, sd
            noise = max(noise, sd) if before_s[index] >= _NOISE_REST_S else noise
    turn = _first_turn(value[index:], max(8.0 * noise, 0.08 * span))
    return Release(
        time_s=float(time_s[index]),
        rest_level=rest_level,
        rest_sd=rest_sd,
        first_turn_s=float(time_s[index + turn]),
        noise_sd=noise,
    )


def _first_turn(value: np.ndarray, threshold: float) -> int:
    """Index of the first extremum from which the signal comes back by more than the threshold (0 if it never does)."""
    high = np.maximum.accumulate(value)
    low = np.minimum.accumulate(value)
    # Which way it leaves first decides which running extreme the turn is measured from.
    up, down = high - value[0] > threshold, value[0] - low > threshold
    if not (up.any() or down.any()):
        return 0
    rising = bool(up.any()) and (not down.any() or int(np.argmax(up)) < int(np.argmax(down)))
    back = (high - value > threshold) & up if rising else (value - low > threshold) & down
    if not back.any():
        return 0
    stop = int(np.argmax(back)) + 1
    return int(np.argmax(value[:stop]) if rising else np.argmin(value[:stop]))
