"""Bridges as somebody describes them: spans and supports, or influence lines and modes of another program."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from sysid.campaign.roads import RoadCourse

if TYPE_CHECKING:
    import numpy as np

    from sysid.arrays import Stations

SupportName = Literal["pinned", "fixed", "free"]
LineKind = Literal["moment", "shear", "deflection", "other"]


@dataclass(frozen=True, eq=False)
class GivenLine:
    """An influence line from a file: the effect of a unit load at stations (m,) [m].

    `kind` is moment [m], shear [-], deflection [m/N] or other.
    """

    name: str
    kind: LineKind
    station_m: Stations
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class GivenModes:
    """Modes of another program's model: shapes (m, n) at stations (m,), n frequencies and modal masses for them."""

    station_m: Stations
    shape: np.ndarray
    frequency_hz: np.ndarray
    modal_mass_kg: np.ndarray


@dataclass(frozen=True, eq=False)
class Surface:
    """A road with the first support at station `bridge_at_m` [m]; of a class, it is made as long as a pass needs it."""

    course: RoadCourse
    bridge_at_m: float

    @property
    def label(self) -> str:
        """Class and seeds, or where it comes from."""
        course = self.course
        if course.roughness is None:
            return course.source
        last = course.seed + course.realisations - 1
        return f"class {course.roughness}, seed {course.seed}" + (f" to {last}" if last > course.seed else "")


@dataclass(frozen=True, eq=False)
class BridgeDescription:
    """A bridge of spans [m] with bending stiffness EI [N m2] and mass [kg/m] each; or influence lines and modes.

    `damping_ratio` (modes,) or (1,) of its modes, `modes` how many are followed, `sections_m` where load effects are
    wanted (None: in the middle of spans and at supports).  `mass_kg_m` of given lines (1,) relates them to given modes.
    """

    name: str
    span_m: tuple[float, ...] = ()
    supports: tuple[SupportName, ...] = ()
    stiffness_N_m2: tuple[float, ...] = ()
    mass_kg_m: tuple[float, ...] = ()
    damping_ratio: tuple[float, ...] = ()
    modes: int = 10
    sections_m: tuple[float, ...] | None = None
    lines: tuple[GivenLine, ...] = ()
    given_modes: GivenModes | None = None
    surface: Surface | None = None


@dataclass(frozen=True, eq=False)
class BridgeCourse:
    """A pass over a bridge: its surface (None: level), and how many equal vehicles follow each other.

    `gap_m` lies between the last axle of one and the first axle of the next [m].
    """

    bridge: BridgeDescription
    surface: Surface | None = None
    vehicles: int = 1
    gap_m: float = 10.0

    @property
    def label(self) -> str:
        """The bridge's name, its surface and the vehicles in words."""
        words = [f"bridge {self.bridge.name}"]
        if self.surface is not None:
            words.append(self.surface.label)
        if self.vehicles > 1:
            words.append(f"{self.vehicles} vehicles {self.gap_m:g} m apart")
        return ", ".join(words)
