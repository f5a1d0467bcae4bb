"""Work shared with a helper process: the same results whoever computes, also where the helper fails or is missing."""

import os
import signal
import subprocess
import sys
import time

import pytest

from sysid import helper_process
from sysid.errors import DataRejectedError
from sysid.helper_process import begin_helper, end_helper, helped_by, no_helper_after_failure, shared_with_helper


@pytest.fixture(autouse=True)
def two_threads(monkeypatch):
    monkeypatch.setenv("SYSID_THREADS", "2")
    yield
    end_helper()


def process_of(_):
    time.sleep(0.05)
    return os.getpid()


def process_and_threads(_):
    time.sleep(0.05)
    return os.getpid(), os.environ.get("OPENBLAS_NUM_THREADS")


def process_and_modules(_):
    time.sleep(0.05)
    return os.getpid(), tuple(name for name in ("colorsys", "wave") if name in sys.modules)


def slow_elsewhere(parent):
    if os.getpid() != parent:
        time.sleep(0.5)
    return os.getpid()


def square(x):
    return x * x


def dies_elsewhere(parent):
    if os.getpid() != parent:
        os._exit(1)
    return parent


def says(x):
    sys.stdout.write("a library's remark\n")
    sys.stdout.flush()
    time.sleep(0.05)
    return os.getpid()


def at_an_end(parent):
    if os.getpid() != parent:
        raise EOFError
    return os.getpid()


def fails(x):
    if x == 3:
        raise DataRejectedError("the third file is broken.")
    return x


def test_without_a_helper_this_process_computes():
    assert set(shared_with_helper(process_of, range(4))) == {os.getpid()}


def test_both_processes_work_and_results_keep_their_order():
    with helped_by(("math",)):
        first = shared_with_helper(process_of, range(40))
        squares = shared_with_helper(square, range(100))
    assert len(set(first)) == 2
    assert os.getpid() in first
    # From the front here, from the end there.
    mine = [p == os.getpid() for p in first]
    assert mine == sorted(mine, reverse=True)
    assert squares == tuple(x * x for x in range(100))


def test_what_the_helper_has_not_begun_is_taken_back():
    with helped_by(("math",)):
        done_by = shared_with_helper(slow_elsewhere, [os.getpid()] * 3)
    assert [process == os.getpid() for process in done_by] == [True, True, False]


def test_the_helper_has_its_modules_before_it_is_asked():
    with helped_by(("colorsys", "no_such_module", "wave")):
        seen = shared_with_helper(process_and_modules, range(40))
    assert {modules for process, modules in seen if process != os.getpid()} == {("colorsys", "wave")}


def test_linear_algebra_of_the_helper_runs_in_one_thread(monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    with helped_by(("math",)):
        seen = shared_with_helper(process_and_threads, range(40))
    assert {threads for process, threads in seen if process != os.getpid()} == {"1"}


def test_the_helper_ends_with_the_stage():
    with helped_by(("math",)):
        pids = set(shared_with_helper(process_of, range(40))) - {os.getpid()}
    (helper,) = pids
    # A process that has ended and was waited for has no entry any more.
    for _ in range(100):
        try:
            os.kill(helper, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    pytest.fail("the helper is still there")


def test_what_a_helper_that_dies_had_to_do_is_done_here():
    with helped_by(("math",)):
        assert shared_with_helper(dies_elsewhere, [os.getpid()] * 20) == (os.getpid(),) * 20


def test_an_item_that_raises_the_error_of_an_ended_pipe_does_not_end_the_helper():
    with helped_by(("math",)):
        assert shared_with_helper(at_an_end, [os.getpid()] * 6) == (os.getpid(),) * 6
        assert len(set(shared_with_helper(process_of, range(40)))) == 2


def test_an_error_in_an_item_is_raised_as_it_is():
    with helped_by(("math",)), pytest.raises(DataRejectedError, match="the third file is broken"):
        shared_with_helper(fails, range(4))


def test_what_cannot_be_sent_is_done_here():
    with helped_by(("math",)):
        locked = [__import__("threading").Lock() for _ in range(6)]
        assert shared_with_helper(type, locked) == (type(locked[0]),) * 6


def test_what_the_helper_prints_is_not_taken_for_an_answer():
    with helped_by(("math",)):
        assert len(set(shared_with_helper(says, range(40)))) == 2


def test_a_helper_whose_answers_cannot_be_read_is_asked_no_more():
    with helped_by(("math",)):
        helper = helper_process._Kept.helper
        assert helper is not None
        # A request that the child answers, and nobody reads the answer: the next one would be taken for it.
        helper._thread.submit(helper._write, (square, 1))
        helper._thread.submit(helper._process.stdout.read, 3).result()
        assert shared_with_helper(square, range(8)) == tuple(x * x for x in range(8))
        assert helper._process.wait(timeout=10) != 0


@pytest.mark.skipif(sys.platform == "win32", reason="no such signals")
def test_what_a_stopped_helper_owes_is_done_here(monkeypatch):
    monkeypatch.setattr(helper_process, "_PATIENCE_S", 0.5)
    with helped_by(("math",)):
        helper = helper_process._Kept.helper
        assert len(set(shared_with_helper(process_of, range(40)))) == 2
        helper._process.send_signal(signal.SIGSTOP)
        begun = time.monotonic()
        assert shared_with_helper(square, range(20)) == tuple(x * x for x in range(20))
        assert time.monotonic() - begun < 20.0
        # It is asked no more, and does not stay behind.
        assert helper_process._Kept.helper is None
        assert helper._process.poll() is not None


def test_one_core_has_no_helper(monkeypatch):
    monkeypatch.setenv("SYSID_THREADS", "1")
    begin_helper(("math",))
    assert helper_process._Kept.helper is None


def test_where_no_process_can_be_started_the_work_is_done_here(monkeypatch):
    def refused(*args, **kwargs):
        raise OSError("no further process")

    monkeypatch.setattr(helper_process.subprocess, "Popen", refused)
    with helped_by(("math",)):
        assert shared_with_helper(square, range(5)) == (0, 1, 4, 9, 16)


def test_a_helper_that_was_started_ahead_stays_unless_something_fails():
    with no_helper_after_failure():
        begin_helper(("math",))
    assert helper_process._Kept.helper is not None
    with pytest.raises(ZeroDivisionError), no_helper_after_failure():
        _ = 1 / 0
    assert helper_process._Kept.helper is None


SCRIPT = """
import signal, time
from sysid.helper_process import helped_by, shared_with_helper
# A background job of a shell ignores Ctrl-C; pytest may be one.
signal.signal(signal.SIGINT, signal.default_int_handler)
# No guard: the helper must not run this script.
print("started", flush=True)
with helped_by(("math",)):
    try:
        shared_with_helper(time.sleep, [0.2] * 40)
    except KeyboardInterrupt:
        # The helper has the time to say something.
        time.sleep(1.0)
        print("interrupted", flush=True)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="process groups")
def test_ctrl_c_ends_the_helper_without_a_word_and_scripts_need_no_guard(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    environment = {**os.environ, "SYSID_THREADS": "2"}
    process = subprocess.Popen(
        [sys.executable, str(script)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "started\n"
    time.sleep(2.5)
    # As the terminal does: to the whole group.
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (0, "interrupted\n", "")
