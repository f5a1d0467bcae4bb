"""Loggers of a campaign as it declares them, and what was found about their clocks."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite
from typing import Literal

#: A clock that starts again with every log, one that runs on from log to log, or one shared with the first logger.
ClockKind = Literal["per_log", "continuous", "shared"]
#: How the offset of a clock in one run was found.
ClockMethod = Literal["sync", "motion", "arrivals", "all runs", "declared"]


@dataclass(frozen=True)
class Logger:
    """One logger of a campaign; the clock of the first one is the reference.

    A stamp t of this logger is t_ref = t + offset + rate (t - t_c) on the reference, t_c a time in the middle of the
    run. The offset is searched within `offset_s` +- `offset_within_s`, the rate is declared as `rate` +- `rate_within`
    (both relative). `sync` is the column of a signal that all loggers record.
    """

    name: str
    clock: ClockKind = "per_log"
    offset_s: float = 0.0
    offset_within_s: float = 10.0
    rate: float = 0.0
    rate_within: float = 300e-6
    sync: str | None = None


@dataclass(frozen=True)
class ClockFinding:
    """The clock of one logger in one run: `offset_s` to add to its stamps at the time `at_s` of the run, and `rate`.

    Standard deviations `sd_s` and `rate_sd`; `offset_s` is NaN where nothing was found.  `complaint` is a sentence
    where the channels of the logger cannot be used in this run, `caution` one where they are used in spite of it.
    `moved_s` and `moved_rate` are by what a fit has moved offset and rate beyond these.
    """

    file: str
    other_file: str
    logger: str
    method: ClockMethod
    offset_s: float
    sd_s: float
    at_s: float
    rate: float
    rate_sd: float
    complaint: str = ""
    caution: str = ""
    moved_s: float = 0.0
    moved_rate: float = 0.0

    @property
    def is_unknown(self) -> bool:
        """Whether the logger is used and its clock is an estimate."""
        return not self.complaint and isfinite(self.offset_s) and 0.0 < self.sd_s < inf

    @property
    def about_s(self) -> float:
        """Time of the run, on the reference, about which a rate turns."""
        return self.at_s + self.offset_s
