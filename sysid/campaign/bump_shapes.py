"""Bumps that nobody scanned: by name and size, or by points along the road."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

#: Bumps that are known by name.
ShapeName = Literal["watts", "sinusoidal", "half_sine", "parabolic", "trapezoid", "points"]


@dataclass(frozen=True)
class BumpShape:
    """A bump by name and size: `height_m`, `length_m` over all, `top_m` the flat top of a trapezoid (None: a third).

    A shape named ``points`` has none of these but the heights of its stations along the road; `source` says which file
    they come from, if any.
    """

    name: ShapeName
    height_m: float | None = None
    length_m: float | None = None
    top_m: float | None = None
    station_m: tuple[float, ...] = ()
    heights_m: tuple[float, ...] = ()
    source: str = ""

    @property
    def label(self) -> str:
        """Name and size in words, or where it comes from."""
        if self.source:
            return self.source
        if self.height_m is None or self.length_m is None:
            return f"{self.name}, {len(self.station_m)} stations"
        top = "" if self.top_m is None else f", top {self.top_m:g} m"
        return f"{self.name} {1e3 * self.height_m:g} mm x {self.length_m:g} m{top}"
