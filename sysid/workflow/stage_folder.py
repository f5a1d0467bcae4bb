"""Results of the stages under ``stages/`` of an output folder: what is known, what is stale, how long it took.

A result is kept with a fingerprint and is read back as long as the fingerprint is the same. It covers the contents of
the input files that the stage reads, the settings that its record names, and the schema of its result. It also covers
the version and the sources of the code behind it, and the fingerprints of the stages that it depends on. So a stage is
stale with those below it, and there is no number to raise by hand when a result or an equation changes.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from sysid.campaign.records import Campaign
from sysid.errors import CampaignError
from sysid.files import make_folder, read_json, remove, remove_unfinished, write_text
from sysid.folder_lock import FolderLock, writing_to
from sysid.threads import one_blas_thread
from sysid.workflow import store
from sysid.workflow.earlier_files import remove_earlier
from sysid.workflow.schema import result_hint, schema_digest
from sysid.workflow.settings import Settings, remember
from sysid.workflow.sources import code_digest
from sysid.workflow.stage import Stage
from sysid.workflow.stages import STAGES
from sysid.workflow.versions import versions

T = TypeVar("T")
SUCCESS_MARKER = "SUCCESS"


class StageFolder:
    """One output folder and the stages' results in it.

    Parameters
    ----------
    output : the folder; made if it does not exist.
    settings : of all stages.
    campaign : as read; names the input files and their hashes.

    Raises
    ------
    CampaignError
        If `output` is a file.
    OutputError
        If the folder cannot be written, or another process computes a stage in it.
    """

    def __init__(self, output: Path, settings: Settings, campaign: Campaign):
        if output.exists() and not output.is_dir():
            raise CampaignError(f"--output names a file, {output.name}; give a folder instead.")
        self.path, self._settings, self._campaign = output, settings, campaign
        self._results: dict[Stage[Any], Any] = {}
        self._fingerprints: dict[Stage[Any], str] = {}
        #: Names of the stages whose results come from files, not from this process.
        self.read_back: set[str] = set()
        self._version = versions()["sysid"]
        self.lock = FolderLock(output)
        self.write(lambda: make_folder(output / "stages"))
        #: Seconds of every stage and of its parts, those that it ran first not counted.
        self.timings: dict[str, float] = self._read_timings()

    def known(self, stage: Stage[T]) -> T | None:
        """The result of a stage if it has run on these inputs and settings."""
        # A fingerprint loads the code of its stage, which `check` in a new folder does without.
        if stage not in self._results and stage.in_file and self._path(stage).exists():
            stored = store.load(self._path(stage), self.fingerprint(stage), result_hint(stage))
            if stored is not None:
                self._results[stage] = stored
                self.read_back.add(stage.name)
        result: T | None = self._results.get(stage)
        return result

    def keep(self, stage: Stage[T], result: T) -> None:
        """Store a result, and the settings for commands that show results.

        Unless the file holds the same result already, results that depend on it are deleted first.
        """

        def before_change() -> None:
            self.forget(dependents(stage))
            if stage.in_run == "always":
                self.no_success()

        self._results[stage] = result
        self.read_back.discard(stage.name)
        if not stage.in_file:
            before_change()
            return
        self.write(lambda: remember(self.path, self._settings))
        path, fingerprint, hint = self._path(stage), self.fingerprint(stage), result_hint(stage)
        try:
            self.write(lambda: store.save(path, result, fingerprint, hint, before_change))
        except TypeError as error:
            # An error of this program; reporting it is better than losing a result of minutes.
            before_change()
            warnings.warn(f"The result of '{stage.name}' is not kept: {error}.", stacklevel=2)

    def forget(self, stages: Iterable[Stage[Any]]) -> None:
        """Delete the results of some stages."""
        for stage in stages:
            self._results.pop(stage, None)
            if stage.in_file:
                self.write(partial(remove, self._path(stage)))
            if stage.command is not None and stage.command.aside is not None:
                self.write(partial(remove_earlier, self.path, stage.name, ()))

    def clear(self) -> None:
        """Delete the results of all stages, unfinished ones too."""
        self.forget(STAGES)
        for stage in STAGES:
            if stage.discard is not None:
                self.write(partial(stage.discard, self.path))

    def stale(self) -> tuple[str, ...]:
        """Names of the stages whose files are complete but of other inputs, settings, version or code."""
        names = []
        for stage in STAGES:
            marked = store.fingerprint_in(self._path(stage)) if stage.in_file else None
            if marked is not None and marked != self.fingerprint(stage):
                names.append(stage.name)
        return tuple(names)

    def no_success(self) -> None:
        """Remove the marker of a finished run."""
        self.write(lambda: remove(self.path / SUCCESS_MARKER))

    def tidy(self) -> None:
        """Remove what killed processes left half-written, down to the files of a load case in ``models/``."""
        self.write(lambda: remove_unfinished(self.path, depth=2))

    @contextmanager
    def timed(self, name: str, parts: Callable[[], dict[str, float]] = dict) -> Iterator[None]:
        """Keep the time of a stage or an ending, and of its `parts` by name."""
        begin = time.perf_counter()
        with one_blas_thread():
            yield
        elapsed = time.perf_counter() - begin
        others = {key: value for key, value in self.timings.items() if key.split(": ")[0] != name}
        self.timings = {**others, name: elapsed, **parts()}
        self.write(lambda: write_text(self._timings_file, json.dumps(self.timings)))

    def write(self, action: Callable[[], Any]) -> None:
        """Do something that writes into the folder.

        Raises OutputError if the folder cannot be written.
        """
        with writing_to(self.path):
            action()

    def fingerprint(self, stage: Stage[Any]) -> str:
        """Hash of everything that the numbers of a stage depend on."""
        if stage not in self._fingerprints:
            files = self._campaign.input_sha256
            names = files if stage.inputs is None else stage.inputs(self._campaign)
            relevant = {
                "inputs": {name: files[name] for name in names},
                "settings": {name: self._setting(name) for name in stage.settings},
                "schema": schema_digest(result_hint(stage)),
                "version": self._version,
                "code": code_digest(stage.code),
                "rests on": [self.fingerprint(before) for before in (*stage.needs, *stage.uses)],
            }
            text = json.dumps(relevant, sort_keys=True)
            self._fingerprints[stage] = hashlib.sha256(text.encode()).hexdigest()
        return self._fingerprints[stage]

    def _setting(self, name: str) -> Any:
        value: Any = self._settings
        for part in name.split("."):
            value = getattr(value, part)
        return dataclasses.asdict(value) if dataclasses.is_dataclass(value) else value  # type: ignore[arg-type]

    def _path(self, stage: Stage[Any]) -> Path:
        return self.path / "stages" / f"{stage.name}.npz"

    @property
    def _timings_file(self) -> Path:
        return self.path / "stages" / "timings.json"

    def _read_timings(self) -> dict[str, float]:
        timings = read_json(self._timings_file)
        return timings if all(type(seconds) in (int, float) for seconds in timings.values()) else {}


def dependents(stage: Stage[Any]) -> tuple[Stage[Any], ...]:
    """Stages that depend on one, directly or not, without itself."""
    after: list[Stage[Any]] = []
    for other in STAGES:
        if any(before is stage or before in after for before in (*other.needs, *other.uses)):
            after.append(other)
    return tuple(after)
