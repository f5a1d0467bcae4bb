"""Rough roads to be driven: of a class, or measured."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, get_args

from sysid.campaign.bump_shapes import BumpShape
from sysid.errors import CampaignError

if TYPE_CHECKING:
    import numpy as np

#: Classes of roads by ISO 8608.
RoadClass = Literal["A", "B", "C", "D", "E", "F", "G", "H"]
ROAD_CLASSES: tuple[RoadClass, ...] = get_args(RoadClass)


# Compared by identity: a measured road has many heights.
@dataclass(frozen=True, eq=False)
class RoadCourse:
    """A rough road to be driven: one of a class by ISO 8608, measured heights, or several roads one behind the other.

    - `length_m` of the road;
    - `roughness`: its class, with the `seed` of the first of several `realisations`; None for a measured road;
    - `height_m` (tracks, n): heights of a measured road [m] under the left and the right wheels, or of one track that
      both follow, `step_m` apart; `source` says where they come from;
    - `parts`: roads that follow each other, if any, as an approach and a deck;
    - `obstacle`: a bump that begins `obstacle_at_m` from the start of the road, or a hole of its shape if `sunken`;
    - `stress_exponent` of the damage that axle loads do to it: 4 by the AASHO road test.
    """

    length_m: float
    roughness: RoadClass | None = None
    seed: int = 0
    realisations: int = 1
    step_m: float = 0.0
    height_m: np.ndarray | None = None
    source: str = ""
    stress_exponent: float = 4.0
    parts: tuple[RoadCourse, ...] = ()
    obstacle: BumpShape | None = None
    obstacle_at_m: float = 0.0
    sunken: bool = False

    @property
    def label(self) -> str:
        """Class, length and seed in words, or where it comes from."""
        if self.obstacle is None:
            return self._road
        what = f"hole of {self.obstacle.label}" if self.sunken else self.obstacle.label
        return f"{self._road}, with {what} at {self.obstacle_at_m:g} m"

    @property
    def _road(self) -> str:
        if self.parts:
            return " + ".join(part.label for part in self.parts)
        if self.roughness is None:
            return self.source
        several = f"s {self.seed} to {self.seed + self.realisations - 1}" if self.realisations > 1 else f" {self.seed}"
        return f"road class {self.roughness}, {self.length_m:g} m, seed{several}"


def with_obstacle(road: RoadCourse, shape: BumpShape, at_m: float, sunken: bool, where: str) -> RoadCourse:
    """The road with a bump that begins at a station, or a hole of its shape.

    Raises
    ------
    CampaignError
        If it does not lie on the road; `where` begins the sentence.
    """
    length = shape.length_m if shape.length_m is not None else shape.station_m[-1] - shape.station_m[0]
    if road.length_m > 0.0 and at_m + length > road.length_m:
        raise CampaignError(
            f"{where}: {shape.label} from {at_m:g} m on does not lie on a road of {road.length_m:g} m; move it."
        )
    return replace(road, obstacle=shape, obstacle_at_m=at_m, sunken=sunken)
