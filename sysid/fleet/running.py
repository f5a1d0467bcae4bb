"""Runs the campaigns of a fleet side by side: nothing finished is computed again, and one failure stops no other."""

from __future__ import annotations

import os
import secrets
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.cell_progress import watched_cell
from sysid.errors import CampaignError, NotConvergedError, OutputError
from sysid.files import keep_inside
from sysid.fleet.executors import cluster_executor, local_executor
from sysid.fleet.memory import available_bytes
from sysid.fleet.outcome import Outcome
from sysid.fleet.records import Fleet
from sysid.fleet.sent_files import SendingExecutor
from sysid.fleet.task import Task, run_task
from sysid.folder_lock import FolderLock
from sysid.numbers import count, listing
from sysid.progress import Progress
from sysid.threads import thread_count, threads_per_worker
from sysid.wording import finish, nearest, shorten

if TYPE_CHECKING:
    from sysid.fleet.population_prior import PopulationPrior

#: Folder of the results of all campaigns below that of the fleet.
CAMPAIGNS = "campaigns"
#: Memory of one calibration before any was measured [bytes]: a three-axle truck takes two thirds of it.
TASK_BYTES = 1_500_000_000
#: How many tasks are handed over at a time, per worker: enough that none waits, few enough for any number of campaigns.
_AHEAD = 2
#: Time between two looks at the running tasks [s].
_POLL_S = 0.5
#: How long to wait for a scheduler that was lost [s].
LOST_S = 120.0
#: A scheduler that is lost so often in a row, without any campaign coming to its end, is not given the same again.
_MOST_LOST = 3

#: What `--retry` takes, and the states that it means.
RETRIES: Mapping[str, tuple[str, ...]] = {
    "failed": ("rejected", "failed", "crashed"),
    "not-converged": ("not converged",),
}


@dataclass(frozen=True)
class Row:
    """One campaign in the table of the fleet: `state` is that of its outcome, ``queued`` or ``running``.

    `missing` names input files of finished campaigns that cannot be read.
    """

    truck: str
    type: str
    campaign: str
    date: str
    state: str
    outcome: Outcome | None = None
    missing: tuple[str, ...] = ()


@dataclass(frozen=True)
class RunOptions:
    """How a fleet is run.

    - `workers`: processes at a time, None for as many as cores and memory allow;
    - `scheduler`: address of a Dask scheduler;
    - `send_files`: its workers do not see the folders of this machine, so files are sent to them and back;
    - `retry` names from :data:`RETRIES`;
    - `only` names of campaigns, none for all;
    - `choices`: the options of the stages;
    - `command`: the command that calibrates, None for the program's own.
    """

    workers: int | None = None
    scheduler: str | None = None
    send_files: bool = False
    retry: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    choices: Mapping[str, Any] = field(default_factory=dict)
    command: tuple[str, ...] | None = None


#: Called with the rows of all campaigns whenever one of them has come to an end, and now and then.
Watch = Callable[[list[Row]], None]


def campaign_output(output: Path, name: str) -> Path:
    """Folder of the results of one campaign; links below the folder of the fleet are not followed."""
    keep_inside(output)
    return output / CAMPAIGNS / name


def with_campaigns(fleet: Fleet, names: tuple[str, ...]) -> Fleet:
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
            os.path.abspath(campaign_output(output, campaign.name)),
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


def run_fleet(fleet: Fleet, output: Path, options: RunOptions, watch: Watch | None = None) -> list[Row]:
    """Calibrate every campaign of a fleet into ``campaigns/NAME`` below `output`, and return what became of each.

    Parameters
    ----------
    watch : callback for the rows of all campaigns; without one a notebook shows a line below its cell.

    Raises
    ------
    CampaignError
        If a campaign of `only` is not there, or a scheduler is asked for and dask.distributed is not installed.
    OutputError
        If the folder cannot be written, another run of a fleet writes there, or the scheduler does not answer.
    """
    fleet = with_campaigns(fleet, options.only)
    # Single campaigns may be run side by side by somebody else's scheduler: each has the lock of its own folder.
    with nullcontext() if options.only else FolderLock(output), watched_cell([count(fleet.count, "campaign")]) as line:
        seen = watch or (lambda rows: _say(rows, line))
        return _run_tasks(fleet, partial(tasks, fleet, output, options), options, seen)


def _say(rows: list[Row], line: Progress) -> None:
    """How many campaigns have ended, and which are running."""
    ended = sum(row.outcome is not None for row in rows)
    running = listing([row.campaign for row in rows if row.state == "running"], 4)
    line(f"{ended} of {count(len(rows), 'campaign')}" + (f", running {running}" if running else ""), ended / len(rows))


