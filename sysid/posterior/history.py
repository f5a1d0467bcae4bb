"""The draws of a run in memory: one growing block, so that a long chain costs its draws and little more."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from sysid.posterior.segments import Segment


class History:
    """All segments of a run, one behind the other."""

    def __init__(self, segments: Iterable[Segment] = ()):
        self._draws = np.empty((0, 0, 0, 0))
        self._logs = np.empty((0, 0, 0))
        self.steps = 0
        self.accepted = np.zeros(())
        self.rejected = np.zeros((), int)
        for segment in segments:
            self.append(segment)

    def append(self, segment: Segment) -> None:
        """Add a segment behind the others."""
        end = self.steps + segment.draws.shape[1]
        self._draws = _with_room(self._draws, segment.draws, end)
        self._logs = _with_room(self._logs, segment.log_probability, end)
        self._draws[:, self.steps : end] = segment.draws
        self._logs[:, self.steps : end] = segment.log_probability
        self.accepted = self.accepted + segment.accepted
        self.rejected = self.rejected + segment.rejected
        self.steps = end

    @property
    def draws(self) -> np.ndarray:
        """Draws (E, steps, W, p) of log parameters."""
        return self._draws[:, : self.steps]

    @property
    def log_probability(self) -> np.ndarray:
        """Log-densities (E, steps, W)."""
        return self._logs[:, : self.steps]

    @property
    def nbytes(self) -> int:
        """Memory [bytes] set aside for the draws."""
        return self._draws.nbytes + self._logs.nbytes


def _with_room(block: np.ndarray, like: np.ndarray, steps: int) -> np.ndarray:
    """The block itself if it holds that many steps, else a copy half as long again."""
    if block.size and block.shape[1] >= steps:
        return block
    grown = np.empty((like.shape[0], max(steps, block.shape[1] * 3 // 2), *like.shape[2:]))
    if block.size:
        grown[:, : block.shape[1]] = block
    return grown
