"""Rough roads to be driven: of a class, or measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

if TYPE_CHECKING:
    import numpy as np

#: Classes of roads by ISO 8608.
RoadClass = Literal["A", "B", "C", "D", "E", "F", "G", "H"]
ROAD_CLASSES: tuple[RoadClass, ...] = get_args(RoadClass)


# Compared by identity: a measured road has many heights.
@dataclass(frozen=True, eq=False)
class RoadCourse:
    """A rough road to be driven: one of a class by ISO 8608, or measured heights.

    - `length_m` of the road;
    - `roughness`: its class, with the `seed` of the first of several `realisations`; None for a measured road;
    - `height_m` (n,): heights of a measured road [m], `step_m` apart; `source` says where they come from.
    """

    length_m: float
    roughness: RoadClass | None = None
    seed: int = 0
    realisations: int = 1
    step_m: float = 0.0
    height_m: np.ndarray | None = None
    source: str = ""

    @property
    def label(self) -> str:
        """Class, length and seed in words, or where it comes from."""
        if self.roughness is None:
            return self.source
        several = f"s {self.seed} to {self.seed + self.realisations - 1}" if self.realisations > 1 else f" {self.seed}"
        return f"road class {self.roughness}, {self.length_m:g} m, seed{several}"
