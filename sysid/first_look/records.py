"""What a first look at a folder found: files, sensors, drops and runs, each guess with its reasons."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from sysid.campaign.records import SensorKind
from sysid.first_look.features import Look
from sysid.first_look.file_words import PathSays, TestKind
from sysid.first_look.load_cases import LoadCaseGuess
from sysid.first_look.templates import Template
from sysid.first_look.words import Side


@dataclass(frozen=True)
class SeenLog:
    """One log: its columns with their behaviour, how it is written, and what its path says.

    `time` as in :class:`sysid.first_look.log_columns.LogColumns`; `text` are columns without numbers;
    `start_s` is the first stamp.
    """

    file: str
    title: str
    looks: tuple[Look, ...]
    time: str | None
    text: tuple[str, ...]
    said: PathSays
    start_s: float = 0.0

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of its columns."""
        return tuple(look.name for look in self.looks)

    @property
    def rate_hz(self) -> float:
        """Rate of its slowest column [Hz]."""
        return min((look.rate_hz for look in self.looks if look.rate_hz > 0.0), default=0.0)

    @property
    def duration_s(self) -> float:
        """Length of its longest column [s]."""
        return max((look.duration_s for look in self.looks), default=0.0)


@dataclass(frozen=True)
class SeenScan:
    """One point cloud: number of points, size along x and y in the unit of the file, the unit that its size suggests,
    and the directions across the bump [deg] counter-clockwise from +x, None where no crest is seen. With `levelled` the
    file holds heights along the road instead, `extent` is then length and height."""

    file: str
    title: str
    points: int
    extent: tuple[float, float]
    unit: str
    heading_deg: float | None
    levelled: bool = False


@dataclass(frozen=True)
class SensorGuess:
    """One column: kind and unit (None: not known), sign, axle (index, None: not known), side.

    `sure` where name and behaviour support all of it; `why` are the reasons.  `unused` says why it is no sensor of a
    campaign.
    """

    column: str
    kind: SensorKind | None
    unit: str | None
    sign: int
    axle: int | None
    side: Side | None
    sure: bool
    why: tuple[str, ...]
    unused: str | None = None


@dataclass(frozen=True)
class EntryGuess:
    """One drop or run; None where something is not known: `axle` of a drop, `speed_km_h` of a run.

    `load_case` is a name in the campaign file, None where it is not known.
    """

    file: str
    kind: TestKind
    load_case: str | None
    axle: int | None
    speed_km_h: float | None
    sure: bool
    why: tuple[str, ...]


@dataclass(frozen=True)
class LoggerGuess:
    """One of several loggers: its name, its rate, and whether its clock runs on from log to log."""

    name: str
    rate_hz: float
    runs_on: bool


@dataclass(frozen=True)
class FirstLook:
    """All that was found in a folder.

    `positions_m` of the axles behind axle 1, None where nothing says them; `measured_m` those by arrivals at the speeds
    that names say.
    `load_cases` maps names in the campaign file to what the truck carries.  `text_columns` are columns without numbers.
    `left_out` maps logs that are no tests by their names to the reason.  `messages` are sentences about files that were
    left out.

    With several loggers, `loggers` are their names, the reference first. `files` maps the reference logger's log of a
    run to the logs of all, by logger. `columns` maps columns of the others to their logger and their name there.
    """

    logs: tuple[SeenLog, ...]
    scans: tuple[SeenScan, ...]
    run_sensors: tuple[SensorGuess, ...]
    drop_sensors: tuple[SensorGuess, ...]
    tests: tuple[EntryGuess, ...]
    template: Template | None
    template_given: bool
    axles: int
    positions_m: tuple[float, ...] | None
    measured_m: tuple[float, ...] | None
    load_cases: Mapping[str, LoadCaseGuess]
    text_columns: tuple[str, ...]
    left_out: Mapping[str, str]
    messages: tuple[str, ...]
    loggers: tuple[LoggerGuess, ...] = ()
    files: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    columns: Mapping[str, tuple[str, str]] = field(default_factory=dict)
