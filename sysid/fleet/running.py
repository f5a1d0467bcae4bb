"""Runs the campaigns of a fleet side by side: nothing finished is computed again, and one failure stops no other."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from sysid.errors import CampaignError, NotConvergedError, OutputError
from sysid.fleet.executors import cluster_executor, local_executor
from sysid.fleet.memory import available_bytes
from sysid.fleet.outcome import Outcome
from sysid.fleet.records import Fleet
from sysid.fleet.task import Task, run_task
from sysid.folder_lock import FolderLock
from sysid.threads import thread_count, threads_per_worker
from sysid.wording import finish, nearest, shorten

#: Folder of the results of all campaigns below that of the fleet.
CAMPAIGNS = "campaigns"
#: Memory of one calibration before any was measured [bytes]: a three-axle truck takes two thirds of it.
TASK_BYTES = 1_500_000_000
#: How many tasks are handed over at a time, per worker: enough that none waits, few enough for any number of campaigns.
_AHEAD = 2
_POLL_S = 0.5

#: What `--retry` takes, and the states that it means.
RETRIES: Mapping[str, tuple[str, ...]] = {
    "failed": ("rejected", "failed", "crashed"),
    "not-converged": ("not converged",),
}


@dataclass(frozen=True)
class Row:
    """One campaign in the table of the fleet: `state` is that of its outcome, ``queued`` or ``running``."""

    truck: str
    type: str
    campaign: str
    date: str
    state: str
    outcome: Outcome | None = None


@dataclass(frozen=True)
class RunOptions:
    """How a fleet is run.

    - `workers`: processes at a time, None for as many as cores and memory allow;
    - `scheduler`: address of a Dask scheduler;
    - `retry` names from :data:`RETRIES`;
    - `only` names of campaigns, none for all;
    - `choices`: the options of the stages;
    - `command`: the command that calibrates, None for the program's own.
    """

    workers: int | None = None
    scheduler: str | None = None
    retry: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    choices: Mapping[str, Any] = field(default_factory=dict)
    command: tuple[str, ...] | None = None


#: Called with the rows of all campaigns whenever one of them has come to an end, and now and then.
Watch = Callable[[list[Row]], None]


def campaign_output(output: Path, name: str) -> Path:
    """Folder of the results of one campaign."""
    return output / CAMPAIGNS / name


def chosen(fleet: Fleet, names: tuple[str, ...]) -> Fleet:
    """The fleet with the named campaigns only; all of it where none is named.

    Raises
    ------
    CampaignError
        If there is no campaign of a name.
    """
    known = {campaign.name for _, campaign in fleet.campaigns()}
    for name in names:
        if name not in known:
            raise CampaignError(finish(f"The fleet has no campaign '{shorten(name)}'; {nearest(name, known)}"))
    if not names:
        return fleet
    trucks = (replace(t, campaigns=tuple(c for c in t.campaigns if c.name in names)) for t in fleet.trucks)
    return replace(fleet, trucks=tuple(t for t in trucks if t.campaigns))


def tasks(fleet: Fleet, output: Path, options: RunOptions, run: str, threads: int) -> Iterator[Task]:
    """One task per campaign, in the order of the fleet."""
    again = tuple(state for name in options.retry for state in RETRIES[name])
    for _, campaign in fleet.campaigns():
        task = Task(
            campaign.name,
            str(campaign.folder.resolve()),
            str(campaign_output(output, campaign.name).resolve()),
            dict(options.choices),
            threads,
            run,
            again,
        )
        yield task if options.command is None else replace(task, command=options.command)


def worker_count(wanted: int | None, campaigns: int) -> int:
    """Processes at a time: as wanted, else as many as cores and memory allow; no more than campaigns."""
    if wanted is None:
        wanted = min(thread_count(), max(1, available_bytes() // TASK_BYTES))
    return max(1, min(wanted, campaigns))


def run_fleet(fleet: Fleet, output: Path, options: RunOptions, watch: Watch) -> list[Row]:
    """Calibrate every campaign of a fleet into ``campaigns/NAME`` below `output`, and return what became of each.

    Raises
    ------
    CampaignError
        If a campaign of `only` is not there, or a scheduler is asked for and dask.distributed is not installed.
    OutputError
        If the folder cannot be written, another run of a fleet writes there, or the scheduler does not answer.
    """
    fleet = chosen(fleet, options.only)
    workers = worker_count(options.workers, fleet.count)
    rows = [Row(t.name, t.type, c.name, c.date, "queued") for t, c in fleet.campaigns()]
    # Single campaigns may be run side by side by somebody else's scheduler: each has the lock of its own folder.
    lock = nullcontext() if options.only else FolderLock(output)
    with lock, _executor(options, workers) as executor:
        local = options.scheduler is None
        threads = threads_per_worker(workers) if local else 1
        # With a cluster its scheduler decides who works on what; more is handed over at a time.
        ahead = workers if local else max(_AHEAD * workers, 64)
        queue = tasks(fleet, output, options, secrets.token_hex(8), threads)
        _drive(executor, enumerate(queue), rows, ahead, local, watch)
    watch(rows)
    return rows


def _executor(options: RunOptions, workers: int) -> AbstractContextManager[Executor]:
    return local_executor(workers) if options.scheduler is None else cluster_executor(options.scheduler)


def _drive(
    executor: Executor, queue: Iterable[tuple[int, Task]], rows: list[Row], ahead: int, local: bool, watch: Watch
) -> None:
    left = iter(queue)
    running: dict[Future[Outcome], int] = {}
    largest = 0
    exhausted = False
    while running or not exhausted:
        while not exhausted and len(running) < ahead and (not local or _room(largest, len(running))):
            number, task = next(left, (-1, None))
            if task is None:
                exhausted = True
                break
            running[executor.submit(run_task, task)] = number
            rows[number] = replace(rows[number], state="running")
        if not running:
            continue
        done, _ = wait(running, timeout=_POLL_S, return_when=FIRST_COMPLETED)
        for future in done:
            number = running.pop(future)
            outcome = _outcome(future)
            largest = max(largest, outcome.peak_bytes)
            rows[number] = replace(rows[number], state=outcome.state, outcome=outcome)
        watch(rows)


def _room(largest: int, running: int) -> bool:
    """Whether memory is left for one more process, as large as the largest so far; for one there always is."""
    return running == 0 or available_bytes() > (largest or TASK_BYTES // 2)


def _outcome(future: Future[Outcome]) -> Outcome:
    error = future.exception()
    if error is None:
        return future.result()
    # A scheduler gives up on a task whose workers die again and again.
    return Outcome("crashed", f"its worker was lost ({type(error).__name__}: {str(error)[:200]})")


def exit_code(rows: Iterable[Row]) -> int:
    """0 where every campaign has converged or is a preview, 3 where one has no result, 4 where one is not converged."""
    states = {row.state for row in rows}
    if states - {"done", "not converged"}:
        return OutputError.exit_code
    return NotConvergedError.exit_code if "not converged" in states else 0
