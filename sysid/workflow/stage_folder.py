"""Results of the stages under ``stages/`` of an output folder: what is known, what is stale, how long it took."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from sysid.errors import CampaignError
from sysid.export.files import write_text
from sysid.folder_lock import FolderLock, cannot_write
from sysid.threads import one_blas_thread
from sysid.workflow import store
from sysid.workflow.settings import Settings, remember
from sysid.workflow.versions import versions

#: Stages in order; a result depends on those before it.
STAGES = ("check", "drops", "scan", "fit", "advise", "profile", "sample", "crosscheck", "bands", "predict")
#: Stages on whose results no other depends.
ENDS = ("advise", "profile", "crosscheck", "bands")
#: On which stages the numbers of each rest; those of runs left out are kept beside the stages.
_RESTS_ON = {
    "check": (),
    "drops": ("check",),
    "scan": ("check",),
    "fit": ("drops", "scan"),
    "advise": ("fit",),
    "profile": ("fit",),
    "left_out": ("fit",),
    "sample": ("fit",),
    "crosscheck": ("sample",),
    "bands": ("sample",),
    "predict": ("sample",),
}
#: Raised when a stage's result gains or loses a field, or its numbers change: files of before, and those of stages that
#: rest on it, are then computed again.
_CONTENT = dict.fromkeys(_RESTS_ON, 3)
SUCCESS_MARKER = "SUCCESS"


class StageFolder:
    """One output folder and the stages' results in it.

    A result is kept with a fingerprint of the inputs and settings that it depends on and is read back as long as they
    are the same.

    Parameters
    ----------
    output : the folder; made if it does not exist.
    settings : of all stages.
    input_sha256 : hash of every input file.

    Raises
    ------
    CampaignError
        If `output` is a file.
    OutputError
        If the folder cannot be written, or another process computes a stage in it.
    """

    def __init__(self, output: Path, settings: Settings, input_sha256: Mapping[str, str]):
        if output.exists() and not output.is_dir():
            raise CampaignError(f"--output names a file, {output.name}; give a folder instead.")
        self._output = output
        self._settings = settings
        self._inputs = dict(input_sha256)
        self._results: dict[str, Any] = {}
        self._nested: list[float] = []
        self.lock = FolderLock(output)
        self.write(lambda: (output / "stages").mkdir(parents=True, exist_ok=True))
        #: Seconds of every stage, those that it ran first not counted.
        self.timings: dict[str, float] = self._read_timings()

    def result(self, name: str, compute: Callable[[], Any], *, again: bool = False) -> Any:
        """The result of a stage: known already, else (or `again`) computed, timed and kept; later ones are stale."""
        known = None if again else self.known(name)
        if known is not None:
            return known
        with self.lock:
            result = self.timed(name, compute)
            if name not in ENDS:
                self.forget(STAGES[STAGES.index(name) + 1 :])
                self.write(partial((self._output / SUCCESS_MARKER).unlink, missing_ok=True))
            self.keep(name, result)
        return result

    def known(self, name: str) -> Any | None:
        """The result of a stage if it has run on these inputs and settings."""
        if name not in self._results:
            stored = store.load(self._path(name), self._fingerprint(name))
            if stored is None:
                return None
            self._results[name] = stored
        return self._results[name]

    def keep(self, name: str, result: Any) -> None:
        """Keep a result, and the settings for commands that show what is there."""
        self._results[name] = result
        self.write(lambda: remember(self._output, self._settings))
        self.write(lambda: store.save(self._path(name), result, self._fingerprint(name)))

    def redo(self, name: str) -> None:
        """Forget a stage and all that follow, so that it runs again."""
        with self.lock:
            self.forget((name,) if name in ENDS else STAGES[STAGES.index(name) :])

    def forget(self, names: tuple[str, ...]) -> None:
        """Forget the results of some stages; left-out runs go with the fit."""
        for name in (*names, *(("left_out",) if "fit" in names else ())):
            self._results.pop(name, None)
            self.write(partial(self._path(name).unlink, missing_ok=True))

    def timed(self, name: str, compute: Callable[[], Any]) -> Any:
        """Run a stage and keep its own time: a stage that runs its predecessors first is not charged for them."""
        self._nested.append(0.0)
        begin = time.perf_counter()
        try:
            with one_blas_thread():
                result = compute()
        finally:
            elapsed = time.perf_counter() - begin
            within = self._nested.pop()
            if self._nested:
                self._nested[-1] += elapsed
        self.timings[name] = elapsed - within
        self.write(lambda: write_text(self._timings_file, json.dumps(self.timings)))
        return result

    def write(self, action: Callable[[], Any]) -> None:
        """Do something that writes into the folder.

        Raises OutputError if the folder cannot be written.
        """
        try:
            action()
        except OSError as error:
            raise cannot_write(self._output, error) from error

    def _path(self, name: str) -> Path:
        return self._output / "stages" / f"{name}.npz"

    @property
    def _timings_file(self) -> Path:
        return self._output / "stages" / "timings.json"

    def _fingerprint(self, name: str) -> str:
        """Hash of the inputs, the version and the settings that a stage depends on, and of the stages it rests on."""
        settings = self._settings.as_dict()
        relevant: dict[str, Any] = {
            "inputs": self._inputs,
            "version": versions()["sysid"],
            "content": _CONTENT[name],
            "rests on": [self._fingerprint(before) for before in _RESTS_ON[name]],
        }
        if name in ("drops", "fit"):
            relevant["fit"] = settings["fit"]
        if name == "drops":
            relevant["drop_model"] = self._settings.drop_model
        if name == "sample":
            # How long to go on decides when a chain ends, not what it is.
            limits = ("max_steps", "min_steps", "rhat_limit", "min_effective")
            relevant["sampling"] = {k: v for k, v in settings["sampling"].items() if k not in limits}
        return hashlib.sha256(json.dumps(relevant, sort_keys=True).encode()).hexdigest()

    def _read_timings(self) -> dict[str, float]:
        try:
            return dict(json.loads(self._timings_file.read_text(encoding="utf-8")))
        except (OSError, ValueError):
            return {}
