"""A test day: a look at the folder, what landed and what it is worth, and what is known so far."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sysid.campaign.changed import tables_text
from sysid.campaign.declared import read_declared
from sysid.campaign.inputs.paths import campaign_file, relative_name
from sysid.campaign.toml.reading import parse_toml
from sysid.campaign.vehicle_records import Vehicle
from sysid.errors import CampaignError, SysidError
from sysid.files import read_json, write_text
from sysid.first_look import FirstLook, campaign_text, first_look
from sysid.first_look.folder import opened
from sysid.known_results import KnownResults
from sysid.output_folder import output_folder
from sysid.watch.background import Background, Task
from sysid.watch.checks import DayCheck, KnownScans, LogCheck, alike, check_day, check_log
from sysid.watch.knowledge import known_axles, missing, next_tests, of_document, of_drops
from sysid.watch.landing import Copies, FolderLook, GrowingFolder, Landing
from sysid.watch.last_run import LastRun, last_run
from sysid.watch.listing import Listing, bump_tables, listing, log_names, named_files, with_guesses
from sysid.watch.records import Answer, DayReport, KnownAxle, LogVerdict, StopRule
from sysid.wording import shorten

_CAMPAIGN = "campaign.toml"


@dataclass(frozen=True)
class _Source:
    """The campaign file as it is now: its tables, or why it cannot be used; `given` whether there is one at all."""

    tables: dict[str, Any] | None
    given: bool
    complaint: str = ""


class TestDay:
    """The folder of a logger, watched.

    Nothing is written into that folder. Copies of the logs, the campaign of what is there, and results stand in the
    output folder; with them a watch that is started again goes on where it was.

    Parameters
    ----------
    folder : into which the logger writes, with its subfolders.
    output : folder for everything that is written, outside of `folder`.
    campaign : the campaign file, whose names are relative to `folder`; None for `campaign.toml` in `folder`.
    rule : when enough is known.
    estimates : whether k and c are computed in the background.
    begin : write the campaign file that logs suggest, once, where there is none: all that is written into `folder`.
    clock : time [s] that decides whether a file still grows.

    Raises
    ------
    CampaignError
        If the folder does not exist, or the output folder is in it.
    """

    __test__ = False

    def __init__(
        self,
        folder: Path,
        output: Path,
        campaign: Path | None = None,
        rule: StopRule | None = None,
        estimates: bool = True,
        begin: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ):
        if not folder.is_dir():
            raise CampaignError(f"{shorten(folder, 100)} is no folder; give the folder into which the logger writes.")
        self.output = output_folder(output)
        if self.output.resolve().is_relative_to(folder.resolve()):
            raise CampaignError(
                f"--output {shorten(output, 100)} lies in the folder of the logger, into which nothing is written; "
                "choose another folder."
            )
        self.folder = folder
        self.rule = rule or StopRule()
        self._file = campaign or folder / _CAMPAIGN
        self._growing = GrowingFolder(folder, clock)
        self._copies = Copies(self.output)
        self._background = Background()
        self._estimates = estimates
        self._begins = begin
        self._scans, self._found = KnownScans(), KnownResults()
        self._checked: dict[tuple[str, str, str], LogCheck] = {}
        self._landings: dict[str, Landing] = {}
        self._looked: tuple[frozenset[tuple[str, str]], FirstLook] | None = None
        self._last: dict[str, LogVerdict] = {}
        self._told: dict[str, LogVerdict] = {}
        self._said: set[str] = set()
        self._seen: object = None
        self._read: tuple[tuple[int, int], _Source] | None = None
        self._day = DayCheck()
        self._listing = Listing({}, ())
        self._growing_now: tuple[str, ...] = ()
        self._vehicle: Vehicle | None = None
        self._shown: tuple[tuple[int, int], LastRun | None] | None = None
        self._remarks: list[str] = []
        self._changed = True

    @property
    def computing(self) -> bool:
        """Whether something is computed in the background."""
        return self._background.busy

    @property
    def growing(self) -> tuple[str, ...]:
        """Names of files that are still written."""
        return self._growing_now

    @property
    def vehicle(self) -> Vehicle | None:
        """The vehicle of the campaign file, None as long as something of it is to be filled in."""
        return self._vehicle

    @property
    def last_run(self) -> LastRun | None:
        """The run that landed last of those in the preview, None before there is one; read when it has changed."""
        preview = self.output / "preview"
        try:
            found = os.stat(preview / "result.json")
        except OSError:
            return None
        stamp = (found.st_size, found.st_mtime_ns)
        if self._shown is None or self._shown[0] != stamp:
            self._shown = stamp, last_run(preview, list(self._copies.sha256))
        return self._shown[1]

    def look(self) -> DayReport | None:
        """Look at the folder; None if there is nothing new to say.

        Raises
        ------
        OutputError
            If the output folder cannot be written.
        """
        found = self._look()
        if found is not None:
            self._growing_now = tuple(found.growing)
            landings = self._copies.take(self.folder, found)
            source = self._source()
            seen = (tuple(sorted(self._copies.sha256.items())), source)
            if seen != self._seen:
                self._seen = seen
                self._landed(landings)
                self._check(source)
                self._changed = True
        ended = self._background.turn()
        if ended is not None:
            self._changed = True
            if not ended[1]:
                self._say(f"The {ended[0].words} could not be computed; 'check' on {self._file_so_far} says more.")
        if not self._changed:
            return None
        self._changed = False
        return self._report()

    def stop(self) -> None:
        """Stop what runs in the background."""
        self._background.stop()

    # ------------------------------------------------------------------ what is there

    @property
    def _file_so_far(self) -> Path:
        return self._copies.folder / _CAMPAIGN

    def _look(self) -> FolderLook | None:
        try:
            found = self._growing.look()
        except CampaignError as error:
            # A network drive that is away for a while: what was copied stays.
            self._say(str(error))
            return None
        for message in found.messages:
            self._say(message)
        return found

    def _source(self) -> _Source:
        """The campaign file; it is parsed again only when it has changed."""
        try:
            found = os.stat(self._file)
        except OSError:
            return _Source(None, given=False)
        stamp = (found.st_size, found.st_mtime_ns)
        if self._read is None or self._read[0] != stamp:
            try:
                content = campaign_file(self._file)
                source = _Source(parse_toml(content.data, content.name), given=True)
            except SysidError as error:
                source = _Source(None, given=True, complaint=str(error))
            self._read = (stamp, source)
        return self._read[1]

    def _landed(self, landings: Sequence[Landing]) -> None:
        for landing in landings:
            self._landings[landing.name] = landing
            if landing.how == "renamed":
                self._last.pop(landing.before, None)
            if landing.how == "gone":
                self._last.pop(landing.name, None)
                self._say(f"{shorten(landing.name, 100)} is gone from the folder; it no longer counts.")

    def _say(self, sentence: str) -> None:
        """A remark of the day, once for all its numbers."""
        if alike(sentence) not in self._said:
            self._said.add(alike(sentence))
            self._remarks.append(sentence)
            self._changed = True

    # ------------------------------------------------------------------ what it is worth

    def _check(self, source: _Source) -> None:
        there = self._copies.sha256
        if source.complaint:
            self._say(source.complaint)
            return
        logs, look = self._logs(source, there), None
        if source.tables is None:
            look = self._first_look() if logs else None
            known = listing({} if look is None else self._begun(look), there)
        else:
            known = listing(source.tables, there)
            if any(known.of(name) is None for name in logs):
                look = self._first_look()
                known = with_guesses(known, look, there) if look is not None else known
        self._listing = known
        if not known.tables:
            return
        write_text(self._file_so_far, tables_text(known.tables))
        try:
            declared = read_declared(self._file_so_far, unfinished=known.unfinished)
            guessed = any(where.startswith("vehicle") for where in known.open_values)
            self._vehicle = None if guessed else declared.vehicle.vehicle
        except CampaignError as error:
            # Nothing can be said of a log while the file itself is wrong.
            self._say(str(error))
            return
        checks = {name: self._of_log(name, known) for name in logs}
        unusable = [name for name, check in checks.items() if not check.readable]
        if unusable:
            drop = listing(known.tables, set(there) - set(unusable))
            known = self._listing = replace(known, tables=drop.tables)
            write_text(self._file_so_far, tables_text(known.tables))
        self._day = check_day(self._file_so_far, known.unfinished, self._scans, self._found)
        if self._day.refused:
            self._say(self._day.refused)
        for sentence in self._day.sentences:
            if not any(name in sentence for name in logs):
                self._say(sentence)
        self._last = {name: self._verdict(name, check) for name, check in checks.items()}
        if self._estimates:
            self._background.want(self._tasks())

    def _begun(self, look: FirstLook) -> dict[str, Any]:
        """The campaign that the logs suggest; it is written into the logger's folder where that was asked for."""
        text = campaign_text(look, self.folder.resolve().name, f"check {self._file.name}")
        if self._begins and not self._file.exists():
            write_text(self._file, text)
            self._begins = False
            self._say(f"{shorten(self._file, 100)} was written: fill in what it says, the watch takes it up.")
        return parse_toml(text.encode(), _CAMPAIGN)

    def _logs(self, source: _Source, there: Mapping[str, str]) -> list[str]:
        """Names of the logs: what a test names, and what looks like a log and nothing else names."""
        named = set() if source.tables is None else named_files(source.tables)
        tests = set() if source.tables is None else {f for t in listing(source.tables, there).planned for f in t.files}
        return [name for name in there if name in tests or (name not in named and self._is_log(name))]

    def _is_log(self, name: str) -> bool:
        key = ("what", name, self._copies.sha256[name])
        if key not in self._checked:
            try:
                found = opened(self._copies.folder, name)
            except SysidError:
                found = None
            self._checked[key] = LogCheck("good", readable=found is not None and found.what == "log")
        return self._checked[key].readable

    def _first_look(self) -> FirstLook | None:
        key = frozenset(self._copies.sha256.items())
        if self._looked is None or self._looked[0] != key:
            try:
                self._looked = (key, first_look(self._copies.folder))
            except SysidError as error:
                self._say(str(error))
                return None
        return self._looked[1]

    def _of_log(self, name: str, known: Listing) -> LogCheck:
        """The check of one log by itself, made once for its content and what the campaign file says besides tests."""
        test = known.of(name)
        if test is None and name not in known.taken:
            said = known.guessed.get(name, "no test of the campaign file names it: enter it in [tests].")
            return LogCheck("unlisted", (said,))
        rest = {k: v for k, v in known.tables.items() if k not in ("tests", "prediction")}
        entry = [e for e in _all_tests(known.tables) if name in log_names(e)]
        key = (name, self._copies.sha256[name], json.dumps([rest, entry], default=str, sort_keys=True))
        if key not in self._checked:
            kept = {k: v for k, v in self._checked.items() if k[0] != name}
            self._checked = kept | {key: check_log(self._file_so_far, name, known.unfinished, bool(known.open_values))}
        check = self._checked[key]
        return replace(check, notes=(known.guessed[name], *check.notes)) if name in known.guessed else check

    def _verdict(self, name: str, check: LogCheck) -> LogVerdict:
        test = self._listing.of(name)
        sentences = tuple(s for s in self._day.sentences if name in s)
        reasons = (*check.reasons, *sentences)
        answer: Answer = "look" if check.answer == "good" and sentences else check.answer
        notes = list(check.notes)
        landing = self._landings.get(name)
        if landing is not None:
            notes += [landing.remark] if landing.remark else []
            if landing.how == "renamed":
                notes.append(f"renamed from {shorten(landing.before, 100)}, its content is the same.")
            if landing.how == "replaced":
                notes.append("it takes the place of another log of this name.")
        if name in self._day.speed_m_s:
            listed, measured = self._day.listed_m_s[name], self._day.speed_m_s[name]
            notes.append(f"{3.6 * measured:.1f} km/h by the arrivals of its axles, {3.6 * listed:.4g} listed.")
        return LogVerdict(name, "" if test is None else test.words, answer, reasons, tuple(notes))

    # ------------------------------------------------------------------ what is known

    def _tasks(self) -> list[Task]:
        known = self._listing
        # A sensor without a number or a filter does not bear on that: whatever is missing, the stages refuse it.
        if known.open_values:
            return []
        hashes = self._copies.sha256
        drops = [t for entry in _entries_of(known.tables, "plank_drop") for t in self._drop_task(entry, hashes)]
        whole = self.output / "preview"
        if not _entries_of(known.tables, "bump_run") or known.waits_for or self._whole_is_known(whole):
            return drops
        # The force balance answers in seconds.
        logs = frozenset(hashes.values())
        balance, *later = (Task(c, self._file_so_far, whole, logs) for c in ("balance", "fit", "advise"))
        return [balance, *drops, *later]

    def _drop_task(self, entry: Mapping[str, Any], hashes: Mapping[str, str]) -> list[Task]:
        """The drop by itself, unless its results are there."""
        digest = hashes.get(next(log_names(entry), ""))
        output = None if digest is None else self._drop_folder(digest)
        if digest is None or output is None or (output / "result.json").is_file():
            return []
        tables = {k: v for k, v in self._listing.tables.items() if k not in ("scan", "prediction")}
        tests = {k: v for k, v in tables.get("tests", {}).items() if k in ("plank_height_m", "load_case")}
        tables = {**tables, "tests": {**tests, "plank_drop": [dict(entry)]}}
        file = self._copies.folder / f"drop-{digest[:12]}.toml"
        write_text(file, tables_text(tables))
        return [Task("drops", file, output, frozenset((digest,)))]

    def _drop_folder(self, digest: str) -> Path:
        return self.output / "drops" / digest[:12]

    def _whole_is_known(self, whole: Path) -> bool:
        document = read_json(whole / "result.json")
        return bool(document.get("advice")) and self._is_of_all(document)

    def _is_of_all(self, document: Mapping[str, Any]) -> bool:
        """Whether results are of all logs that are there now, and of no others."""
        tables = self._listing.tables
        bumps = {relative_name(str(b[key])) for b in bump_tables(tables) for key in ("file", "profile") if key in b}
        inputs = document.get("inputs") or {}
        of_logs = {name: digest for name, digest in inputs.items() if name != _CAMPAIGN and name not in bumps}
        return of_logs == {n: self._copies.sha256.get(n) for e in _all_tests(tables) for n in log_names(e)}

    def _known(self) -> tuple[tuple[KnownAxle, ...], dict[str, Any]]:
        document = read_json(self.output / "preview" / "result.json")
        current = bool(document) and self._is_of_all(document)
        drops = [
            read_json(self._drop_folder(self._copies.sha256[name]) / "result.json")
            for entry in _entries_of(self._listing.tables, "plank_drop")
            if (name := next(log_names(entry), "")) in self._copies.sha256
        ]
        vehicle = self._listing.tables.get("vehicle", {})
        names = [str(axle.get("name", "")) for axle in vehicle.get("axle", ())]
        found = known_axles(names, of_document(document, not current) if document else {}, of_drops(drops))
        return found, document if current else {}

    def _report(self) -> DayReport:
        known, document = self._known()
        cases = list(self._listing.tables.get("load_case", {}))
        waits = [f"{where} is to be filled in." for where in self._listing.open_values[:5]]
        waits += [f"{what}, is not there yet." for what in self._listing.waits_for]
        not_enough = missing(known, self.rule, document, self._listing.planned, cases, waits)
        enough = bool(known) and not not_enough
        new = tuple(v for name, v in self._last.items() if name in self._landings or self._is_changed(v))
        remarks, self._remarks = tuple(self._remarks), []
        self._landings = {}
        self._told = dict(self._last)
        return DayReport(
            new=new,
            logs=tuple(self._last.values()),
            remarks=remarks,
            growing=self._growing_now,
            planned=self._listing.planned,
            known=known,
            computing=self._background.words,
            enough=enough,
            missing=not_enough,
            next_tests=next_tests(self._listing.planned, document, enough, self.rule),
        )

    def _is_changed(self, verdict: LogVerdict) -> bool:
        """Whether something else is to be said of a log than before."""
        before = self._told.get(verdict.file)
        if before is None:
            return True
        return (before.answer, [*map(alike, before.reasons)]) != (verdict.answer, [*map(alike, verdict.reasons)])


def _entries_of(tables: Mapping[str, Any], kind: str) -> list[dict[str, Any]]:
    return list(tables.get("tests", {}).get(kind, ()))


def _all_tests(tables: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [e for kind in ("plank_drop", "bump_run", "road_drive") for e in _entries_of(tables, kind)]
