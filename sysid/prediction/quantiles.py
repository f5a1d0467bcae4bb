"""Quantiles over posterior draws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Quantiles:
    """5 %, 50 % and 95 % quantiles over draws; before sampling `q50` is the least-squares value, the others None."""

    q05: np.ndarray | None
    q50: np.ndarray
    q95: np.ndarray | None

    def at(self, index: int) -> Quantiles:
        """All quantiles of one entry of the first axis."""
        low, high = (None if q is None else q[index] for q in (self.q05, self.q95))
        return Quantiles(low, self.q50[index], high)

    def times(self, factor: np.ndarray | float) -> Quantiles:
        """All quantiles times a positive factor, one number or one per axle."""
        low, high = (None if q is None else q * factor for q in (self.q05, self.q95))
        return Quantiles(low, self.q50 * factor, high)
