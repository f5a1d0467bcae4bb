"""The command `selftest`: what it prints, its exit codes, and that readings in the logs do not matter."""

from __future__ import annotations

import io
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from rich.console import Console

from sysid.cli import selftest as command
from sysid.cli.main import cli
from sysid.cli.selftest import run_selftest, show_selftest
from sysid.selftest import Check, Replicate, SelfTest

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"
RUN = "case5_loaded_16kmh_run1"


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """The linear truck with one run, whose log holds time stamps and zeros only."""
    folder = tmp_path / "campaign"
    shutil.copytree(DATA, folder)
    text = (folder / "campaign.toml").read_text(encoding="utf-8")
    lines = [s for s in text.splitlines() if 'file = "bump_runs/' not in s or RUN in s]
    (folder / "campaign.toml").write_text("\n".join(lines), encoding="utf-8")
    log = folder / "bump_runs" / f"{RUN}.csv"
    head, *rows = log.read_text().splitlines()
    blank = [",".join([row.split(",")[0], *["0"] * head.count(",")]) for row in rows]
    log.write_text("\n".join([head, *blank]))
    return folder


def test_logs_of_zeros_are_enough_to_see_what_would_be_learned(campaign: Path, capsys) -> None:
    assert run_selftest(campaign, 1, 0) == 0
    text = capsys.readouterr().out
    rows = {line.split()[0]: line.split() for line in text.splitlines() if line.startswith(("k_", "c_"))}
    assert {"k_1", "k_6", "c_1", "c_6"} <= set(rows)
    assert float(rows["k_1"][5]) < 10.0 < float(rows["k_1"][4])
    held = sum(row[-1] == "yes" for row in rows.values())
    assert f"{held} of {len(rows)} intervals contain the true value" in text
    assert "from the covariance of the fit" in text


def test_runs_that_are_still_to_come_need_no_log(campaign: Path, capsys) -> None:
    shutil.rmtree(campaign / "bump_runs")
    shutil.rmtree(campaign / "plank_drops")
    assert run_selftest(campaign, 1, 0) == 0
    said = capsys.readouterr()
    assert f"1 of 1 logs do not exist yet (bump_runs/{RUN}.csv); these runs are simulated as planned." in said.err
    rows = {line.split()[0]: line.split() for line in said.out.splitlines() if line.startswith(("k_", "c_"))}
    assert float(rows["k_1"][5]) < 10.0 < float(rows["k_1"][4])


def test_a_missing_scan_is_one_sentence(campaign: Path, capsys) -> None:
    (campaign / "bump_scan.csv").unlink()
    assert run_selftest(campaign, 1, 0) == 2
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert message.startswith("calibrate.py selftest: ")
    assert "bump_scan.csv" in message


def test_no_replicate_is_a_wrong_option() -> None:
    assert CliRunner().invoke(cli, ["selftest", "--replicates", "0"]).exit_code == 2


def test_pooled_counts_of_several_campaigns_are_printed() -> None:
    good, bad = (Check("k_2[laden]", "N/m", 1.0, value, 0.8, 0.1) for value in (1.0, 2.0))
    console = Console(width=200, record=True, file=io.StringIO())
    one = Replicate((good, replace(bad, name="c_1")), np.eye(2), False)
    show_selftest(console, SelfTest((one,) * 50, ("no start found.",), 0))
    text = console.export_text()
    rows = [line.split() for line in text.splitlines() if line.startswith(("k_", "c_"))]
    assert rows == [["k_2[laden]", "80", "10", "50", "of", "50"], ["c_1", "80", "10", "0", "of", "50"]]
    assert "50 of 100 intervals contain the true value (50 %); by chance 84 to 95 are expected" in text
    assert "could not be calibrated: no start found." in text
    assert "not converged in 50 of 50" in text


@pytest.mark.parametrize(("converged", "code"), [(True, 0), (False, 4)])
def test_a_campaign_that_has_not_converged_exits_with_4(converged: bool, code: int, monkeypatch, capsys) -> None:
    one = Replicate((Check("k_1", "N/m", 1.0, 1.0, 0.8, 0.1),), np.eye(1), converged)
    monkeypatch.setattr(command, "_simulated", lambda *given: SelfTest((one,), (), 0))
    assert run_selftest(Path("campaign.toml"), 1, 0) == code
    assert "1 of 1 intervals" in capsys.readouterr().out