def recalibrate(
    fleet: Fleet, output: Path, priors: Mapping[str, PopulationPrior], options: RunOptions, watch: Watch
) -> list[Row]:
    """Sample finished campaigns of a fleet once more under `priors` by name, and return what became of each.

    Raises
    ------
    OutputError
        If the folder cannot be written, another run of a fleet writes there, or the scheduler does not answer.
    """
    fleet = with_campaigns(fleet, tuple(priors))

    def again(run: str, threads: int) -> Iterator[Task]:
        return (replace(t, prior=priors[t.name].as_dict()) for t in tasks(fleet, output, options, run, threads))

    with FolderLock(output):
        return _run_tasks(fleet, again, options, watch)


def _run_tasks(
    fleet: Fleet, tasks_of: Callable[[str, int], Iterable[Task]], options: RunOptions, watch: Watch
) -> list[Row]:
    """Run one task per campaign to its end; `tasks_of` makes them for a run and a number of threads.

    If the scheduler of a cluster is lost, its tasks are handed to the next one that answers at its address.
    """
    rows = [Row(t.name, t.type, c.name, c.date, "queued") for t, c in fleet.campaigns()]
    address = options.scheduler
    if address is None:
        workers = worker_count(options.workers, fleet.count)
        with local_executor(workers) as pool:
            _drive(pool, pool.size, enumerate(tasks_of(_new_run(), threads_per_worker(workers))), rows, options, watch)
        watch(rows)
        return rows
    patience, without_outcome = 0.0, 0
    while any(row.outcome is None for row in rows):
        before = sum(row.outcome is not None for row in rows)
        with cluster_executor(address, patience) as cluster:
            # Being lost with a scheduler does not count against a task: every attempt is a run of its own.
            left = ((n, t) for n, t in enumerate(tasks_of(_new_run(), 1)) if rows[n].outcome is None)
            executor = SendingExecutor(cluster) if options.send_files else cluster
            _drive(executor, cluster.size, left, rows, options, watch)
        patience = LOST_S
        without_outcome = without_outcome + 1 if sum(row.outcome is not None for row in rows) == before else 0
        if without_outcome == _MOST_LOST:
            raise OutputError(
                f"The Dask scheduler at {address} was lost {_MOST_LOST} times before a campaign ended; look at its "
                "memory and its log. What is done is kept, and the same command goes on."
            )
    watch(rows)
    return rows


def _new_run() -> str:
    return secrets.token_hex(8)


def _drive(
    executor: Executor,
    size: Callable[[], int],
    queue: Iterator[tuple[int, Task]],
    rows: list[Row],
    options: RunOptions,
    watch: Watch,
) -> None:
    """Hand tasks over and wait for their outcomes, until all are done or the scheduler is lost."""
    running: dict[Future[Outcome], int] = {}
    largest, exhausted, seen = 0, False, time.monotonic()
    while running or not exhausted:
        workers = size()
        if workers == 0 and time.monotonic() - seen > LOST_S:
            raise OutputError(
                f"The Dask scheduler at {options.scheduler} has no workers; what is done is kept. Start some and give "
                "the same command."
            )
        seen = time.monotonic() if workers else seen
        while not exhausted and len(running) < _ahead(workers, options) and _room(largest, len(running), options):
            number, task = next(queue, (-1, None))
            if task is None:
                exhausted = True
                break
            running[executor.submit(run_task, task)] = number
            rows[number] = replace(rows[number], state="running")
        if running:
            done, _ = wait(running, timeout=_POLL_S, return_when=FIRST_COMPLETED)
        else:
            done = set()
            time.sleep(0.0 if exhausted else _POLL_S)
        for future in done:
            number = running.pop(future)
            outcome = _outcome(future)
            if outcome is None:
                rows[number] = replace(rows[number], state="queued")
                exhausted = True
                continue
            largest = max(largest, outcome.peak_bytes)
            rows[number] = replace(rows[number], state=outcome.state, outcome=outcome)
        watch(rows)


def _ahead(workers: int, options: RunOptions) -> int:
    """How many tasks are handed over at a time: a scheduler gets more than its workers take, but files take memory."""
    if options.scheduler is None:
        return workers
    return _AHEAD * workers if options.send_files else max(_AHEAD * workers, 64)


def _room(largest: int, running: int, options: RunOptions) -> bool:
    """Whether memory is left here for one more process, as large as the largest so far; for one there always is."""
    return options.scheduler is not None or running == 0 or available_bytes() > (largest or TASK_BYTES // 2)


def _outcome(future: Future[Outcome]) -> Outcome | None:
    """The outcome of a task; None if it was lost with its scheduler."""
    try:
        error = future.exception()
    except CancelledError:
        return None
    if error is None:
        return future.result()
    if isinstance(error, CancelledError):
        return None
    # A scheduler gives up on a task whose workers die again and again.
    return Outcome("crashed", f"its worker was lost ({type(error).__name__}: {str(error)[:200]})")


def exit_code(rows: Iterable[Row]) -> int:
    """0 where every campaign has converged or is a preview, 3 where one has no result, 4 where one is not converged."""
    states = {row.state for row in rows}
    if states - {"done", "not converged"}:
        return OutputError.exit_code
    return NotConvergedError.exit_code if "not converged" in states else 0
