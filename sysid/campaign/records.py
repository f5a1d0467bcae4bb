"""Frozen records of one measurement campaign: everything in SI units, axles front to rear, index 0 = axle 1.

Axes: x rearward from axle 1, z up, pitch positive nose-up (right-handed about the axis to the right of travel).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from sysid.campaign.clocks.settings import ClockFinding
from sysid.campaign.priors import NamedPrior, PriorOverride

#: What holds the speed: a driver or servo at once, a tow at constant speed, a cruise control slowly, or nothing.
SpeedHeld = Literal["servo", "towed", "cruise", "free"]
#: Bumps that are known by name.
ShapeName = Literal["watts", "sinusoidal", "half_sine", "parabolic", "trapezoid", "points"]
SensorKind = Literal["suspension_deflection", "axle_acceleration", "body_acceleration"]


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
    tires had in the tests.  `priors` maps a quantity (``stiffness``, ``damping``,
    ``tire_stiffness``, ``tire_damping``) to the user's own prior.
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
    jounce_travel_m: float | None = None
    rebound_travel_m: float | None = None
    leaf: LeafDimensions | None = None
    priors: Mapping[str, PriorOverride] = field(default_factory=dict)

    @property
    def has_stops(self) -> bool:
        """Whether a travel is declared, so that bump stops act at its end."""
        return self.jounce_travel_m is not None or self.rebound_travel_m is not None


@dataclass(frozen=True)
class FrameBending:
    """First bending mode of a free frame: `frequency_hz` and `damping_ratio`, its body carried by nothing.

    `x_m` and `rise` are points of its shape, front to rear; none for that of a uniform beam.
    """

    frequency_hz: float
    damping_ratio: float
    x_m: tuple[float, ...] = ()
    rise: tuple[float, ...] = ()


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

    `axles` are axle indices, front to rear; each keeps its own spring and damper.  With the spring forces S_i the axle
    and the frame above it feel S_i + s (mean_j S_j - S_i).  `load_share` is s, from 0 (no rocker) to 1 (each spring
    carries the mean), None where the calibration has to find it.
    """

    name: str
    axles: tuple[int, ...]
    load_share: float | None = None


@dataclass(frozen=True)
class MassTolerances:
    """How far mass properties may be from the declared ones: standard deviations of the logarithm of a factor on them.

    `unsprung_mass` of every axle and beam, `pitch_inertia` and `cg_height` of every body, `hitch_height` of every
    hinge, `axle_load` of every reading of a scale and `axle_load_scale` of the scale, which all readings share; 0 takes
    the declared values as exact.
    """

    unsprung_mass: float = 0.03
    pitch_inertia: float = 0.05
    cg_height: float = 0.03
    hitch_height: float = 0.03
    axle_load: float = 0.005
    axle_load_scale: float = 0.005


