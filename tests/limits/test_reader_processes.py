"""Every file has a process of its own: what one does to it ends in a sentence and reaches no other file."""

from __future__ import annotations

import importlib.util
import os
import signal
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from sysid import bounded_reader, limits
from sysid.bounded_reader import read_in_child
from sysid.errors import DataRejectedError

READER = b"""
import os, signal, sys, time
import numpy as np

def read(stream, request):
    do, content = request["do"], stream.read()
    if do == "sleep":
        time.sleep(60)
    if do == "turn":
        while True:
            pass
    if do == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    if do == "chatter":
        print("x" * 100000)
        os._exit(0)
    if do == "spoil":
        sys.modules["numpy"].spoiled = True
    answer = {"parent": os.getppid(), "spoiled": hasattr(np, "spoiled"), "json": "csv" in sys.modules}
    return answer, [np.frombuffer(content, np.uint8)]
"""

forked = pytest.mark.skipif(not bounded_reader._FORKS, reason="this system starts each process anew")


@pytest.fixture
def reader(tmp_path: Path) -> Callable[..., Any]:
    file = tmp_path / "reader.py"
    file.write_bytes(READER)
    specification = importlib.util.spec_from_file_location("reader_of_this_test", file)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return lambda do, content=b"", label="log.mf4", **request: read_in_child(
        module.read, content, label, [], do=do, **request
    )


@pytest.fixture(params=[pytest.param(True, marks=forked), False])
def _both_ways(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounded_reader, "_FORKS", request.param)


@pytest.mark.usefixtures("_both_ways")
@pytest.mark.parametrize(
    ("do", "said"),
    [
        ("sleep", "takes longer than 1 s"),
        pytest.param(
            "turn",
            "takes longer than 0 s",
            marks=pytest.mark.skipif(sys.platform == "win32", reason="no limit of processor time"),
        ),
        ("crash", "gave up"),
        ("chatter", "gave up"),
    ],
)
def test_a_file_that_ends_its_process_is_one_sentence_and_the_next_is_read(
    reader: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, do: str, said: str
) -> None:
    if do == "sleep":
        monkeypatch.setattr(limits, "READER_WAIT_S", 1.0)
    if do == "turn":
        monkeypatch.setattr(limits, "READER_START_SECONDS", 0.1)
    with pytest.raises(DataRejectedError, match=f"^log.mf4 .*{said}"):
        reader(do)
    monkeypatch.undo()
    assert reader("read", b"ab")[1][0].tolist() == [97, 98]


@pytest.mark.usefixtures("_both_ways")
def test_contents_larger_than_a_pipe_come_back_whole(reader: Callable[..., Any]) -> None:
    content = bytes(range(256)) * 40_000
    assert reader("read", content)[1][0].tobytes() == content


@forked
def test_one_process_loads_libraries_and_no_file_changes_them_for_the_next(reader: Callable[..., Any]) -> None:
    first, _ = reader("spoil", modules=["csv", "there_is_no_such_module"])
    second, _ = reader("read")
    assert first["spoiled"]
    assert not second["spoiled"]
    assert first["json"]
    assert first["parent"] == second["parent"] != os.getpid()


@forked
def test_a_server_that_somebody_ends_is_replaced(reader: Callable[..., Any]) -> None:
    first, _ = reader("read")
    os.kill(first["parent"], signal.SIGKILL)
    second, _ = reader("read")
    assert second["parent"] != first["parent"]


@forked
def test_a_server_that_has_nothing_to_do_ends(
    reader: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    worker = tmp_path / "read_worker.py"
    worker.write_text(bounded_reader._WORKER.read_text(encoding="utf-8").replace("IDLE_S = 10.0", "IDLE_S = 0.1"))
    bounded_reader.end_readers()
    monkeypatch.setattr(bounded_reader, "_WORKER", worker)
    reader("read")
    server = bounded_reader._Kept.server
    assert server is not None
    assert server._process.wait(20.0) == 0
    assert reader("read", b"a")[1][0].tolist() == [97]
    bounded_reader.end_readers()


@forked
def test_files_are_read_side_by_side(reader: Callable[..., Any]) -> None:
    with ThreadPoolExecutor(4) as threads:
        answers = list(threads.map(lambda n: reader("read", bytes([n]) * 100_000), range(20)))
    assert [set(arrays[0].tolist()) for _, arrays in answers] == [{n} for n in range(20)]
    assert len({answer["parent"] for answer, _ in answers}) == 1


@forked
def test_a_system_that_starts_no_process_is_one_sentence(
    reader: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(*arguments: Any, **options: Any) -> None:
        raise OSError(11, "Resource temporarily unavailable")

    bounded_reader.end_readers()
    monkeypatch.setattr(bounded_reader.subprocess, "Popen", none)
    with pytest.raises(DataRejectedError, match="no process for its reader can be started"):
        reader("read")


@forked
def test_no_handle_stays_open(reader: Callable[..., Any]) -> None:
    reader("read")
    before = len(os.listdir("/proc/self/fd"))
    for do in ("read", "crash", "read"):
        if do == "crash":
            with pytest.raises(DataRejectedError):
                reader(do)
        else:
            reader(do)
    assert len(os.listdir("/proc/self/fd")) <= before
