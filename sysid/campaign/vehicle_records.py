"""Frozen records of the vehicle of a campaign: bodies, axles, what joins them, and load cases; SI units, front to rear.

Axes: x rearward from axle 1, z up, pitch positive nose-up (right-handed about the axis to the right of travel).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from sysid.campaign.priors import PriorOverride


@dataclass(frozen=True)
class LeafDimensions:
    """Dimensions of one leaf pack (one side): number of leaves, width, thickness and length between the eyes [m]."""

    leaves: int
    width_m: float
    thickness_m: float
    length_m: float


@dataclass(frozen=True)
class ForceTable:
    """Piecewise linear curve: suspension force [N] against extension from static rest [m] or its rate [m/s]."""

    position: tuple[float, ...]
    force_N: tuple[float, ...]


@dataclass(frozen=True)
class Axle:
    """One axle, both sides and all its tires together.

    `body` is the index of the body it carries.  `load_dependent` says whether the stiffness has one value per load case
    (air springs) or one for all (leaf springs).  `tire_stiffness_N_per_m` is the nominal one at the pressure that the
    tires had in the tests, carried over from `tire_stiffness_pressure_Pa` where both pressures are declared.
    `track_m`, `dual_spacing_m`, `spring_track_m` and `damper_track_m` are distances across the axle, None where not
    declared (:mod:`sysid.campaign.wheel_places` has usual ones).
    `priors` maps a quantity (``stiffness``, ``damping``, ``tire_stiffness``, ``tire_damping``) to the user's own prior.
    """

    name: str
    body: int
    x_m: float
    unsprung_mass_kg: float
    tire_stiffness_N_per_m: float
    tire_damping_N_s_per_m: float
    tire_radius_m: float
    suspension: Literal["leaf", "air", "other"]
    suspension_law: str | None = None
    spring_table: ForceTable | None = None
    damper_table: ForceTable | None = None
    hanger_lash_m: float | None = None
    load_dependent: bool = False
    inflation_pressure_Pa: float | None = None
    tire_stiffness_pressure_Pa: float | None = None
    jounce_travel_m: float | None = None
    rebound_travel_m: float | None = None
    leaf: LeafDimensions | None = None
    track_m: float | None = None
    dual_spacing_m: float | None = None
    spring_track_m: float | None = None
    damper_track_m: float | None = None
    priors: Mapping[str, PriorOverride] = field(default_factory=dict)

    @property
    def has_stops(self) -> bool:
        """Whether a travel is declared, so that bump stops act at its end."""
        return self.jounce_travel_m is not None or self.rebound_travel_m is not None


@dataclass(frozen=True)
class FrameBending:
    """First bending mode of a free frame: `frequency_hz` and `damping_ratio`, its body carried by nothing.

    `x_m` and `rise` are points of its shape, front to rear; none for that of a uniform beam. `frequency_sd` is the
    standard deviation of the frequency's logarithm, 0.1 for a frame with a hammer test or a computation (an
    assumption); a search begins at `start_hz`, None for `frequency_hz`.

    With `own_mass` the frame is rigid, and what moves is a part of the body on springs of its own, such as a cab:
    (mass [kg], position x [m]).
    """

    frequency_hz: float
    damping_ratio: float
    x_m: tuple[float, ...] = ()
    rise: tuple[float, ...] = ()
    frequency_sd: float = 0.1
    start_hz: float | None = None
    own_mass: tuple[float, float] | None = None


@dataclass(frozen=True)
class Body:
    """One sprung body; `hitch_x_m`, `hitch_height_m` above ground: hinge to the body in front, else None.

    `bending` of its frame, None for a rigid one.
    """

    name: str
    hitch_x_m: float | None = None
    hitch_height_m: float | None = None
    bending: FrameBending | None = None


@dataclass(frozen=True)
class AxleGroup:
    """Neighbouring axles of one body on a common rigid beam with mass and pitch inertia of its own.

    `axles` are axle indices, front to rear.  The beam carries the body on one suspension, at the mean position of its
    axles; that suspension belongs to the group's first axle, whose number is in the names of its parameters.
    """

    name: str
    axles: tuple[int, ...]
    mass_kg: float
    pitch_inertia_kg_m2: float


@dataclass(frozen=True)
class Equaliser:
    """A massless rocker between the springs of neighbouring axles of one body.

    `axles` are axle indices, front to rear; each keeps its own spring and damper. With the spring forces S_i, the force
    on the axle and on the frame above it is S_i + s (mean_j S_j - S_i). `load_share` is s, from 0 (no rocker) to 1
    (each spring carries the mean), None if the calibration has to find it.
    """

    name: str
    axles: tuple[int, ...]
    load_share: float | None = None


@dataclass(frozen=True)
class MassTolerances:
    """How far mass properties may be from the declared ones: standard deviations of the logarithm of a factor on them.

    `unsprung_mass` of every axle and beam, `pitch_inertia` and `cg_height` of every body, `hitch_height` of every
    hinge, `axle_load` of every reading of a scale and `axle_load_scale` of the scale, which all readings share; 0 takes
    the declared values as exact. The defaults are those of values that nobody weighed: inertias and heights of loaded
    trucks are guesses, unsprung masses come from lists of parts (an assumption).
    """

    unsprung_mass: float = 0.08
    pitch_inertia: float = 0.25
    cg_height: float = 0.10
    hitch_height: float = 0.03
    axle_load: float = 0.005
    axle_load_scale: float = 0.005


#: Declared mass properties are exact.
EXACT_MASSES = MassTolerances(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


#: Where the force that holds the speed acts: at the first body's centre of gravity, or on the road, by driven wheels.
DrivenAt = Literal["centre", "road"]


@dataclass(frozen=True)
class Vehicle:
    """The vehicle of the campaign: bodies and axles front to rear, and the gravity that turns masses into weights.

    `groups` are axles on common beams, `equalisers` rockers between springs.  `tolerances` say how far its mass
    properties, and those of the load cases, may be from the declared ones.  `driven_at` is None where it is not
    declared, which stands for the centre; `hold_s` is the time constant [s] of a drive in place of those of the runs,
    None for these, and `hold_factor` a factor on it.
    """

    name: str
    bodies: tuple[Body, ...]
    axles: tuple[Axle, ...]
    gravity_m_s2: float = 9.81
    wheelbase_m: float | None = None
    groups: tuple[AxleGroup, ...] = ()
    tolerances: MassTolerances = MassTolerances()
    equalisers: tuple[Equaliser, ...] = ()
    driven_at: DrivenAt | None = None
    hold_s: float | None = None
    hold_factor: float = 1.0

    @property
    def suspension_axle(self) -> tuple[int, ...]:
        """Per axle the index of the axle that stands for its suspension: itself, or the first of its group."""
        first = {i: group.axles[0] for group in self.groups for i in group.axles}
        return tuple(first.get(i, i) for i in range(len(self.axles)))

    @property
    def suspension_x_m(self) -> tuple[float, ...]:
        """Per axle where its suspension acts on the body: above the axle, or above the middle of its group."""
        middle = {i: sum(self.axles[k].x_m for k in g.axles) / len(g.axles) for g in self.groups for i in g.axles}
        return tuple(middle.get(i, axle.x_m) for i, axle in enumerate(self.axles))

    @property
    def unsprung_mass_kg(self) -> tuple[float, ...]:
        """Per axle, its mass without the body: its own unsprung mass and an equal share of its beam."""
        beam = {i: group.mass_kg / len(group.axles) for group in self.groups for i in group.axles}
        return tuple(axle.unsprung_mass_kg + beam.get(i, 0.0) for i, axle in enumerate(self.axles))


@dataclass(frozen=True)
class FrameMass:
    """How the mass along a bending frame differs from the one that is taken from its centre of gravity and inertia.

    - `heave` and `pitch` are added to the heave and pitch that are removed from the shape, pitch per half of the
      frame's length;
    - `log_modal_mass` is the logarithm of the modal mass over that of the mass assumed;
    - `at_ends` says whether the mass assumed has parts at the frame's ends; None where centre of gravity and inertia
      decide that.
    """

    heave: float = 0.0
    pitch: float = 0.0
    log_modal_mass: float = 0.0
    at_ends: bool | None = None


@dataclass(frozen=True)
class LoadCase:
    """Scale readings and mass properties of one load case.

    `axle_loads_kg` (axles,) include the unsprung mass; `sprung_mass_kg`, `pitch_inertia_kg_m2` (about the body's own
    centre of gravity) and `cg_height_m` (above ground) are (bodies,); so are `frame_masses`, empty if the mass is
    distributed as assumed.
    """

    name: str
    axle_loads_kg: tuple[float, ...]
    sprung_mass_kg: tuple[float, ...]
    pitch_inertia_kg_m2: tuple[float, ...]
    cg_height_m: tuple[float, ...]
    cargo_mass_kg: float | None = None
    frame_masses: tuple[FrameMass, ...] = ()
