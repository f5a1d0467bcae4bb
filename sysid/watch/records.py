"""What a test day has brought so far: frozen, printable."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

#: ``good``: nothing against it; ``look``: it was read, and something does not fit together; ``repeat``: readings are
#: missing or unusable; ``unlisted``: no test of the campaign file names it.
Answer = Literal["good", "look", "repeat", "unlisted"]
TestKind = Literal["plank_drop", "bump_run", "road_drive"]
#: Where k and c come from: the fit of runs and drops, the force balance of the runs, or drops read one by one.
Source = Literal["fit", "balance", "drops"]
#: k and c of an axle: both as well as asked for, both in wider intervals, or not both.
AxleState = Literal["known", "wide", "unknown"]


@dataclass(frozen=True)
class StopRule:
    """When enough is known: half widths of the 90 % intervals of every k and c, relative to their values."""

    __test__ = False

    stiffness: float = 0.02
    damping: float = 0.05


@dataclass(frozen=True)
class PlannedTest:
    """A drop, run or drive of the campaign file: its logs, and whether all of them are there.

    `axle` is the name of a drop's axle, empty for runs; `words` say what it is.
    """

    kind: TestKind
    files: tuple[str, ...]
    load_case: str
    speed_km_h: float | None
    axle: str
    words: str
    there: bool


@dataclass(frozen=True)
class LogVerdict:
    """What is said of one log: `test` in words, the answer, why, and what else to know; sentences."""

    file: str
    test: str
    answer: Answer
    reasons: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class KnownValue:
    """k [N/m] or c [N s/m] with half of its 90 % interval relative to it, and where it comes from.

    `older`: from a computation before the last log landed.
    """

    value: float
    half_width: float
    source: Source
    older: bool = False


@dataclass(frozen=True)
class KnownAxle:
    """What is known of one axle (from 1); `load_case` None where one value holds for all."""

    axle: int
    name: str
    load_case: str | None
    stiffness: KnownValue | None
    damping: KnownValue | None


@dataclass(frozen=True)
class DayReport:
    """The day so far.

    - `new`: logs that landed, were replaced or renamed since the last report; `logs`: all of them;
    - `remarks`: sentences about the day that are new, such as contradictions that no single log has;
    - `growing`: files that are still written;
    - `planned`: tests of the campaign file; `known`: axles front to rear;
    - `computing`: what runs in the background, empty if nothing does;
    - `enough`: whether what was asked for is known; `missing` says what is not, `next_tests` what to do next.
    """

    new: tuple[LogVerdict, ...]
    logs: tuple[LogVerdict, ...]
    remarks: tuple[str, ...]
    growing: tuple[str, ...]
    planned: tuple[PlannedTest, ...]
    known: tuple[KnownAxle, ...]
    computing: str
    enough: bool
    missing: tuple[str, ...]
    next_tests: tuple[str, ...]
