"""One campaign as a task: calibrated by a process of its own, so that whatever kills it costs this campaign only.

A task may run anywhere that sees the folders, and again at any time: what is finished is found by its hash, what was
begun goes on.  Pools of processes are not used for this: when one of their processes is killed, the pool is broken and
all that waits in it is lost (``BrokenProcessPool``).  Here a thread waits for a process, and sees how it ended.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import sysid
from sysid.files import (
    LinkRefusedError,
    appended,
    is_plain,
    keep_inside,
    make_folder,
    read_bytes,
    read_json,
    remove,
    write_text,
)
from sysid.fleet.changes import still_valid
from sysid.fleet.key import calibration_key, folder_state
from sysid.fleet.outcome import LOG_FILE, Outcome, read_outcome, write_outcome
from sysid.folder_lock import cannot_write

#: A task whose process was killed or died this often within one run of the fleet is set aside.
MOST_STARTS = 2
_STARTS_FILE = "fleet_starts.json"
PROGRESS_FILE = "fleet_progress.json"
#: Held while a campaign is worked on, and how long it is waited for [s]: who asks holds it for a moment.
RUNNING_LOCK = ".running.lock"
_MARK_S = 5.0
#: Least time between two writings of the progress of a campaign [s].
_INTERVAL_S = 1.0
_CHILD = (sys.executable, "-m", "sysid.fleet.child")


@dataclass(frozen=True)
class Task:
    """What a worker is told: folders as text, options of the stages, threads, and the `run` of the fleet it is part of.

    `again` names states of earlier outcomes that are not taken over; `command` starts the
    process, empty for the program's own where the task runs.  With a `prior` (as
    :class:`sysid.fleet.population_prior.PopulationPrior` writes it) a finished campaign is only sampled once more.
    """

    name: str
    campaign: str
    output: str
    choices: Mapping[str, Any] = field(default_factory=dict)
    threads: int = 1
    run: str = ""
    again: tuple[str, ...] = ()
    command: tuple[str, ...] = ()
    prior: Mapping[str, Any] | None = None


class StoppedError(Exception):
    """The run of the fleet was stopped while the task ran; it has no outcome."""


class Processes:
    """The processes that run now, so that they can be ended all at once."""

    def __init__(self) -> None:
        self._lock, self._running, self.stopped = threading.Lock(), set[subprocess.Popen[str]](), False

    def add(self, process: subprocess.Popen[str]) -> None:
        """Count a process; it is ended at once if all are to end."""
        with self._lock:
            self._running.add(process)
            if self.stopped:
                process.kill()

    def remove(self, process: subprocess.Popen[str]) -> None:
        """Forget a process that has ended."""
        with self._lock:
            self._running.discard(process)

    def stop(self) -> None:
        """End all processes and start no more."""
        with self._lock:
            self.stopped = True
            for process in self._running:
                process.kill()


#: Those of this process: a driver's own, or a worker's.
PROCESSES = Processes()


def run_task(task: Task) -> Outcome:
    """Calibrate one campaign, or find that it is done already; never raises for what befalls the calibration.

    The outcome is kept beside the results too, where the folder can be written.  Raises StoppedError if all processes
    are ended meanwhile.
    """
    earlier = finished_before(task)
    if earlier is not None:
        return earlier
    campaign, output = Path(task.campaign), Path(task.output)
    # campaigns/NAME below the folder of the fleet.
    keep_inside(output.parents[1])
    try:
        make_folder(output)
        with _marked_as_running(output):
            outcome = _started(task, campaign, output)
    except OSError as error:
        outcome = _without_process(task, "failed", str(cannot_write(output, error)))
    except LinkRefusedError as error:
        outcome = _without_process(task, "failed", str(error))
    with contextlib.suppress(OSError, LinkRefusedError):
        if task.prior is None:
            write_outcome(output, outcome)
        remove(output / _STARTS_FILE)
        remove(output / PROGRESS_FILE)
    return outcome


def is_running(output: Path) -> bool:
    """Whether a process works on the campaign whose results are in `output`, as the system's locks say."""
    from filelock import FileLock, Timeout

    if not is_plain(output / RUNNING_LOCK):
        return False
    try:
        with FileLock(output / RUNNING_LOCK, timeout=0, thread_local=False):
            return False
    except (Timeout, RuntimeError):
        # The second where the lock is of this process.
        return True
    except OSError:
        return False


