"""Even times over a record, only where there are readings: a clock that jumps by years costs no memory."""

from __future__ import annotations

import numpy as np

from sysid import limits
from sysid.arrays import Samples


def even_times(time_s: Samples, step_s: float, reach_s: float) -> Samples:
    """Times t_0 + i step from the first reading to the last, without those further than a reach from any reading.

    Parameters
    ----------
    time_s
        (n,) increasing times of the readings [s].
    step_s
        Step of the grid [s].
    reach_s
        How far from a reading the grid is needed [s].  At least two times beyond it are kept on either side of a gap.

    Returns
    -------
    numpy.ndarray
        (m,) times [s], the first `sysid.limits.GRID_STEPS` of them at most: a decay stands at the beginning.
    """
    reach = reach_s + 3.0 * step_s
    gaps = np.flatnonzero(np.diff(time_s) > 2.0 * reach)
    if gaps.size == 0 and time_s[-1] - time_s[0] <= limits.GRID_STEPS * step_s:
        return np.arange(time_s[0], time_s[-1] + 0.5 * step_s, step_s)
    begins = np.concatenate([[time_s[0]], time_s[gaps + 1] - reach])
    ends = np.concatenate([time_s[gaps] + reach, [time_s[-1] + 0.5 * step_s]])
    pieces, left = [], limits.GRID_STEPS
    for begin, end in zip(begins, ends, strict=True):
        first = np.ceil((begin - time_s[0]) / step_s)
        count = int(min(max(np.ceil((end - time_s[0]) / step_s) - first, 0.0), left))
        pieces.append(time_s[0] + (first + np.arange(count)) * step_s)
        left -= count
    return np.concatenate(pieces)
