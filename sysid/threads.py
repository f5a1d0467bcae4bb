"""How many threads this process uses, said once for all that computes side by side.

``SYSID_THREADS`` sets the number; without it there are as many as the process may use cores.  They belong to the groups
of runs and to the native engine; the linear algebra library gets one (:func:`one_blas_thread`).  Processes that compute
side by side share them (:func:`threads_per_worker`).
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import lru_cache
from typing import TYPE_CHECKING, TypeVar

from sysid.errors import SysidError

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def thread_count() -> int:
    """Threads that this process may keep busy.

    Raises
    ------
    SysidError
        If SYSID_THREADS is not a positive integer.
    """
    wanted = os.environ.get("SYSID_THREADS", "")
    if wanted:
        if not (wanted.isascii() and wanted.isdigit()) or int(wanted) < 1:
            raise SysidError(f"SYSID_THREADS is '{wanted}'; set it to the number of threads to use, 1 or more.")
        return int(wanted)
    return _usable_cores()


def threads_per_worker(workers: int) -> int:
    """Threads of each of several processes that compute at the same time: together no more than there may be."""
    return max(1, thread_count() // max(workers, 1))


def _usable_cores() -> int:
    """Cores that this process may use: a batch system or a container often leaves it fewer than there are."""
    if hasattr(os, "sched_getaffinity"):
        return max(1, len(os.sched_getaffinity(0)))
    return os.cpu_count() or 1


def side_by_side(
    function: Callable[[_Item], _Result], items: Iterable[_Item], at_most: int | None = None
) -> tuple[_Result, ...]:
    """Results of a function for all items, in their order, by as many threads as there may be, or `at_most`."""
    work = tuple(items)
    workers = min(thread_count(), len(work), at_most or len(work))
    if workers <= 1:
        return tuple(map(function, work))
    # Work inside of work, however deep, does not wait for the threads that wait for it.
    inside = getattr(_OF_THREAD, "inside", False)
    if inside or workers < min(thread_count(), len(work)):
        with ThreadPoolExecutor(max_workers=workers, initializer=_begin, initargs=(inside,)) as pool:
            return tuple(pool.map(function, work))
    return tuple(_kept_pool(thread_count(), os.getpid()).map(function, work))


def in_threads_of_their_own(
    function: Callable[[_Item], _Result], items: Iterable[_Item], stop: Callable[[], None]
) -> tuple[_Result, ...]:
    """Results of a function for all items, in their order, all under way at the same time: they may wait for others.

    Parameters
    ----------
    stop : ends what they wait for, called where this thread is interrupted.
    """
    work = tuple(items)
    with ThreadPoolExecutor(max_workers=len(work), initializer=_begin, initargs=(True,)) as pool:
        try:
            return tuple(pool.map(function, work))
        except BaseException:
            stop()
            raise


#: Whether this thread is one of those that are kept, or works for one of them.
_OF_THREAD = threading.local()


def _begin(inside: bool) -> None:
    _OF_THREAD.inside = inside


@lru_cache(maxsize=1)
def _kept_pool(workers: int, process: int) -> ThreadPoolExecutor:
    """Threads that stay: a fit works side by side thousands of times, and to start threads takes some milliseconds.

    A process has its own: the threads of its parent are not in it.
    """
    return ThreadPoolExecutor(max_workers=workers, thread_name_prefix="sysid", initializer=_begin, initargs=(True,))


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """While it lasts linear algebra runs in one thread; as decorator of a function, while that runs.

    Matrices here have tens of columns: more threads spin for each other on the cores that the engine wants, and a
    least-squares step takes twice as long on two cores.
    """
    with _libraries("scipy.linalg" in sys.modules).limit(limits=1, user_api="blas"):
        yield


@lru_cache
def _libraries(with_scipy: bool) -> ThreadpoolController:
    """The libraries that are loaded by now: NumPy has its own, SciPy brings another when it is first used."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
