"""The two-axle truck with correlated noise and outliers: do the intervals still hold, or does the result say so?"""

from __future__ import annotations

from dataclasses import replace

from studies.coverage import bump
from studies.coverage.shards import Record

CORRELATION, OUTLIERS = 0.6, 0.01
_SEED = 23


def replicate(number: int) -> Record:
    """One campaign with AR(1) noise and a share of outliers."""
    planned = bump.plan()
    sensors = replace(bump.instruments(planned), correlation=CORRELATION, outliers=OUTLIERS)
    return bump.ranks(number, planned, sensors, _SEED)
