"""Whether a record holds a second drop after the first has decayed, and when that begins."""

from __future__ import annotations

import numpy as np

from sysid.arrays import Samples
from sysid.sdof.release import find_release
from sysid.sdof.smoothing import spike_mask

# Two decaying modes, 0.6 to 4 Hz with 3 % of damping and more, that beat never do both:
_AGAIN_SHARE = 0.5  # of the largest range before
_QUIET_SHARE = 0.4  # of the later range, in a part between
_LEAVES_SHARE = 0.1  # of the later range: a reading that much beyond those of the quiet part belongs to the second drop

_COVERED_SHARE = 0.8  # of a block, by readings


def second_drop(time_s: Samples, value: Samples, block_s: float) -> float:
    """Time [s] of the last reading before a second drop, infinite where the record holds one drop only.

    The ranges of the readings in blocks of time after the release are compared. A free decay does not come back to half
    of its largest range after a block with less than 40 % of what comes.

    Parameters
    ----------
    time_s, value
        (n,) increasing times [s] and readings, NaN where missing.
    block_s
        Length of a block [s], more than half of the longest period.
    """
    good = np.isfinite(value)
    time, y = time_s[good], value[good]
    spikes = spike_mask(time, y)
    time, y = time[~spikes], y[~spikes]
    release = find_release(time, y)
    if release is None:
        return float("inf")
    begin = int(np.searchsorted(time, release.time_s))
    # Numbers of blocks that hold readings: a gap of any length costs nothing.
    _, first = np.unique(np.floor((time[begin:] - time[begin]) / block_s), return_index=True)
    first += begin
    span = np.maximum.reduceat(y, first) - np.minimum.reduceat(y, first)
    # A block with a gap may only look quiet.
    covered = np.diff(first, append=y.size) * float(np.median(np.diff(time)))
    whole = np.where(covered > _COVERED_SHARE * block_s, span, np.inf)
    largest, smallest = np.maximum.accumulate(span), np.minimum.accumulate(whole)
    rises = (span[1:] > _AGAIN_SHARE * largest[:-1]) & (smallest[:-1] < _QUIET_SHARE * span[1:])
    if not rises.any():
        return float("inf")
    block = int(np.argmax(rises)) + 1
    quiet = int(np.flatnonzero(whole[:block] < _QUIET_SHARE * span[block])[-1])
    part = y[first[quiet] : first[quiet + 1]]
    beyond = np.maximum(y - part.max(), part.min() - y)
    leaves = first[quiet + 1] + int(np.argmax(beyond[first[quiet + 1] :] > _LEAVES_SHARE * span[block]))
    return float(time[:leaves][beyond[:leaves] <= 0.0][-1])
