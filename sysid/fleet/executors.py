"""Where tasks run: in threads of this process that each wait for a process, or on the workers of a Dask cluster."""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager, suppress

from sysid.errors import CampaignError, OutputError
from sysid.fleet.task import PROCESSES


@contextmanager
def local_executor(workers: int) -> Iterator[tuple[Executor, int]]:
    """Threads of this process, and their number; when it is left by an error or Ctrl-C, their processes are ended."""
    PROCESSES.stopped = False
    pool = ThreadPoolExecutor(max_workers=workers, thread_name_prefix="fleet")
    try:
        yield pool, workers
    except BaseException:
        PROCESSES.stop()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def cluster_executor(address: str, patience_s: float = 0.0) -> Iterator[tuple[Executor, int]]:
    """The workers of the Dask scheduler at `address`, and how many threads they have.

    Parameters
    ----------
    patience_s : how long to wait for a scheduler that was lost [s].

    Raises
    ------
    CampaignError
        If dask.distributed is not installed.
    OutputError
        If the scheduler does not answer.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise CampaignError(
            "--scheduler needs dask.distributed; install it by pip install 'sysid[cluster]'."
        ) from error
    end = time.monotonic() + patience_s
    while True:
        try:
            client = Client(address, timeout="10s")
            break
        except (OSError, ValueError) as error:
            if time.monotonic() > end:
                raise _no_scheduler(address, error, lost=patience_s > 0.0) from error
            time.sleep(1.0)
    try:
        # Not pure: whether a task is done is decided by its hash on disk, not by its arguments.
        yield client.get_executor(pure=False), max(1, sum(client.nthreads().values()))
    finally:
        # A client waits for a scheduler that is gone.
        with suppress(Exception):
            client.close(timeout=5)


def _no_scheduler(address: str, error: Exception, lost: bool) -> OutputError:
    if lost:
        return OutputError(
            f"The Dask scheduler at {address} was lost and does not answer again; what is done is kept. Start it and "
            "give the same command."
        )
    return OutputError(f"No Dask scheduler answers at {address} ({type(error).__name__}); check the address.")
