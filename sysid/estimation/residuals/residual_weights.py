"""The weight of every reading."""

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

    def part(self, position: int) -> Weights:
        """The weights of one group alone."""
        one = slice(position, position + 1)
        return Weights(self.noise_sd[one], self.tempering[one], None if self.reading is None else self.reading[one])

    def on(self, arrays: Sequence[GroupArrays], position: int) -> GroupArrays:
        """The arrays of a group, one of all, with the weights of single readings in them."""
        of_group = arrays[position]
        if self.reading is None:
            return of_group
        return of_group._replace(measured=of_group.measured * np.sqrt(self.reading[position]))
