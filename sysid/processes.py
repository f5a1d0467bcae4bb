"""Work shared with a second process, where Python's lock would let threads wait for each other.

Reading plank drops and drawing figures is Python code: two threads would take turns.  While a stage asks for it
(:func:`helped_by`), a helper process does a part of its work.  It ends with the stage, so that its memory does not add
to that of others.
"""

from __future__ import annotations

import importlib
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, TypeVar

from sysid.threads import thread_count

if TYPE_CHECKING:
    from concurrent.futures import Future

    from loky import ProcessPoolExecutor

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

#: Items that the helper has before it: one that it works on, and the next.
_AHEAD = 2
#: The helper leaves after so many seconds without work, because its parent may have been killed; more work starts it
#: anew.
_IDLE_S = 10.0
#: Its linear algebra runs in one thread, as that of its parent does.
_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1")


class _Kept:
    """The helper of this process, None while there is none."""

    helper: ProcessPoolExecutor | None = None


@contextmanager
def helped_by(module: str | None) -> Iterator[None]:
    """While it lasts :func:`shared_with_helper` has a helper, which begins to import `module`; None for no helper."""
    if module is None:
        yield
        return
    begin_helper(module)
    with no_helper_afterwards():
        yield


@contextmanager
def no_helper_afterwards() -> Iterator[None]:
    """End a helper that was started ahead of work that never came."""
    try:
        yield
    finally:
        end_helper()


def begin_helper(module: str | None) -> None:
    """Start the helper, if there is none, so that it has imported `module` when it is needed.

    Nothing happens where there is one core, or where no process can be started.
    """
    if module is None or _Kept.helper is not None or thread_count() < 2:
        return
    # No semaphores, no processes, no memory: whatever keeps it from starting, the work is done without it.
    with suppress(Exception), _interrupts_held():
        # It starts Python anew: a fork of a process with threads can hang, and scripts need no guard as with `spawn`.
        from loky import ProcessPoolExecutor

        helper = ProcessPoolExecutor(max_workers=1, timeout=_IDLE_S, env=_ONE_THREAD)
        helper.submit(importlib.import_module, module)
        _Kept.helper = helper


def end_helper() -> None:
    """End the helper, if there is one."""
    helper, _Kept.helper = _Kept.helper, None
    if helper is not None:
        # Nobody waits for its end, which takes half a second.
        helper.shutdown(wait=False, kill_workers=True)


def shared_with_helper(function: Callable[[_Item], _Result], items: Iterable[_Item]) -> tuple[_Result, ...]:
    """Results of a function for all items, in their order, some of them computed by the helper process if there is one.

    This process takes items from the front, the helper from the end.  What the helper fails to compute is computed
    here: no result depends on who did it.

    Parameters
    ----------
    function : a function of a module; what it takes and returns can be pickled.
    """
    work, helper = tuple(items), _Kept.helper
    results: dict[int, _Result] = {}
    left, given = deque(range(len(work))), deque[tuple[int, "Future[_Result]"]]()
    while left:
        while given and given[0][1].done():
            _receive(given.popleft(), results)
        # The last item is not worth the wait for another process.
        while helper is not None and len(given) < _AHEAD and len(left) > 1:
            number = left.pop()
            try:
                with _interrupts_held():
                    given.append((number, helper.submit(function, work[number])))
            except Exception:
                # It has failed, or was ended by another thread.
                left.append(number)
                helper = None
        number = left.popleft()
        results[number] = function(work[number])
    while given:
        _receive(given.popleft(), results)
    for number in set(range(len(work))) - set(results):
        # The helper failed: if the item is at fault, its error comes from here.
        results[number] = function(work[number])
    return tuple(results[number] for number in range(len(work)))


def _receive(given: tuple[int, Future[_Result]], results: dict[int, _Result]) -> None:
    with suppress(Exception):
        results[given[0]] = given[1].result()


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """What is started meanwhile inherits that it does not hear Ctrl-C: this process alone decides what ends."""
    if not hasattr(signal, "pthread_sigmask") or threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
