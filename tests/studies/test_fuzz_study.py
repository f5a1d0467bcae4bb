"""The fuzzer's readers: they read what they begin with, what they find is judged, and rows of other readers stay."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

from studies.fuzz import __main__ as command
from studies.fuzz import replay as replaying
from studies.fuzz.replay import replay
from studies.fuzz.table import table
from studies.fuzz.targets import TARGETS
from sysid.errors import SysidError

FIGURES = {
    "inputs": 1200, "refused": 1000, "stopped": 1, "died": 2, "slowest_s": 0.52, "peak_MB": 300, "processor_s": 3600.0,
    "places": [10, 1020], "corpus": 7, "findings": {"slow-1": {"outcome": "sentence"}, "error-2": {"wrong": "x"}},
}  # fmt: skip


@pytest.mark.parametrize("name", TARGETS)
def test_a_reader_reads_files_that_it_begins_with_and_refuses_others(name: str, tmp_path: Path) -> None:
    target = TARGETS[name]
    read, ends = target.reader(), []
    for content in target.seeds().values():
        try:
            ends.append(read(tmp_path, content) is not None)
        except SysidError:
            ends.append(False)
    assert any(ends)
    if name == "stages":
        assert all(ends)
        assert read(tmp_path, b"\0nothing") is None
    else:
        with pytest.raises(SysidError):
            read(tmp_path, b"nothing")


@pytest.mark.parametrize("name", TARGETS)
def test_what_guides_the_fuzzer_is_there(name: str) -> None:
    target = TARGETS[name]
    for module in target.loaded:
        importlib.import_module(module)
    assert set(target.watched) <= {module.split(".")[0] for module in sys.modules} | {"scipy.io"}


def test_a_finding_is_read_as_the_product_reads_it(tmp_path: Path) -> None:
    (tmp_path / "good").write_bytes(TARGETS["log"].seeds()["01"])
    (tmp_path / "bad").write_bytes(b"nothing")
    assert replay("log", tmp_path / "good")["outcome"] == "result"
    found = replay("log", tmp_path / "bad")
    assert found["outcome"] == "sentence"
    assert "wrong" not in found


@pytest.mark.parametrize(
    ("seconds", "megabytes", "code", "wrong"), [(11.0, 10, 0, "11.0 s"), (1.0, 1200, 0, "1200 MB"), (1.0, 10, 1, "oh")]
)
def test_what_takes_too_much_or_fails_is_wrong(
    seconds: float, megabytes: int, code: int, wrong: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = json.dumps({"outcome": "result", "seconds": seconds, "MB": megabytes})
    done = subprocess.CompletedProcess([], code, said + "\n", "oh")
    monkeypatch.setattr(replaying.subprocess, "run", lambda *a, **k: done)
    assert replay("log", Path("x"))["wrong"] == wrong


def test_the_table_has_rows_of_this_call_and_keeps_those_of_the_page(tmp_path: Path) -> None:
    (tmp_path / "ply").mkdir()
    (tmp_path / "ply" / "figures.json").write_text(json.dumps(FIGURES), encoding="utf-8")
    kept, old = "| TDMS | 60 | 5 |", "| PLY | 1 | 1 |"
    page = f"| text log | other table |\n<!-- fuzz: begin -->\n| reader | x |\n{kept}\n{old}\n<!-- fuzz: end -->\n"
    rows = table(tmp_path, page).splitlines()[2:]
    assert rows == ["| PLY | 60 | 1,200 | 1,000 | 10, 1,020 | 7 | 0.5 | 300 | 3 | 1 |", kept]


def test_a_call_that_was_stopped_is_continued(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Every process is said to take 40 s of processor time and to read ten contents; the second one is interrupted.
    calls: list[tuple[str, ...]] = []

    def process(name: str, folder: Path, options: tuple[str, ...]) -> str:
        calls.append(options)
        if options[0] != "-runs=0":
            figures = {"inputs": 10, "refused": 9, "stopped": 0, "slowest_s": 0.1, "peak_MB": 50, "processor_s": 40.0}
            (folder / "worker.json").write_text(json.dumps(figures), encoding="utf-8")
        if len(calls) in (2, 3):
            (folder / "findings" / f"native-{len(calls)}").write_bytes(b"nothing")
        if len(calls) == 3:
            raise KeyboardInterrupt
        return f"#9 DONE cov: {100 + len(calls)} ft: 1"

    monkeypatch.setattr(command, "_run", process)
    monkeypatch.setattr(command, "replay", lambda name, file: {"outcome": "sentence"})
    with pytest.raises(KeyboardInterrupt):
        command.fuzz("log", tmp_path, 120.0)
    assert not (tmp_path / "figures.json").exists()
    found = command.fuzz("log", tmp_path, 120.0)
    assert (found["inputs"], found["processor_s"], found["places"]) == (30, 120.0, [101, 104])
    # Contents that ended the first process and the interrupted one.
    assert found["died"] == 2
    # The seeds were read once, and a call after a finished one begins again; so does one with other code.
    assert [options[0] for options in calls].count("-runs=0") == 1
    assert command.fuzz("log", tmp_path, 40.0)["inputs"] == 10
    command._keep(tmp_path, {**found, "inputs": 500, "processor_s": 20.0}, [7, 8])
    assert command.fuzz("log", tmp_path, 60.0)["inputs"] == 510
    command._keep(tmp_path, {**found, "inputs": 500, "processor_s": 20.0}, [7, 8])
    monkeypatch.setattr(command, "_sources", lambda: "other")
    assert command.fuzz("log", tmp_path, 40.0)["inputs"] == 10


def test_long_contents_that_a_fuzzer_prints_are_not_kept():
    """Two lines that count coverage, 300 MB in one line between them, a last word."""
    program = (
        "import sys\n"
        "print('#12 INITED cov: 34 ft: 5')\n"
        "for _ in range(300): sys.stdout.write('x' * 1_000_000)\n"
        "print('\\n#99 DONE cov: 56 ft: 7\\nthe end')"
    )
    said = command._said([sys.executable, "-c", program])
    assert command._COVERAGE.findall(said) == ["34", "56"]
    assert said.endswith("the end\n")
    assert len(said) < 1e6
