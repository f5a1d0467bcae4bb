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
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

from sysid import limits
from sysid.campaign.toml.reading import parse_toml
from sysid.errors import CampaignError, OutputError
from sysid.files import UNFINISHED
from sysid.fleet.folders import CAMPAIGN_FILE
from sysid.fleet.key import calibration_key, folder_state, result_digest
from sysid.fleet.outcome import RESULT_FILE, Outcome, write_outcome
from sysid.fleet.task import RUNNING_LOCK, Task, finished_before, run_task
from sysid.folder_lock import LOCK_NAME, FolderInUseError, FolderLock, cannot_write
from sysid.logs.input_file import read_file
from sysid.private_files import NotPrivateError, private_folder

#: What of a task means something on the driver's machine or in one run only.
_NOT_COMPUTED = ("campaign", "output", "run", "again", "threads")
_DAMAGED = "its results arrived damaged; run the fleet again"


class SendingExecutor(Executor):
    """Hands tasks to an executor whose workers see no folder of this machine."""

    def __init__(self, executor: Executor):
        self._executor = executor

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """The outcome of ``run_task(task)``, computed elsewhere; its results are put below the task's output folder."""
        (task,) = args
        outer: Future[Outcome] = Future()
        try:
            _restore(Path(task.output))
            earlier = finished_before(task)
            if earlier is not None:
                outer.set_result(earlier)
                return outer
            # As the files are when they are sent: what is changed meanwhile is no part of the outcome.
            state = folder_state(Path(task.campaign))
            campaign = packed(Path(task.campaign), campaign_files(Path(task.campaign)))
            output = packed(Path(task.output), result_files(Path(task.output)))
        except (OSError, ValueError, CampaignError) as error:
            outer.set_result(Outcome("failed", f"its files cannot be sent ({error})"))
            return outer
        outer.set_running_or_notify_cancel()
        inner = self._executor.submit(run_elsewhere, task, campaign, output)
        inner.add_done_callback(partial(_receive, task, state, outer))
        return outer


def _receive(task: Task, state: dict[str, str], outer: Future[Outcome], inner: Future[tuple[Outcome, bytes]]) -> None:
    try:
        outcome, content = inner.result()
        outer.set_result(_put(task, state, outcome, content))
    except Exception as error:
        outer.set_exception(error)


def _put(task: Task, state: dict[str, str], outcome: Outcome, content: bytes) -> Outcome:
    """The results of a task where they belong, complete or not at all; the outcome as that of this machine's files.

    What fails on the way is not kept: the next run tries it again.
    """
    output = Path(task.output)
    if not content:
        return outcome
    if not outcome.finished and outcome.key:
        # Times of files are those of this machine's.  Without a key it is no property of the campaign.
        outcome = replace(outcome, inputs=state, key=calibration_key(state, task.choices))
    try:
        with FolderLock(output), tempfile.TemporaryDirectory(dir=output.parent, prefix=UNFINISHED) as place:
            new, old = Path(place) / "new", _set_aside(output)
            unpack(content, new)
            if task.prior is None:
                if outcome.finished and result_digest(new / RESULT_FILE) != outcome.result_sha256:
                    return Outcome("failed", _DAMAGED)
                write_outcome(new, outcome)
            os.replace(output, old)
            try:
                os.replace(new, output)
            finally:
                _restore(output)
    except OutputError as error:
        return Outcome("failed", str(error))
    except OSError as error:
        return Outcome("failed", str(cannot_write(output, error)))
    except (CampaignError, zipfile.BadZipFile):
        return Outcome("failed", _DAMAGED)
    return outcome


def _set_aside(output: Path) -> Path:
    return output.with_name(f"{UNFINISHED}{output.name}.old")


def _restore(output: Path) -> None:
    """Put a folder back that was set aside and not replaced, or remove it if it was."""
    old = _set_aside(output)
    if old.is_dir():
        if output.exists():
            shutil.rmtree(old)
        else:
            os.replace(old, output)


