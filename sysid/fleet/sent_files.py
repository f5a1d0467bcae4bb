"""Campaigns for workers that do not see the folders of the driver: the files travel with the task, the results back.

A worker keeps what it computes in a private folder of its own until it is sent.  The folder's name is a hash of the
task: if a worker dies, the next one on that machine goes on from there.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor, Future
from dataclasses import replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

from sysid import limits
from sysid.errors import CampaignError
from sysid.files import UNFINISHED
from sysid.fleet.key import calibration_key, folder_state, result_digest
from sysid.fleet.outcome import RESULT_FILE, Outcome, keep
from sysid.fleet.task import Task, finished_before, run_task
from sysid.folder_lock import LOCK_NAME, cannot_write
from sysid.private_files import NotPrivateError, private_folder

#: A folder inside a campaign's that holds this one holds results.
_RESULTS = "stages"
#: A driver's path and its user's, which mean nothing elsewhere.
_NOT_SENT = ("campaign", "output")


class SendingExecutor(Executor):
    """Hands tasks to an executor whose workers see no folder of this machine."""

    def __init__(self, executor: Executor):
        self._executor = executor

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """The outcome of ``run_task(task)``, computed elsewhere; its results are put below the task's output folder."""
        (task,) = args
        outer: Future[Outcome] = Future()
        earlier = finished_before(task)
        if earlier is not None:
            outer.set_result(earlier)
            return outer
        try:
            files = packed(Path(task.campaign), without_results=True), packed(Path(task.output))
        except (OSError, CampaignError) as error:
            outer.set_result(_recorded(task, Outcome("failed", f"its files cannot be sent ({error})")))
            return outer
        outer.set_running_or_notify_cancel()
        inner = self._executor.submit(run_elsewhere, task, *files)
        inner.add_done_callback(partial(_receive, task, outer))
        return outer


def _receive(task: Task, outer: Future[Outcome], inner: Future[tuple[Outcome, bytes]]) -> None:
    try:
        outcome, content = inner.result()
        outer.set_result(_recorded(task, _put(task, outcome, content)))
    except (CancelledError, Exception) as error:
        outer.set_exception(error)


def _put(task: Task, outcome: Outcome, content: bytes) -> Outcome:
    """The results of a task where they belong, complete or not at all."""
    output = Path(task.output)
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=output.parent, prefix=UNFINISHED) as place:
            new, old = Path(place) / "new", Path(place) / "old"
            unpack(content, new)
            if outcome.finished and task.prior is None and result_digest(new / RESULT_FILE) != outcome.result_sha256:
                return Outcome("failed", "its results arrived damaged; run the fleet again")
            new.mkdir(exist_ok=True)
            if output.exists():
                os.replace(output, old)
            os.replace(new, output)
    except OSError as error:
        return Outcome("failed", str(cannot_write(output, error)))
    except (CampaignError, zipfile.BadZipFile):
        return Outcome("failed", "its results arrived damaged; run the fleet again")
    return outcome


def _recorded(task: Task, outcome: Outcome) -> Outcome:
    """The outcome as that of the campaign on this machine, kept beside its results."""
    if not outcome.finished:
        # Times of files are those of this machine's.
        inputs = folder_state(Path(task.campaign))
        outcome = replace(outcome, inputs=inputs, key=calibration_key(inputs, task.choices))
    if task.prior is None:
        try:
            keep(Path(task.output), outcome)
        except OSError as error:
            return Outcome("failed", str(cannot_write(Path(task.output), error)))
    return outcome


def run_elsewhere(task: Task, campaign: bytes, output: bytes) -> tuple[Outcome, bytes]:
    """Run a task on a worker from packed files: its outcome, and the packed folder of its results."""
    try:
        place = _own_folder(task, campaign)
        shutil.rmtree(place / "campaign", ignore_errors=True)
        unpack(campaign, place / "campaign")
        if not (place / "output").is_dir():
            unpack(output, place / "output")
    except (OSError, NotPrivateError) as error:
        return Outcome("failed", f"the worker has no folder of its own ({error})"), packed(Path())
    here = replace(task, campaign=str(place / "campaign"), output=str(place / "output"))
    outcome = run_task(here)
    content = packed(place / "output")
    shutil.rmtree(place, ignore_errors=True)
    return outcome, content


def _own_folder(task: Task, campaign: bytes) -> Path:
    told = {k: v for k, v in vars(task).items() if k not in (*_NOT_SENT, "run", "again", "threads")}
    name = hashlib.sha256(json.dumps(told, sort_keys=True, default=str).encode() + campaign).hexdigest()[:32]
    user = os.getuid() if hasattr(os, "getuid") else ""
    return private_folder(Path(tempfile.gettempdir()) / f"sysid-fleet-{user}" / name)


def packed(folder: Path, *, without_results: bool = False) -> bytes:
    """The plain files below a folder in one archive, the same files in the same bytes; empty folders are left out.

    Raises
    ------
    CampaignError
        If they are larger than all files of a campaign may be.
    OSError
        If one cannot be read.
    """
    buffer, total = io.BytesIO(), 0
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for path in _plain_files(folder, without_results) if folder != Path() else ():
            total += path.stat().st_size
            if total > limits.INPUT_BYTES:
                raise CampaignError(f"more than {limits.INPUT_BYTES / 1e9:g} GB below {folder.name}/")
            with archive.open(zipfile.ZipInfo(path.relative_to(folder).as_posix()), "w", force_zip64=True) as entry:
                entry.write(path.read_bytes())
    return buffer.getvalue()


def _plain_files(folder: Path, without_results: bool) -> Iterator[Path]:
    for root, folders, files in os.walk(folder):
        inside = Path(root)
        if without_results and inside != folder and _RESULTS in folders:
            folders[:] = []
            continue
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(files):
            if name != LOCK_NAME and not name.startswith(UNFINISHED) and (inside / name).is_file():
                yield inside / name


def unpack(content: bytes, folder: Path) -> None:
    """Write packed files below a folder.

    Raises
    ------
    CampaignError
        If a name leads out of the folder.
    OSError
        If it cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        for name in archive.namelist():
            parts = PurePosixPath(name).parts
            if not parts or ".." in parts or name.startswith("/") or "\\" in name or ":" in name:
                raise CampaignError(f"'{name}' leads out of its folder.")
            path = folder.joinpath(*parts)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(archive.read(name))