#: Declared mass properties are exact.
EXACT_MASSES = MassTolerances(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Vehicle:
    """The vehicle of the campaign: bodies and axles front to rear, and the gravity that turns masses into weights.

    `groups` are axles on common beams, `equalisers` rockers between springs.  `tolerances` say how far its mass
    properties, and those of the load cases, may be from the declared ones.
    """

    name: str
    bodies: tuple[Body, ...]
    axles: tuple[Axle, ...]
    gravity_m_s2: float = 9.81
    wheelbase_m: float | None = None
    groups: tuple[AxleGroup, ...] = ()
    tolerances: MassTolerances = MassTolerances()
    equalisers: tuple[Equaliser, ...] = ()

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
        """Per axle what it carries besides the body: its own unsprung mass and an equal share of its beam."""
        beam = {i: group.mass_kg / len(group.axles) for group in self.groups for i in group.axles}
        return tuple(axle.unsprung_mass_kg + beam.get(i, 0.0) for i, axle in enumerate(self.axles))


@dataclass(frozen=True)
class LoadCase:
    """Scale readings and mass properties of one load case.

    `axle_loads_kg` (axles,) include the unsprung mass; `sprung_mass_kg`, `pitch_inertia_kg_m2` (about the body's own
    centre of gravity) and `cg_height_m` (above ground) are (bodies,).
    """

    name: str
    axle_loads_kg: tuple[float, ...]
    sprung_mass_kg: tuple[float, ...]
    pitch_inertia_kg_m2: tuple[float, ...]
    cg_height_m: tuple[float, ...]
    cargo_mass_kg: float | None = None


@dataclass(frozen=True)
class AntiAliasFilter:
    """Causal analogue low-pass in front of every channel: `kind`, `order`, cut-off frequency [Hz]."""

    kind: Literal["butterworth", "bessel"]
    order: int
    cutoff_hz: float


@dataclass(frozen=True)
class Acquisition:
    """Data acquisition: declared sample interval [s] and anti-alias filter, None where there is none."""

    sample_interval_s: float
    filter: AntiAliasFilter | None


@dataclass(frozen=True)
class Sensor:
    """One sensor: log column, what it measures and where.

    `axle` (index) for deflections and axle accelerations, `body` (index) and `x_m` for body accelerations.
    `full_scale` is the range (+-) in SI units, None if undeclared; `unit` is the unit in the file, after readings are
    multiplied by `scale` and `sign`.  For plank drops `axle`, `body` and `x_m` are filled in with the axle under test.
    `logger`: name of its logger, empty for the first one; `source`: column in its files, empty for `column`.
    """

    column: str
    kind: SensorKind
    unit: str
    axle: int | None = None
    body: int | None = None
    x_m: float | None = None
    full_scale: float | None = None
    side: Literal["left", "right"] | None = None
    sign: int = 1
    scale: float = 1.0
    logger: str = ""
    source: str = ""

    @property
    def si_unit(self) -> str:
        """Unit of the values in memory: ``m`` or ``m/s^2``."""
        return "m" if self.kind == "suspension_deflection" else "m/s^2"


@dataclass(frozen=True)
class Channel:
    """Readings of one sensor in one log.

    `time_s` (n,) starts near zero (the first stamp of the log is subtracted); `value` (n,) in SI, NaN where missing;
    `censored` (n,) int8: 0 measured, +1 the true value is at or above the reading (upper clip), -1 at or below.
    """

    sensor: Sensor
    time_s: np.ndarray
    value: np.ndarray
    censored: np.ndarray


@dataclass(frozen=True)
class Log:
    """One log file: its name relative to the campaign folder, its nominal sample interval [s] and its channels.

    `messages` are sentences about what was missing or repaired while reading.  `more_files` are logs of other loggers
    whose channels are here, or could not be used; `sync` holds stamps and readings of a signal that loggers share.
    """

    file: str
    sample_interval_s: float
    channels: tuple[Channel, ...]
    start_time_s: float = 0.0
    messages: tuple[str, ...] = ()
    more_files: tuple[str, ...] = ()
    sync: tuple[np.ndarray, np.ndarray] | None = None

    @property
    def duration_s(self) -> float:
        """Time from the first to the last stamp of any channel [s]."""
        return max(float(c.time_s[-1]) for c in self.channels)


@dataclass(frozen=True)
class PlankDrop:
    """One drop: the axle under test rolls off a plank of the given height, or the body above it is let go.

    `lifted` are the axles above which a body was lifted that is let go (`release` ``body``, `plank_height_m` None);
    there is one such record per axle that is measured.
    """

    axle: int
    load_case: str
    plank_height_m: float | None
    log: Log
    nominal_speed_m_s: float | None = None
    dampers: bool = True
    towed: bool | None = None
    engine_off: bool | None = None
    release: Literal["plank", "body"] = "plank"
    lifted: tuple[int, ...] = ()


@dataclass(frozen=True)
class BumpRun:
    """One pass over a bump at a nominal speed [m/s]; `bump` names the scan it belongs to.

    `speed_sd` is the relative standard deviation of the true speed at axle 1 about the nominal one, `speed_change_sd`
    that of its relative change until the last axle passes (0: none); `speed_held` says what keeps the speed over the
    bump.
    """

    case: str
    load_case: str
    nominal_speed_m_s: float
    repeat: int
    log: Log
    bump: str = "bump"
    speed_sd: float = 0.03
    speed_change_sd: float = 0.02
    speed_held: SpeedHeld = "servo"


@dataclass(frozen=True)
class Scan:
    """Laser point cloud of one bump: `points_m` (n, 3), direction of travel counter-clockwise from +x [rad]."""

    name: str
    file: str
    heading_rad: float
    points_m: np.ndarray


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


@dataclass(frozen=True)
class PredictionRequest:
    """A pass nobody drove: load case, speed [m/s] and bump, a scanned one by name or any other by its `shape`."""

    load_case: str
    speed_m_s: float
    bump: str = "bump"
    shape: BumpShape | None = None


@dataclass(frozen=True)
class Campaign:
    """Everything the test engineer brings home, read and converted once.

    `load_cases` keeps the order of the file (the first is the reference of drops and tire stiffness);
    `input_sha256` maps every input file, relative to `folder`, to its hash; `messages` are sentences about the campaign
    as a whole; `priors` are the user's own by the name of the parameter; `clocks` those of further loggers by run.
    """

    title: str
    notes: str
    folder: Path
    file: Path
    vehicle: Vehicle
    load_cases: Mapping[str, LoadCase]
    acquisition: Acquisition
    plank_drops: tuple[PlankDrop, ...]
    bump_runs: tuple[BumpRun, ...]
    scans: Mapping[str, Scan]
    predictions: tuple[PredictionRequest, ...]
    input_sha256: Mapping[str, str]
    messages: tuple[str, ...] = ()
    priors: Mapping[str, NamedPrior] = field(default_factory=dict)
    clocks: tuple[ClockFinding, ...] = ()

    @property
    def load_cases_in_use(self) -> tuple[str, ...]:
        """Names of the load cases in which a bump run was driven or is to be predicted, in the order of the file."""
        wanted = {run.load_case for run in self.bump_runs} | {request.load_case for request in self.predictions}
        return tuple(name for name in self.load_cases if name in wanted)