def run_elsewhere(task: Task, campaign: bytes, output: bytes) -> tuple[Outcome, bytes]:
    """Run a task on a worker from packed files: its outcome, and the packed results; nothing if it has no place."""
    try:
        with _own_folder(task, campaign) as place:
            shutil.rmtree(place / "campaign", ignore_errors=True)
            unpack(campaign, place / "campaign")
            if not (place / "output").is_dir():
                part = place / "output.part"
                shutil.rmtree(part, ignore_errors=True)
                unpack(output, part)
                os.replace(part, place / "output")
            here = replace(task, campaign=str(place / "campaign"), output=str(place / "output"))
            outcome = run_task(here)
            content = packed(place / "output", result_files(place / "output"))
            shutil.rmtree(place, ignore_errors=True)
            return outcome, content
    except (OSError, ValueError, NotPrivateError, CampaignError, OutputError) as error:
        return Outcome("failed", f"its worker has no folder of its own ({error})"), b""


@contextmanager
def _own_folder(task: Task, campaign: bytes) -> Iterator[Path]:
    """The private folder of a task, for this process alone: another one if somebody works in it already."""
    told = {name: value for name, value in vars(task).items() if name not in _NOT_COMPUTED}
    name = hashlib.sha256(json.dumps(told, sort_keys=True, default=str).encode() + campaign).hexdigest()[:32]
    user = os.getuid() if hasattr(os, "getuid") else ""
    above = private_folder(Path(tempfile.gettempdir()) / f"sysid-fleet-{user}")
    place = above / name
    with ExitStack() as stack:
        try:
            stack.enter_context(FolderLock(place))
        except FolderInUseError:
            place = Path(tempfile.mkdtemp(dir=above))
        yield place


def campaign_files(folder: Path) -> list[str]:
    """The campaign file, and every file inside its folder that a text in it names: all that a calibration may read."""
    content, texts = b"", list[str]()
    # The worker says the same of a file that cannot be read or understood.
    with suppress(OSError, CampaignError):
        content = read_file(folder / CAMPAIGN_FILE, limits.CAMPAIGN_BYTES).data
        texts = list(_texts(parse_toml(content, CAMPAIGN_FILE)))
    real = folder.resolve()
    names = {CAMPAIGN_FILE: None} if content else {}
    for text in texts:
        # Longer texts are no names, and neither are texts with a zero.
        if 0 < len(text) <= limits.PATH_BYTES and "\0" not in text:
            path = folder / text
            if path.is_file() and path.resolve().is_relative_to(real) and ".." not in PurePosixPath(text).parts:
                names[PurePosixPath(text).as_posix()] = None
    return list(names)


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for part in value.values() if isinstance(value, dict) else value:
            yield from _texts(part)


def result_files(folder: Path) -> list[str]:
    """The plain files of a folder of results."""
    found = []
    for root, folders, files in os.walk(folder):
        folders.sort()
        for name in sorted(files):
            path = Path(root) / name
            if (
                name not in (LOCK_NAME, RUNNING_LOCK)
                and not name.startswith(UNFINISHED)
                and path.is_file()
                and not path.is_symlink()
            ):
                found.append(path.relative_to(folder).as_posix())
    return found


def packed(folder: Path, names: Iterable[str]) -> bytes:
    """Files of a folder in one archive, the same files in the same bytes.

    Raises
    ------
    CampaignError
        If they are larger than all files of a campaign may be.
    OSError
        If one cannot be read.
    """
    buffer, total = io.BytesIO(), 0
    with zipfile.ZipFile(buffer, "w") as archive:
        for name in names:
            total += (folder / name).stat().st_size
            if total > limits.INPUT_BYTES:
                raise CampaignError(f"more than {limits.INPUT_BYTES / 1e9:g} GB below {folder.name}/")
            archive.writestr(zipfile.ZipInfo(name), (folder / name).read_bytes(), zipfile.ZIP_DEFLATED, 1)
    return buffer.getvalue()


def unpack(content: bytes, folder: Path) -> None:
    """Write packed files below a folder.

    Raises
    ------
    CampaignError
        If a name leads out of the folder, or the files are larger than :func:`packed` packs.
    OSError
        If it cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > limits.INPUT_BYTES:
            raise CampaignError(f"the files are more than {limits.INPUT_BYTES / 1e9:g} GB.")
        for name in archive.namelist():
            # Path knows what the system takes for a drive or for the root.
            path = folder / name
            if ".." in Path(name).parts or Path(name).is_absolute() or Path(name).drive or path == folder:
                raise CampaignError(f"'{name}' leads out of its folder.")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(archive.read(name))
