"""Logs of bump runs: one per run, or one per logger and run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sysid.campaign.inputs.logs import LogWriting
from sysid.campaign.inputs.named_files import NamedFiles
from sysid.campaign.loggers import Logger
from sysid.campaign.records import Log, Sensor
from sysid.errors import CampaignError
from sysid.wording import finish, nearest, shorten

if TYPE_CHECKING:
    from sysid.campaign.toml import schema as s
    from sysid.campaign.toml.schema_loggers import LoggerTable, LogTable


def log_writing(common: LogTable, *specific: LogTable, sync: str | None = None) -> LogWriting:
    """How a log is written: what tables say, the last first, `common` after all."""
    tables = [*reversed(specific), common]

    def said(key: str) -> str | bool | None:
        return next((value for t in tables if (value := getattr(t, key)) is not None), None)

    time, form, database = said("time"), said("format"), said("can_database")
    assert not isinstance(time, bool)
    assert not isinstance(form, bool)
    assert not isinstance(database, bool)
    return LogWriting(time, bool(said("units_row")), form, sync, database)


@dataclass(frozen=True)
class RunLogs:
    """Reader of the logs of bump runs; `label` is the name of the campaign file.

    Raises
    ------
    CampaignError
        If a logger is named twice, or a sensor names one that is not there.
    """

    label: str
    tables: s.CampaignFile
    files: NamedFiles
    sensors: Sequence[Sensor]

    def __post_init__(self) -> None:
        names = self._names
        twice = next((n for n in names if names.count(n) > 1), None)
        if twice is not None:
            raise CampaignError(f"{self.label}: logger names '{shorten(twice)}' twice; give every logger its own name.")
        for sensor in self.sensors:
            if sensor.logger and sensor.logger not in names:
                self._unknown(sensor.logger, f"sensors.bump_run.{shorten(sensor.column)}.logger")

    @property
    def _names(self) -> list[str]:
        return [table.name for table in self.tables.logger]

    @property
    def loggers(self) -> tuple[Logger, ...]:
        """Loggers of the campaign, in SI units."""
        return tuple(
            Logger(
                table.name, table.clock, table.offset_s, table.offset_within_s, 1e-6 * table.rate_ppm,
                1e-6 * table.rate_within_ppm, table.sync,
            )
            for table in self.tables.logger
        )  # fmt: skip

    def read(self, entry: s.BumpRunTable, key: str) -> tuple[Log, Mapping[str, Log]]:
        """Log of the first logger, and those of the others by their names.

        Raises
        ------
        CampaignError
            If a file is missing, or `files` names no logger, or not the first one.
        DataRejectedError
            If a log cannot be read.
        """
        common = self.tables.acquisition
        loggers = {table.name: table for table in self.tables.logger}
        if entry.file is not None:
            if not loggers:
                writing = log_writing(common, entry)
                return self.files.log(entry.file, f"{key}.file", self.sensors, writing), {}
            return self._of(next(iter(loggers.values())), entry, entry.file, f"{key}.file"), {}
        for name in entry.files:
            if name not in loggers:
                self._unknown(name, f"{key}.files")
        first = self._names[0]
        if first not in entry.files:
            raise CampaignError(
                f"{self.label}: {key}.files has no log of '{shorten(first)}', the first logger, whose clock is the "
                "reference; add it, or put another logger first."
            )
        read = {n: self._of(loggers[n], entry, f, f"{key}.files.{shorten(n)}") for n, f in entry.files.items()}
        return read[first], {name: log for name, log in read.items() if name != first}

    def _of(self, table: LoggerTable, entry: s.BumpRunTable, file: str, key: str) -> Log:
        first = table.name == self._names[0]
        sensors = [s for s in self.sensors if s.logger == table.name or (first and not s.logger)]
        if not sensors:
            raise CampaignError(
                f"{self.label}: {key} is a log of '{shorten(table.name)}', which has no sensor in [sensors.bump_run]; "
                f"add logger = '{shorten(table.name)}' to its sensors there."
            )
        writing = log_writing(self.tables.acquisition, entry, table, sync=table.sync)
        return self.files.log(file, key, sensors, writing, table.sample_interval_s)

    def _unknown(self, name: str, key: str) -> None:
        if not self._names:
            raise CampaignError(
                f"{self.label}: {key} names the logger '{shorten(name)}', but there is no [[logger]]; add one for "
                "every logger, the one whose clock is the reference first."
            )
        raise CampaignError(
            finish(f"{self.label}: {key} names '{shorten(name)}', which is no logger; {nearest(name, self._names)}")
        )
