"""What every format of a log gives and is given: channels with their own time, and the request for them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sysid.logs.input_file import InputFile
from sysid.logs.names import normal_name

#: Numbers beyond it are damage: no sensor reads them, and squares of them are infinite.
LARGEST = 1e100


def within_range(numbers: np.ndarray) -> np.ndarray:
    """Numbers (n,), those that are infinite or at least 1e100 as NaN; the same array where there are none."""
    fine = np.abs(numbers) < LARGEST
    return numbers if fine.all() else np.where(fine, numbers, np.nan)


@dataclass(frozen=True)
class Clock:
    """Time stamps of one or more channels: `time_s` (n,), NaN where a stamp is missing, and where they stand.

    `name` is that of the column or channel of time; row i of the stamps is row `first_row` + i for people. `written`
    are the stamps (n,) [s] of the file where they had too few digits and were spread by the number of rows.
    """

    name: str
    time_s: np.ndarray
    first_row: int = 1
    written: np.ndarray | None = None


@dataclass(frozen=True)
class RawChannel:
    """One channel as its file has it: `values` (n,) float64 in `unit` (None: not said), NaN where missing.

    Channels share a `clock` object only if all their stamps are equal.  `source` says where in the file the channel
    stands.
    """

    name: str
    clock: Clock
    values: np.ndarray
    unit: str | None = None
    source: str = ""


@dataclass(frozen=True)
class LogRequest:
    """What is wanted of a log, and what the campaign says about the way it is written.

    - `wanted` are names of channels;
    - `time` is the name of the column of time (None: a usual one); with `units_row` the row below the names holds
      units;
    - `format` is the name of a format (None: found from content and suffix).

    With `everything` all channels of numbers that have a time are given (300 at most), by name, or by group and name
    where several have the same, instead of the wanted ones. `database` is the text of a DBC file for logs of a CAN bus.
    Names are kept in the form in which they are compared (:func:`~sysid.logs.names.normal_name`).
    """

    wanted: tuple[str, ...]
    time: str | None = None
    units_row: bool = False
    format: str | None = None
    everything: bool = False
    database: str | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "wanted", tuple(map(normal_name, self.wanted)))
        object.__setattr__(self, "time", None if self.time is None else normal_name(self.time))


@dataclass(frozen=True)
class LogContent:
    """What was read of a log: the wanted channels that it has, and names of those that it has at all.

    `messages` are sentences about what is missing in it, `left_out` about channels that cannot be read, where all were
    asked for.
    """

    channels: tuple[RawChannel, ...]
    names: tuple[str, ...]
    messages: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()


@dataclass(frozen=True)
class LogFormat:
    """One format: its `name` in a campaign file, what people call it, and the reader.

    `recognises` judges the first bytes of a file; `suffixes` (small letters, with dot) count where no content is
    recognised.  `libraries` are modules that the reader imports, `extra` is the extra of this package that installs
    them, None where they are always there.  `read` takes the file, its name for sentences and the request.
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    recognises: Callable[[bytes], bool]
    read: Callable[[InputFile, str, LogRequest], LogContent]
    libraries: tuple[str, ...] = ()
    extra: str | None = None
