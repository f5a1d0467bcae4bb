"""What the quality check found in each log and channel: frozen, printable, kept with the results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from sysid.campaign.loggers import ClockFinding
from sysid.tabular import Tabular, records_table
from sysid.wording import shorten

if TYPE_CHECKING:
    import pandas as pd

Verdict = Literal["good", "usable", "rejected"]


@dataclass(frozen=True)
class ChannelFinding:
    """Quality of one channel of one log.

    Rates in Hz, jitter as the largest departure of a time step from the nominal one [s], levels in the SI unit of the
    sensor.  `gaps` lists (start [s], missing samples); `clip_level` is None where nothing is clipped; `dead_spans`
    lists (start [s], end [s]); `rest_level` and `noise_rms` come from the quiet start of the record.
    `messages` are plain sentences; `verdict` is what follows from them.
    """

    file: str
    column: str
    kind: str
    si_unit: str
    samples: int
    rate_hz: float
    jitter_s: float
    missing: int
    gaps: tuple[tuple[float, int], ...]
    clipped: int
    clip_level: float | None
    dead_spans: tuple[tuple[float, float], ...]
    rest_level: float | None
    noise_rms: float | None
    peak: float | None
    verdict: Verdict
    messages: tuple[str, ...] = ()


@dataclass(frozen=True)
class RunSpeed:
    """Speed of one run [m/s]: listed, as its axles meet the bump, and as a sensor logs it; None where not known."""

    file: str
    load_case: str
    listed_m_s: float
    measured_m_s: float | None
    logged_m_s: float | None = None


@dataclass(frozen=True)
class SpeedSensorFinding:
    """A speed sensor: its reading over the true speed with standard deviation, from arrivals in this many `runs`."""

    column: str
    factor: float
    factor_sd: float
    runs: int


@dataclass(frozen=True)
class ScanFinding:
    """The bump of one scan: height, length along the road and width scanned [m]; direction of travel [rad].

    `heading_rad` is square to the crest of the bump where that is near the declared one. Width and headings are None
    where heights along the road were measured in place of a cloud.
    """

    name: str
    file: str
    points: int
    height_m: float
    length_m: float
    width_m: float | None
    heading_rad: float | None
    declared_heading_rad: float | None


@dataclass(frozen=True)
class QualityReport(Tabular):
    """All findings of a campaign: one per log and channel, plus sentences about logs or the campaign as a whole.

    `left_out` are runs that contradict what the campaign file says of them, logs whose clock is unknown, and scans that
    show no bump, with the reason.  `speeds` of the runs, the bumps of the `scans`, and the `clocks` of further loggers.
    `contradictions` are those `messages` that say that campaign file and records do not fit together.
    `speed_sensors` with the speeds that they log, by run.
    """

    channels: tuple[ChannelFinding, ...]
    messages: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    speeds: tuple[RunSpeed, ...] = ()
    scans: tuple[ScanFinding, ...] = ()
    clocks: tuple[ClockFinding, ...] = ()
    contradictions: tuple[str, ...] = ()
    speed_sensors: tuple[SpeedSensorFinding, ...] = ()
    logged_speeds_m_s: Mapping[str, float] = field(default_factory=dict)

    @property
    def sensor_sentences(self) -> tuple[str, ...]:
        """What every speed sensor reads in units of the true speed."""
        return tuple(
            f"The speed sensor '{shorten(s.column)}' reads {s.factor:.3f} times the speed at which the axles meet the "
            f"bump (standard deviation {s.factor_sd:.3f}, {s.runs} run{'' if s.runs == 1 else 's'})."
            if s.runs
            else f"No run shows what the speed sensor '{shorten(s.column)}' reads in units of the true speed; "
            f"{s.factor_sd:.2g} is taken as the standard deviation of its factor."
            for s in self.speed_sensors
        )

    _in_row_unit = ("rest_level", "noise_rms", "peak")

    def _row_units(self, table: pd.DataFrame) -> list[str]:
        return [channel.si_unit for channel in self.channels]

    def summary(self) -> pd.DataFrame:
        """One row per entry, in SI units."""
        return records_table(
            self.channels,
            (
                "file",
                "column",
                "verdict",
                "rate_hz",
                "jitter_s",
                "missing",
                "clipped",
                "rest_level",
                "noise_rms",
                "peak",
                "messages",
            ),
        )
