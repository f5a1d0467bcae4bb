"""Error codes of loggers among readings: -9999, 32767, 9.9E37 and the like, far from everything that was measured."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from sysid.logs.channels import RawChannel
from sysid.wording import shorten

#: Numbers of nines, such as 9999, 999.25 or 99.99; 9.9E37 and 9.91E37 of instruments (IEEE 488.2); ends of the numbers
#: of 16 and 32 bits.
_NINES = re.compile(r"9{3,}(?:\.\d{1,2})?|99\.9+|9\.9\d*e\+\d+")
_ENDS = frozenset(float(2**bits - less) for bits in (15, 16, 31, 32) for less in (0, 1))
#: A code is further from all other readings than they are from each other, by this factor.
_FAR = 3.0
#: Other readings without which nothing is far.
_LEAST_READINGS = 16


def without_codes(channel: RawChannel, label: str) -> tuple[RawChannel, str | None]:
    """The channel with error codes as missing readings, and a sentence about them; unchanged where there are none.

    A code is a number that loggers write for a reading that they do not have, at an end of all readings and by
    :data:`_FAR` of their range away from the others.  A saturated sensor stands nearer, and seldom on such a number.
    """
    values: np.ndarray = channel.values
    found: dict[float, int] = {}
    while codes := _codes(values):
        found |= {code: int(np.count_nonzero(values == code)) for code in codes}
        values = np.where(np.isin(values, codes), np.nan, values)
    if not found:
        return channel, None
    shown = " and ".join(
        f"{count} of its readings {'are' if count > 1 else 'is'} {c:.10g}" for c, count in found.items()
    )
    return replace(channel, values=values), (
        f"{label}: '{shorten(channel.name)}': {shown}, an error code, far from all others; they are missing."
    )


def _codes(values: np.ndarray) -> list[float]:
    """Those of the largest and the smallest reading that are codes."""
    seen = values[np.isfinite(values)]
    if seen.size < _LEAST_READINGS:
        return []
    ends = [end for end in {float(seen.max()), float(seen.min())} if _looks_like_one(abs(end))]
    others = seen[~np.isin(seen, ends)] if ends else seen[:0]
    if others.size < _LEAST_READINGS:
        return []
    low, high = float(others.min()), float(others.max())
    return sorted(e for e in ends if high > low and max(low - e, e - high) > _FAR * (high - low))


def _looks_like_one(size: float) -> bool:
    return size in _ENDS or _NINES.fullmatch(f"{size:.10g}") is not None
