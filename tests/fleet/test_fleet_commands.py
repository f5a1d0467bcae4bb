"""The commands of a fleet: what they print, write and return, on a terminal and off it."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from click.testing import CliRunner
from fleet_child import COMMAND, DIGEST
from rich.console import Console

from sysid.cli import fleet as command
from sysid.cli.main import cli
from sysid.fleet import key, running, task
from sysid.fleet.outcome import Outcome
from sysid.fleet.running import Row


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    """Campaigns are calibrated by the stand-in."""
    monkeypatch.setattr(key, "program_digest", lambda: DIGEST)
    made = running.Task

    def with_stand_in(*given, **more):
        return made(*given, **{**more, "command": COMMAND})

    monkeypatch.setattr(running, "Task", with_stand_in)
    assert task.MOST_STARTS == 2


@pytest.fixture
def campaigns(tmp_path: Path) -> Path:
    for name, behaviour in {"a": "done", "b": "rejected Axle 2 has no load.", "c": "not-converged"}.items():
        folder = tmp_path / "trucks" / name
        folder.mkdir(parents=True)
        (folder / "campaign.toml").write_text(f'title = "{name}"\n')
        (folder / "behaviour").write_text(behaviour)
    return tmp_path / "trucks"


@pytest.mark.usefixtures("stand_in")
def test_a_run_names_every_failure_and_writes_the_table(campaigns: Path, tmp_path: Path) -> None:
    words = ["fleet", str(campaigns), "--output", str(tmp_path / "out"), "--workers", "2"]
    result = CliRunner().invoke(cli, words)
    assert result.exit_code == 3
    assert "b: rejected: Axle 2 has no load." in result.stdout
    assert "Campaigns: 1 done, 1 not converged, 1 rejected." in result.stdout
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 3
    assert {line.split(" ")[1].strip(":") for line in lines} == {"a", "b", "c"}
    document = json.loads((tmp_path / "out" / "fleet_status.json").read_text())
    assert document["counts"] == {"done": 1, "not converged": 1, "rejected": 1}
    head, *rows = (tmp_path / "out" / "fleet_status.csv").read_text().splitlines()
    assert head.startswith("truck,type,campaign,date,state")
    assert len(rows) == 3
    again = CliRunner().invoke(cli, words)
    assert again.exit_code == 3
    only = CliRunner().invoke(cli, [*words, "--only", "c"])
    assert only.exit_code == 4
    assert CliRunner().invoke(cli, [*words, "--only", "a"]).exit_code == 0
    assert CliRunner().invoke(cli, [*words, "--only", "x"]).exit_code == 2


def test_on_a_terminal_the_table_is_live(tmp_path: Path) -> None:
    stream = io.StringIO()
    place = tmp_path / "campaigns" / "a"
    place.mkdir(parents=True)
    (place / "fleet_progress.json").write_text('{"stage": "4 of 8 fit: least squares", "fraction": 0.5}')
    screen = Console(file=stream, force_terminal=True, width=120)
    rows = [
        Row("T1", "t", "a", "", "running"),
        Row("T2", "t", "[b]", "", "failed", Outcome("failed", "out/ cannot be written (No space left on device)")),
        Row("T3", "t", "c", "", "queued"),
    ]
    with command.StatusView(screen, tmp_path) as view:
        view.show(rows)
    text = stream.getvalue()
    assert "1 queued, 1 running, 1 failed" in text
    assert "4 of 8 fit: least squares (50 %)" in text
    assert "No space left on device" in text
    assert "[b]" in text


def test_piped_a_line_comes_while_no_campaign_ends(tmp_path: Path, monkeypatch) -> None:
    place = tmp_path / "campaigns" / "a"
    place.mkdir(parents=True)
    (place / "fleet_progress.json").write_text('{"stage": "4 of 8 fit: least squares", "fraction": 0.5}')
    rows = [Row("T1", "t", "a", "", "running"), Row("T2", "t", "b", "", "queued")]
    clock = [0.0]
    monkeypatch.setattr(command.time, "monotonic", lambda: clock[0])
    stream = io.StringIO()
    with command.StatusView(Console(file=stream, width=200), tmp_path) as view:
        for second in range(12):
            clock[0] = float(second)
            view.show(rows)
    said = [f"{at} s: a, 4 of 8 fit: least squares (50 %) ..." for at in (5, 10)]
    assert stream.getvalue().splitlines() == said


@pytest.mark.usefixtures("quick_sampling")
def test_population_and_report_and_index(fleet_folders: tuple[Path, Path]) -> None:
    folder, output = map(str, fleet_folders)
    result = CliRunner().invoke(cli, ["fleet", "population", folder, "--output", output])
    assert result.exit_code == 0, result.output
    assert "short truck: 6 trucks, 12 campaigns" in result.stdout
    assert "T3: c_2 is 0." in result.stdout
    assert "Axle loads of a truck that nobody has measured" in result.stdout
    result = CliRunner().invoke(cli, ["fleet", "report", folder, "--output", output])
    assert result.exit_code == 0, result.output
    assert (fleet_folders[1] / "fleet.html").stat().st_size > 20_000
    pytest.importorskip("pyarrow")
    result = CliRunner().invoke(cli, ["fleet", "index", folder, "--output", output])
    assert result.exit_code == 0, result.output
    assert (fleet_folders[1] / "fleet.parquet" / "parameters.parquet").is_file()


def test_a_fleet_without_results_says_so(tmp_path: Path, fleet_folders: tuple[Path, Path]) -> None:
    result = CliRunner().invoke(cli, ["fleet", "population", str(fleet_folders[0]), "--output", str(tmp_path)])
    assert result.exit_code == 3
    assert "has 0 trucks with draws; a population needs 3" in result.stderr
