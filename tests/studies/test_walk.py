"""The way through the code: stops and returns of a package whose calls are known."""

from __future__ import annotations

import runpy
from pathlib import Path

from studies.walk import counts, path, stops

FIRST = """
from second import middle

class Counted:
    pass

def helper():
    return middle([3, 1])

def start():
    helper()
    helper()
    return last()

def last():
    return 0
"""
SECOND = """
from contextlib import ExitStack

def middle(values):
    with ExitStack() as stack:
        stack.callback(called_by_the_library)
    return end()

def called_by_the_library():
    return 0

def end():
    return [1 for _ in range(2)]

AT_IMPORT = end()
"""


def test_every_function_is_a_stop_once_where_the_package_calls_it(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "first.py").write_text(FIRST)
    (tmp_path / "second.py").write_text(SECOND)
    monkeypatch.syspath_prepend(str(tmp_path))

    def run() -> None:
        runpy.run_path(str(tmp_path / "first.py"))["start"]()

    # `start` is called from outside; then helper, middle and end, last.
    files = stops(run, tmp_path)
    assert files == ["first.py", "second.py", "second.py", "first.py"]
    assert stops(run, tmp_path, below="helper") == ["second.py", "second.py"]
    assert path(files) == ["first.py", "second.py", "first.py"]
    assert counts(files, "files") == "files: 3 stops, 2 distinct, 1 returns"
