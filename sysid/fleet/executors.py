"""Where tasks run: in threads of this process that each wait for a process, or on the workers of a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager

from sysid.errors import CampaignError, OutputError
from sysid.fleet.task import PROCESSES


@contextmanager
def local_executor(workers: int) -> Iterator[Executor]:
    """Threads of this process; when it is left by an error or Ctrl-C, their processes are ended."""
    PROCESSES.stopped = False
    pool = ThreadPoolExecutor(max_workers=workers, thread_name_prefix="fleet")
    try:
        yield pool
    except BaseException:
        PROCESSES.stop()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def cluster_executor(address: str) -> Iterator[Executor]:
    """The workers of the Dask scheduler at `address`, which see the same folders as this process.

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
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise OutputError(
            f"No Dask scheduler answers at {address} ({type(error).__name__}); check the address."
        ) from error
    try:
        # Not pure: whether a task is done is decided by its hash on disk, not by its arguments.
        yield client.get_executor(pure=False)
    finally:
        client.close()
