"""Frozen records of one measurement campaign: everything in SI units, axles front to rear, index 0 = axle 1.

Axes: x rearward from axle 1, z up, pitch positive nose-up (right-handed about the axis to the right of travel).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from sysid.campaign.bridges import BridgeCourse, BridgeDescription
from sysid.campaign.bump_shapes import BumpShape as BumpShape
from sysid.campaign.loggers import ClockFinding
from sysid.campaign.priors import NamedPrior
from sysid.campaign.roads import RoadCourse
from sysid.campaign.sensor_kinds import AUXILIARY_KINDS as AUXILIARY_KINDS
from sysid.campaign.sensor_kinds import KIND_DIMENSION as KIND_DIMENSION
from sysid.campaign.sensor_kinds import SI_UNITS
from sysid.campaign.sensor_kinds import SensorKind as SensorKind
from sysid.campaign.units import Dimension, si_factor
from sysid.campaign.vehicle_records import LoadCase, Vehicle

if TYPE_CHECKING:
    import numpy as np

#: What holds the speed: a driver or servo at once, a tow at constant speed, a cruise control slowly, or nothing.
SpeedHeld = Literal["servo", "towed", "cruise", "free"]
#: Time constants [s] with which it holds the speed.
HOLD_S: dict[SpeedHeld, float] = {"servo": 0.05, "towed": 0.05, "cruise": 1.0, "free": float("inf")}


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

    `axle` (index) for deflections, axle accelerations and air pressures, `body` (index) and `x_m` for body
    accelerations, `body` for pitch rates, neither for speeds.
    `full_scale` is the range (+-) in SI units, None if undeclared; `unit` is the unit in the file, after readings are
    multiplied by `scale` and `sign`.  For plank drops `axle`, `body` and `x_m` are filled in with the axle under test.
    `logger`: name of its logger, empty for the first one; `source`: column in its files, empty for `column`.
    `side`, and `y_m` from the middle of the truck, positive to the left; None where not declared.
    `area_m2`: effective area of the bellows of an axle whose pressure is measured [m2], None if undeclared.
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
    area_m2: float | None = None
    y_m: float | None = None

    @property
    def dimension(self) -> Dimension:
        """What is measured, such as ``length``."""
        return KIND_DIMENSION[self.kind]

    @property
    def si_unit(self) -> str:
        """Unit of the values in memory, such as ``m``."""
        return SI_UNITS[self.dimension]

    @property
    def unit_in_si(self) -> float:
        """One `unit` of the file, in SI."""
        return si_factor(self.unit, self.dimension)


@dataclass(frozen=True)
class Channel:
    """Readings of one sensor in one log.

    - `time_s` (n,) starts near zero (the first stamp of the log is subtracted);
    - `value` (n,) in SI, NaN where missing;
    - `censored` (n,) int8: 0 for a measured value, +1 if the true value is at or above the reading (upper clip), -1 if
      it is at or below.
    """

    sensor: Sensor
    time_s: np.ndarray
    value: np.ndarray
    censored: np.ndarray


@dataclass(frozen=True)
class Log:
    """One log file: its name relative to the campaign folder, its nominal sample interval [s] and its channels.

    `channels` show the vibration of the truck; `auxiliary` are speeds, air pressures and slow pitch rates, on clocks of
    any rate.
    `messages` are sentences about what was missing or repaired while reading.  `more_files` are logs of other loggers
    whose channels are here, or could not be used; `sync` holds stamps and readings of a signal that loggers share.
    `span_s` is the duration that counts where stamps were moved after reading: so the grid of a run stays.
    """

    file: str
    sample_interval_s: float
    channels: tuple[Channel, ...]
    start_time_s: float = 0.0
    messages: tuple[str, ...] = ()
    more_files: tuple[str, ...] = ()
    sync: tuple[np.ndarray, np.ndarray] | None = None
    span_s: float | None = None
    auxiliary: tuple[Channel, ...] = ()

    @property
    def duration_s(self) -> float:
        """Time from the first to the last stamp of any channel that shows vibration [s]."""
        if self.span_s is not None:
            return self.span_s
        return max((float(c.time_s[-1]) for c in self.channels), default=0.0)


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

    - `speed_sd` is the relative standard deviation of the true speed at axle 1 about the expected one,
      `speed_change_sd` that of its relative change until the last axle passes (0: none);
    - `logged_speed_m_s` is that of a speed sensor [m/s], corrected for its factor; `speed_listed` False where the
      nominal speed is a rounded reading of it;
    - `speed_held` says how the speed is held over the bump.
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
    speed_listed: bool = True
    logged_speed_m_s: float | None = None

    @property
    def expected_speed_m_s(self) -> float:
        """Median of the prior of the speed [m/s]: as logged, or else as listed."""
        return self.nominal_speed_m_s if self.logged_speed_m_s is None else self.logged_speed_m_s


@dataclass(frozen=True)
class RoadDrive:
    """One drive over an ordinary road of unknown profile at about `speed_m_s` [m/s], held as `speed_held` says."""

    load_case: str
    speed_m_s: float
    log: Log
    speed_held: SpeedHeld = "servo"


@dataclass(frozen=True)
class Scan:
    """Laser point cloud of one bump, or heights along the road that were measured by other means.

    - `points_m` (n, 3), direction of travel counter-clockwise from +x [rad], known within `heading_within_rad`;
    - `tires_m`: distances of the tires of one side from the middle of the truck, which passes `lateral_m` to the left
      of the middle of the scan; none where the vehicle is not known.

    With heights along the road, `levelled`, there are no points.
    """

    name: str
    file: str
    heading_rad: float
    points_m: np.ndarray
    levelled: BumpShape | None = None
    heading_within_rad: float = math.radians(0.5)
    lateral_m: float = 0.0
    tires_m: tuple[float, ...] = ()


@dataclass(frozen=True)
class PredictionRequest:
    """A pass nobody drove: load case, speed [m/s] and what it goes over.

    This is a scanned bump by its name, any other bump by its `shape`, a rough `road` or a `bridge`; of these `bump` is
    the label.
    """

    load_case: str
    speed_m_s: float
    bump: str = "bump"
    shape: BumpShape | None = None
    road: RoadCourse | None = None
    bridge: BridgeCourse | None = None

    @property
    def over_bump(self) -> bool:
        """Whether it goes over a bump, not over a rough road or a bridge."""
        return self.road is None and self.bridge is None


@dataclass(frozen=True)
class CampaignDetails:
    """What the campaign file says of the test: date (ISO 8601) and place, who drove, which vehicle; None: nothing.

    `synthetic` data were computed, not measured; `scale` names the one that weighed the axles.
    """

    date: str | None = None
    place: str | None = None
    operator: str | None = None
    vehicle_id: str | None = None
    synthetic: bool = False
    scale: str | None = None


@dataclass(frozen=True)
class Campaign:
    """Everything the test engineer brings home, read and converted once.

    - `load_cases` keeps the order of the file (the first is the reference of drops and tire stiffness);
    - `input_sha256` maps every input file, relative to `folder`, to its hash;
    - `messages` are sentences about the campaign as a whole;
    - `priors` are the user's own by the name of the parameter;
    - `clocks` are those of further loggers, by run;
    - `bridges` are those that passes may cross, by name.
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
    details: CampaignDetails = CampaignDetails()
    road_drives: tuple[RoadDrive, ...] = ()
    bridges: Mapping[str, BridgeDescription] = field(default_factory=dict)

    @property
    def load_cases_in_use(self) -> tuple[str, ...]:
        """Names of the load cases that were driven or are to be predicted, in the order of the file."""
        driven = {run.load_case for run in self.bump_runs} | {drive.load_case for drive in self.road_drives}
        wanted = driven | {request.load_case for request in self.predictions}
        return tuple(name for name in self.load_cases if name in wanted)
