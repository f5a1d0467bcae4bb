"""The number of threads: the setting, the cores that the process may use, and that work keeps its order."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time

import pytest
import scipy.linalg  # noqa: F401
from threadpoolctl import threadpool_info, threadpool_limits

from sysid import threads
from sysid.errors import SysidError


def test_the_setting_counts(monkeypatch):
    monkeypatch.setenv("SYSID_THREADS", "7")
    assert threads.thread_count() == 7


@pytest.mark.parametrize("text", ["0", "-2", "two", "1.5", "²"])
def test_a_setting_that_is_no_number_is_refused(monkeypatch, text):
    monkeypatch.setenv("SYSID_THREADS", text)
    with pytest.raises(SysidError, match=f"SYSID_THREADS is '{text}'; set it to the number of threads"):
        threads.thread_count()


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="cores cannot be assigned on this system")
def test_without_it_the_cores_that_the_process_may_use():
    code = (
        "import os; from sysid.threads import thread_count\n"
        "every = sorted(os.sched_getaffinity(0)); print(thread_count() == len(every))\n"
        "os.sched_setaffinity(0, every[:1]); print(thread_count() == 1)"
    )
    environment = {k: v for k, v in os.environ.items() if k != "SYSID_THREADS"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "True"]


@pytest.mark.parametrize(("count", "at_most", "expected"), [("3", None, 3), ("3", 2, 2), ("1", None, 1)])
def test_so_many_work_at_once_and_results_keep_their_order(monkeypatch, count, at_most, expected):
    """All that may be at work wait for each other; one more would be seen."""
    monkeypatch.setenv("SYSID_THREADS", count)
    barrier, lock, running, most = threading.Barrier(expected), threading.Lock(), [0], [0]

    def work(item: int) -> int:
        with lock:
            running[0] += 1
            most[0] = max(most[0], running[0])
        barrier.wait(timeout=30.0)
        time.sleep(0.1)
        with lock:
            running[0] -= 1
        return item * item

    items = range(2 * expected * (1 if expected > 1 else 2))
    assert threads.side_by_side(work, items, at_most=at_most) == tuple(i * i for i in items)
    assert most[0] == expected


def test_the_same_threads_work_again(monkeypatch):
    monkeypatch.setenv("SYSID_THREADS", "2")
    barrier = threading.Barrier(2)

    def who(_: int) -> int:
        barrier.wait(timeout=30.0)
        return threading.get_ident()

    first, second = (set(threads.side_by_side(who, range(2))) for _ in range(2))
    assert first == second
    assert len(first) == 2


#: Groups of runs, draws of each, axles of each road: every level asks for the next. Threads that wait for each other
#: would wait for ever, so a process of its own does it.
NESTED = """
import threading
from sysid.threads import side_by_side
begun = threading.Barrier(2)
def nested(depth, at=()):
    if not depth:
        return [at]
    if len(at) == 1:
        begun.wait(timeout=30.0)  # both kept threads are taken
    return [a for part in side_by_side(lambda i: nested(depth - 1, (*at, i)), range(2)) for a in part]
print(nested(4) == [(a, b, c, d) for a in (0, 1) for b in (0, 1) for c in (0, 1) for d in (0, 1)])
"""


def test_work_inside_of_work_ends_however_deep():
    environment = {**os.environ, "SYSID_THREADS": "2"}
    command = [sys.executable, "-c", NESTED]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True, timeout=60.0)
    assert done.stdout.strip() == "True"


def test_an_error_of_one_ends_the_call_and_not_the_threads(monkeypatch):
    monkeypatch.setenv("SYSID_THREADS", "2")

    def work(i: int) -> int:
        if i == 1:
            raise ValueError("one of them")
        return i

    with pytest.raises(ValueError, match="one of them"):
        threads.side_by_side(work, range(4))
    assert threads.side_by_side(abs, range(4)) == (0, 1, 2, 3)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_a_forked_process_has_threads_of_its_own():
    code = (
        "import os; from sysid.threads import side_by_side\n"
        "side_by_side(abs, range(4)); child = os.fork()\n"
        "if child == 0: os._exit(sum(side_by_side(abs, range(4))))\n"
        "print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))"
    )
    environment = {**os.environ, "SYSID_THREADS": "2", "PYTHONWARNINGS": "ignore"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.split() == ["6"]


def blas_threads() -> set[int]:
    """Threads of every linear algebra library that is loaded: NumPy's and SciPy's."""
    return {found["num_threads"] for found in threadpool_info() if found["user_api"] == "blas"}


def test_linear_algebra_has_one_thread_while_we_compute_and_its_own_number_again_afterwards():
    @threads.one_blas_thread()
    def inside() -> set[int]:
        return blas_threads()

    with threadpool_limits(limits=2, user_api="blas"):
        assert blas_threads() == {2}
        assert inside() == {1}
        assert blas_threads() == {2}
