"""Where tasks run: in threads of this process that each wait for a process, or on the workers of a Dask cluster."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from typing import Any

from sysid.errors import CampaignError, OutputError
from sysid.fleet.task import PROCESSES

#: How long a result may take on its way from a worker [s].
_TRANSFER_S = 600.0
#: How often the number of workers is asked for [s].
_ASKED_S = 5.0


class LocalWorkers(ThreadPoolExecutor):
    """Threads of this process."""

    def __init__(self, workers: int):
        super().__init__(max_workers=workers, thread_name_prefix="fleet")
        self._workers = workers

    def size(self) -> int:
        """Their number."""
        return self._workers


class ClusterWorkers(Executor):
    """The workers of a Dask scheduler; whatever happens to the scheduler, every future comes to an end."""

    def __init__(self, client: Any):
        self._client, self._size, self._asked = client, 0, float("-inf")

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """A future of the task; cancelled if it is lost with the scheduler."""
        future: Future[Any] = Future()
        future.set_running_or_notify_cancel()
        try:
            # Not pure: whether a task is done is decided by its hash on disk, not by its arguments.
            remote = self._client.submit(fn, *args, pure=False, **kwargs)
        except Exception:
            # A client that has lost its scheduler for long closes itself.
            future.set_exception(CancelledError())
            return future
        remote.add_done_callback(lambda done: _ended(done, future))
        return future

    def size(self) -> int:
        """Threads of all workers, as last heard."""
        if time.monotonic() - self._asked > _ASKED_S:
            self._asked = time.monotonic()
            try:
                self._size = sum(self._client.nthreads().values())
            except Exception:
                # It does not answer now; if it is gone for good, its client cancels what waits.
                self._size = 0
        return self._size


def _ended(remote: Any, future: Future[Any]) -> None:
    """Hand on how a task of the cluster ended; its result is fetched here, in a thread of Dask's."""
    try:
        if remote.status == "error":
            future.set_exception(remote.exception(timeout=_TRANSFER_S))
        elif remote.status == "finished":
            future.set_result(remote.result(timeout=_TRANSFER_S))
        else:
            future.set_exception(CancelledError())
    except BaseException:
        # The scheduler went while the result was on its way.  That of asyncio is no Exception, and a future that is
        # left open would be waited for without end.
        future.set_exception(CancelledError())


@contextmanager
def local_executor(workers: int) -> Iterator[LocalWorkers]:
    """Threads of this process; when it is left by an error or Ctrl-C, their processes are ended."""
    PROCESSES.stopped = False
    pool = LocalWorkers(workers)
    try:
        yield pool
    except BaseException:
        PROCESSES.stop()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def cluster_executor(address: str, patience_s: float = 0.0) -> Iterator[ClusterWorkers]:
    """The workers of the Dask scheduler at `address`.

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
            "--scheduler needs dask.distributed; install it by pip install 'truck-sysid[cluster]'."
        ) from error
    end = time.monotonic() + patience_s
    while True:
        try:
            client = Client(address, timeout="10s")
            break
        except (OSError, ValueError, TypeError) as error:
            # The last where the address is one of TLS and there is no certificate.
            if time.monotonic() > end:
                raise _no_scheduler(address, error, lost=patience_s > 0.0) from error
            time.sleep(1.0)
    try:
        yield ClusterWorkers(client)
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
    what = "the address and the certificates of Dask" if address.startswith("tls:") else "the address"
    return OutputError(f"No Dask scheduler answers at {address} ({type(error).__name__}); check {what}.")
