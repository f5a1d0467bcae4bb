"""The files that a campaign names: read once, hashed, and limited together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from sysid import limits
from sysid.campaign.inputs import paths
from sysid.campaign.inputs.logs import LogWriting, make_log, read_log
from sysid.campaign.records import Channel, Log, Sensor
from sysid.errors import DataRejectedError
from sysid.logs.input_file import InputFile
from sysid.logs.names import decoded
from sysid.wording import shorten


@dataclass(frozen=True)
class NamedFiles:
    """Files beside the campaign file `file`; `hashes` of those read so far, `totals` of their bytes and numbers.

    `planned` takes logs that do not exist for tests that are still to come; `sample_interval_s` of all logs.
    """

    file: Path
    sample_interval_s: float
    hashes: dict[str, str]
    planned: bool
    totals: dict[str, int] = field(default_factory=dict)

    def content(self, name: str, key: str, limit: int) -> InputFile:
        """A file of at most `limit` bytes that the key `key` names, with its content; its hash is kept.

        Raises
        ------
        CampaignError
            If the file is missing, too large or outside the campaign's folder.
        DataRejectedError
            If it has changed since it was named first, or all files together are too large.
        """
        label = f"{self.file.name}: {key}"
        content = paths.input_file(self.file.parent, name, label, limit)
        # The hash is that of the very bytes that are parsed: a file that two tests name must not change between them.
        if self.hashes.setdefault(paths.relative_name(name), content.sha256) != content.sha256:
            raise DataRejectedError(
                f"{label} names '{shorten(name, 100)}', which changed while the campaign was read; start again when it "
                "is complete."
            )
        self._count("bytes", len(content.data), limits.INPUT_BYTES, label)
        return content

    def _count(self, what: str, more: int, most: int, label: str) -> None:
        self.totals[what] = self.totals.get(what, 0) + more
        if self.totals[what] > most:
            raise DataRejectedError(
                f"{label}: the files named so far have {self.totals[what] / 1e6:.0f} million {what}, at most "
                f"{most / 1e6:.0f} are read; cut the logs to the time of the tests."
            )

    def log(
        self,
        name: str,
        key: str,
        sensors: Sequence[Sensor],
        writing: LogWriting,
        sample_interval_s: float | None = None,
    ) -> Log:
        """The log that a test names by the key `key`; a blank one where it is planned and does not exist.

        Parameters
        ----------
        writing : how the log is written.
        sample_interval_s : that of its logger, if it is not that of all.

        Raises
        ------
        CampaignError
            If the file is missing, too large or outside the campaign's folder.
        DataRejectedError
            If the log cannot be read, or all logs together are too large.
        """
        interval = sample_interval_s or self.sample_interval_s
        if self.planned:
            paths.check_name(name, f"{self.file.name}: {key}")
        if self.planned and not (self.file.parent / name).exists():
            channels = (Channel(s, np.zeros(1), np.zeros(1), np.zeros(1, np.int8)) for s in sensors)
            return make_log(paths.relative_name(name), interval, channels)
        content = self.content(name, key, limits.LOG_BYTES)
        if writing.database_file is not None:
            database = self.content(writing.database_file, f"can_database of {key}", limits.DATABASE_BYTES)
            # DBC files are written in the code page of Western Windows.
            writing = replace(writing, database=decoded(database.data))
        log = read_log(content, paths.relative_name(name), sensors, interval, writing)
        numbers = sum(channel.value.size for channel in (*log.channels, *log.auxiliary))
        self._count("numbers", numbers, limits.INPUT_NUMBERS, f"{self.file.name}: {key}")
        return log
