"""How much every reading counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.arrays import RunsByChannels, SamplesByRunsByChannels
from sysid.estimation.residuals.bump_model import GroupArrays


@dataclass(frozen=True)
class Weights:
    """Residual scale [SI] and tempering factor per group, each (R, C); `reading` weights (T, R, C), None for all 1."""

    noise_sd: tuple[RunsByChannels, ...]
    tempering: tuple[RunsByChannels, ...]
    reading: tuple[SamplesByRunsByChannels, ...] | None = None

    def on(self, arrays: Sequence[GroupArrays]) -> tuple[GroupArrays, ...]:
        """The arrays of all groups with the weights of single readings in them."""
        if self.reading is None:
            return tuple(arrays)
        pairs = zip(arrays, self.reading, strict=True)
        return tuple(a._replace(measured=a.measured * np.sqrt(w)) for a, w in pairs)
