"""Signals that ask the program to end are answered as Ctrl-C is: by a sentence and an exit code."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no such signals on this system")

SCRIPT = """
import signal, sys, time
from sysid.cli.guarded import guarded

def do(screen, errors):
    print("working", flush=True)
    time.sleep(float(sys.argv[2]))
    return 0

# Whatever the tests themselves were started to ignore.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_IGN if sys.argv[1] == "ignored" else signal.SIG_DFL)
before = [signal.getsignal(n) for n in (signal.SIGHUP, signal.SIGTERM)]
code = guarded("test", "Stopped. It goes on.", do)
assert before == [signal.getsignal(n) for n in (signal.SIGHUP, signal.SIGTERM)]
sys.exit(code)
"""


def ended(how: str, seconds: float, number: signal.Signals) -> tuple[int, str]:
    """Exit code and last words of a command that gets a signal while it works."""
    words = [sys.executable, "-c", SCRIPT, how, str(seconds)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "working\n"
        process.send_signal(number)
        _, said = process.communicate(timeout=60)
    return process.returncode, said.strip()


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_closed_terminal_is_like_an_interrupt(name: str) -> None:
    assert ended("heard", 50.0, getattr(signal, name)) == (130, "Stopped. It goes on.")


def test_what_is_started_to_outlive_its_terminal_does() -> None:
    """As `nohup` starts it."""
    assert ended("ignored", 1.0, signal.SIGHUP) == (0, "")
    assert ended("ignored", 50.0, signal.SIGTERM) == (130, "Stopped. It goes on.")


def test_other_signals_end_it_as_ever() -> None:
    assert ended("heard", 50.0, signal.SIGUSR1) == (-signal.SIGUSR1, "")