@contextlib.contextmanager
def _marked_as_running(output: Path) -> Iterator[None]:
    """While it lasts, :func:`is_running` says so; the mark goes with the process, however that ends."""
    from filelock import FileLock, Timeout

    lock = FileLock(output / RUNNING_LOCK, timeout=_MARK_S, thread_local=False)
    # Held by another driver, which the process will find out too; or a file system without locks.
    with contextlib.suppress(Timeout, RuntimeError, OSError, NotImplementedError):
        if is_plain(output / RUNNING_LOCK) or not os.path.lexists(output / RUNNING_LOCK):
            lock.acquire()
    try:
        yield
    finally:
        lock.release()


def finished_before(task: Task) -> Outcome | None:
    """The outcome of an earlier run that is still that of the campaign as it is now; None if it is to be computed."""
    earlier = read_outcome(Path(task.output)) if task.prior is None else None
    if earlier is None or earlier.state in task.again:
        return None
    return earlier if still_valid(earlier, Path(task.campaign), Path(task.output), task.choices) else None


def _started(task: Task, campaign: Path, output: Path) -> Outcome:
    begin = time.monotonic()
    code, starts = 0, _starts(output, task.run)
    while starts < MOST_STARTS and not PROCESSES.stopped:
        starts += 1
        # Counted before: who kills the worker, too, is found out.
        write_text(output / _STARTS_FILE, json.dumps({"run": task.run, "starts": starts}))
        outcome, code = _process(task, output)
        if outcome is not None:
            return replace(outcome, seconds=round(time.monotonic() - begin, 3), attempts=starts)
    if PROCESSES.stopped:
        raise StoppedError
    sentence = f"its process died {starts} times ({_ending(code)}); see {LOG_FILE} in its folder{_last_words(output)}"
    return replace(_without_process(task, "crashed", sentence), attempts=starts)


def _process(task: Task, output: Path) -> tuple[Outcome | None, int]:
    """Run the process to its end: the outcome that it reported, None if it died, and its exit status."""
    environment = os.environ | {
        "SYSID_THREADS": str(task.threads),
        # The package that runs here, also where it is not installed.
        "PYTHONPATH": os.pathsep.join(
            filter(None, (str(Path(sysid.__file__).parents[1]), os.environ.get("PYTHONPATH")))
        ),
    }
    request = {"campaign": task.campaign, "output": task.output, "choices": dict(task.choices), "prior": task.prior}
    with appended(output / LOG_FILE) as log:
        process = subprocess.Popen(
            task.command or _CHILD,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
            encoding="utf-8",
            env=environment,
            # Ctrl-C in the terminal is for the driver, which ends its processes itself.
            start_new_session=True,
        )
    PROCESSES.add(process)
    try:
        assert process.stdin is not None
        # Left open: its end tells the process that nobody waits for it any more.
        with contextlib.suppress(OSError):
            process.stdin.write(json.dumps(request) + "\n")
            process.stdin.flush()
        outcome = _heard(process, output)
        return outcome, process.wait()
    finally:
        PROCESSES.remove(process)
        with contextlib.suppress(OSError):
            assert process.stdin is not None
            process.stdin.close()
        assert process.stdout is not None
        process.stdout.close()


def _heard(process: subprocess.Popen[str], output: Path) -> Outcome | None:
    written = 0.0
    assert process.stdout is not None
    for line in process.stdout:
        try:
            said = json.loads(line)
        except ValueError:
            continue
        if "outcome" in said:
            return Outcome(**said["outcome"])
        if time.monotonic() - written >= _INTERVAL_S:
            written = time.monotonic()
            with contextlib.suppress(OSError):
                write_text(output / PROGRESS_FILE, line)
    return None


def _without_process(task: Task, state: str, sentence: str) -> Outcome:
    inputs = folder_state(Path(task.campaign))
    key = calibration_key(inputs, task.choices)
    return Outcome("crashed" if state == "crashed" else "failed", sentence, "", key, inputs)


def _starts(output: Path, run: str) -> int:
    """How often the task was started within this run of the fleet and has not come to an end."""
    try:
        said = read_json(output / _STARTS_FILE)
        return int(said["starts"]) if said.get("run") == run else 0
    except (ValueError, KeyError, TypeError, OverflowError):
        return 0


def _ending(code: int) -> str:
    if code >= 0:
        return f"exit status {code}"
    try:
        return f"signal {signal.Signals(-code).name}"
    except ValueError:
        return f"signal {-code}"


def _last_words(output: Path) -> str:
    lines = (read_bytes(output / LOG_FILE) or b"").decode("utf-8", errors="replace").strip().splitlines()
    return f": {lines[-1].strip()[:200]}" if lines else ""
