"""Work shared with a second process, where Python's lock would let threads wait for each other.

Reading plank drops and drawing figures is Python code: two threads would take turns.  While a stage asks for it
(:func:`helped_by`), a helper process does a part of its work (:mod:`sysid.helper_child`).  It ends with the stage, so
that its memory does not add to that of others.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

from sysid.runtime import OBJECTS_PER_COLLECTION
from sysid.threads import thread_count

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

_CHILD = Path(__file__).with_name("helper_child.py")
#: Items that the helper has before it: one that it works on, and the next.
_AHEAD = 2
#: How long an answer is waited for [s], and that many times what the longest item took here: the helper may be slower,
#: or begin with imports.
_PATIENCE_S, _PATIENCE = 5.0, 10.0
#: It keeps one core busy, also in the linear algebra.
_ONE_THREAD = dict.fromkeys(("SYSID_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1")


class _Helper:
    """A Python process that computes one item after the other, and the thread that talks to it."""

    def __init__(self, modules: Sequence[str]):
        # It starts Python anew, because a fork of a process with threads can hang. Nobody needs what it prints, at
        # Ctrl-C for one: what it fails to do is done here.
        self._process = subprocess.Popen(
            [sys.executable, "-P", str(_CHILD)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **_ONE_THREAD},
        )
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="sysid_helper")
        self._thread.submit(self._write, (sys.path, tuple(modules), OBJECTS_PER_COLLECTION))

    def submit(self, function: Callable[[_Item], _Result], item: _Item) -> Future[_Result]:
        """The coming result of a function for an item; an error says only that there is none."""
        return self._thread.submit(self._asked, function, item)

    def end(self) -> None:
        """End the process; what it has not done is lost."""
        self._process.kill()
        self._process.wait()
        self._thread.shutdown(cancel_futures=True)
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            # What stands in the buffer of a pipe that nobody reads cannot be written.
            with suppress(OSError):
                stream.close()

    def _asked(self, function: Callable[[_Item], _Result], item: _Item) -> _Result:
        self._write((function, item))
        assert self._process.stdout is not None
        try:
            done, result = pickle.load(self._process.stdout)
        except Exception:
            # What comes next could be taken for the answer to another question.
            self._process.kill()
            raise
        if not done:
            raise RuntimeError("the helper process could not compute an item")
        answer: _Result = result
        return answer

    def _write(self, request: Any) -> None:
        # Whole or not at all: what cannot be pickled must not leave a half of it in the pipe.
        content = pickle.dumps(request)
        assert self._process.stdin is not None
        self._process.stdin.write(content)
        self._process.stdin.flush()


class _Kept:
    """The helper of this process, None while there is none."""

    helper: _Helper | None = None


@contextmanager
def helped_by(modules: Sequence[str]) -> Iterator[None]:
    """While it lasts :func:`shared_with_helper` has a helper, which begins to import `modules`; none for no helper."""
    if not modules:
        yield
        return
    begin_helper(modules)
    try:
        yield
    finally:
        end_helper()


@contextmanager
def no_helper_after_failure() -> Iterator[None]:
    """Where something fails, end the helper that was started ahead: the work for it does not come."""
    try:
        yield
    except BaseException:
        end_helper()
        raise


def begin_helper(modules: Sequence[str]) -> None:
    """Start the helper, if there is none, so that it has imported `modules` when it is needed.

    Nothing happens where there is one core, or where no process can be started.
    """
    if not modules or _Kept.helper is not None or thread_count() < 2:
        return
    # No memory, no further process, no interpreter: whatever keeps it from starting, the work is done without it.
    with suppress(Exception):
        _Kept.helper = _Helper(modules)


def end_helper() -> None:
    """End the helper, if there is one."""
    helper, _Kept.helper = _Kept.helper, None
    if helper is not None:
        helper.end()


def shared_with_helper(
    function: Callable[[_Item], _Result], items: Iterable[_Item], done: Callable[[float], None] = lambda share: None
) -> tuple[_Result, ...]:
    """Results of a function for all items, in their order, some of them computed by the helper process if there is one.

    This process takes items from the front, the helper from the end.  What the helper fails to compute is computed
    here: no result depends on who did it.

    Parameters
    ----------
    function : a function of a module; what it takes and returns can be pickled.
    done : callback (share of the items that are done), after every item of this process.
    """
    work, helper = tuple(items), _Kept.helper
    results: dict[int, _Result] = {}
    longest = 0.0
    left, given = deque(range(len(work))), deque[tuple[int, Future[_Result]]]()
    while left:
        while given and given[0][1].done():
            _receive(given.popleft(), results, 0.0)
        # The last item is not worth the wait for another process.
        while helper is not None and len(given) < _AHEAD and len(left) > 1:
            number = left.pop()
            try:
                given.append((number, helper.submit(function, work[number])))
            except RuntimeError:
                # Another thread has ended it.
                left.append(number)
                helper = None
        number = left.popleft()
        begun = time.monotonic()
        results[number] = function(work[number])
        longest = max(longest, time.monotonic() - begun)
        done(len(results) / len(work))
    while given:
        # What it has not begun is taken back.
        if len(given) > 1 and given[-1][1].cancel():
            number, _ = given.pop()
            results[number] = function(work[number])
        elif not _receive(given.popleft(), results, _PATIENCE_S + _PATIENCE * longest) and _Kept.helper is helper:
            # It is stopped, or starved: what it owes is done here, and it is asked no more.
            end_helper()
    for number in set(range(len(work))) - set(results):
        # The helper failed: if the item is at fault, its error comes from here.
        results[number] = function(work[number])
    return tuple(results[number] for number in range(len(work)))


def _receive(given: tuple[int, Future[_Result]], results: dict[int, _Result], patience_s: float) -> bool:
    """Take what the helper has computed; False if it has said nothing for so long."""
    wait([given[1]], patience_s)
    # A cancelled future raises what is no Exception.
    with suppress(Exception, CancelledError):
        if given[1].done():
            results[given[0]] = given[1].result()
    return given[1].done()
