"""The command `formats` and the option `--version`: what they print, and exit codes."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from log_files import csv, mdf4

from sysid.cli import formats as command
from sysid.cli.main import cli
from sysid.first_look import first_look
from sysid.logs.registry import FORMATS
from sysid.workflow.versions import versions


def run(*arguments: str):
    return CliRunner().invoke(cli, ["formats", *arguments], env={"COLUMNS": "200"})


def test_all_formats_are_listed_with_their_state(monkeypatch: pytest.MonkeyPatch) -> None:
    found = run()
    assert found.exit_code == 0
    for known in FORMATS:
        assert f"{known.name}: " in found.output
    assert "missing" not in found.output
    monkeypatch.setattr(command, "installed", lambda libraries: "asammdf" not in libraries)
    assert "pip install 'truck-sysid[mdf]'" in run().output


def test_format_and_channels_of_files(tmp_path: Path) -> None:
    (tmp_path / "a.mf4").write_bytes(mdf4())
    (tmp_path / "b.txt").write_bytes(csv())
    found = run(str(tmp_path / "a.mf4"), str(tmp_path / "b.txt"))
    assert found.exit_code == 0
    assert "a.mf4 is an MDF file with the channels" in found.output
    assert "b.txt is a text table with the channels 'time_s', 'q_mm', 'a_g', 'b_g'." in found.output


def test_groups_and_clocks_of_a_file(tmp_path: Path) -> None:
    from nptdms import ChannelObject, TdmsWriter

    stream = io.BytesIO()
    with TdmsWriter(stream) as writer:
        for group, step, name in (("front", 0.005, "q_mm"), ("rear", 0.0025, "a_g"), ("road", 0.1, "height")):
            about = {"wf_increment": step, "wf_start_offset": 0.1, "wf_xunit_string": "m" if group == "road" else "s"}
            values = np.array([1.0, np.nan, 3.0])
            writer.write_segment([ChannelObject(group, name, values, {**about, "unit_string": "mm"})])
    (tmp_path / "a.tdms").write_bytes(stream.getvalue())
    said = run(str(tmp_path / "a.tdms")).output
    table = [line.split() for line in said.splitlines()]
    assert ["channel", "group", "unit", "samples", "missing", "clock"] in [cells[:6] for cells in table]
    lines = {cells[0]: cells[1:9] for cells in table if cells[0] in ("q_mm", "a_g")}
    assert lines == {
        "q_mm": ["front", "mm", "3", "1", "1", "200", "0.1", "time"],
        "a_g": ["rear", "mm", "3", "1", "2", "400", "0.1", "time"],
    }
    assert "a.tdms has no time for 'road/height': its axis is a quantity [m], not time" in said
    assert "1 of 3 samples of 'front/q_mm'" in said


def test_a_file_that_cannot_be_read_is_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "a.mf4").write_bytes(mdf4()[:200])
    found = run(str(tmp_path / "a.mf4"), str(tmp_path / "none.csv"))
    assert found.exit_code == 3
    assert "a.mf4 cannot be read as an MDF file" in found.output
    assert "none.csv cannot be read" in found.output


def test_the_version_is_that_of_the_package() -> None:
    found = CliRunner().invoke(cli, ["--version"])
    assert found.exit_code == 0
    assert found.output == f"sysid {versions()['sysid']}\n"


@pytest.mark.parametrize(("raised", "code", "said"), [(KeyboardInterrupt, 130, "Stopped."), (ValueError, 1, "report")])
def test_a_stop_and_a_defect_are_said(raised, code: int, said: str, tmp_path: Path, monkeypatch) -> None:
    def fails(*unused):
        raise raised

    (tmp_path / "a.csv").write_bytes(csv())
    monkeypatch.setattr(command, "format_of", fails)
    found = run(str(tmp_path / "a.csv"))
    assert found.exit_code == code
    assert said in found.output


@pytest.mark.parametrize(
    "head",
    [
        "Zeit [s];Weg VA;Druck\ns;mm;bar\n",  # a row of units
        "TIMESTAMP;Weg VA;Druck\nTS;mm;bar\nSmp;Smp;Avg\n",  # units and processing
        "Laufzeit;Weg VA;Druck\n",  # no name of time that is known: the even steps say it
    ],
)
def test_a_file_is_read_as_by_init(head: str, tmp_path: Path) -> None:
    rows = "".join(f"{0.01 * i:.2f};{i % 7};{3 + i % 2}\n".replace(".", ",") for i in range(200))
    (tmp_path / "Lauf_8kmh.csv").write_text(head + rows, encoding="utf-8")
    found = run(str(tmp_path / "Lauf_8kmh.csv"))
    assert found.exit_code == 0, found.output
    (log,) = first_look(tmp_path).logs
    assert log.rate_hz == pytest.approx(100.0)
    for look in log.looks:
        shown = next(line for line in found.output.splitlines() if line.startswith(look.name))
        assert (look.unit or "") in shown
        assert " 100 " in shown
