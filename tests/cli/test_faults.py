"""Bad input ends in one plain sentence and the documented exit code, never in a traceback."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import jax
import pytest
from click.testing import CliRunner

from sysid import runtime
from sysid.cli.main import cli
from sysid.cli.stages import run_stage

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"
RUN = "bump_runs/case1_unloaded_16kmh_run1.csv"
DROP = "plank_drops/axle1_drop1.csv"


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """A copy of the linear truck that a test may damage."""
    folder = tmp_path / "campaign"
    shutil.copytree(DATA, folder)
    return folder


def check(campaign: Path, output: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Exit code and error text of ``calibrate.py check``, without the lines of progress."""
    code = run_stage("check", campaign, output, quick=False, seed=0, max_steps=None, laws=None, resume=False)
    lines = capsys.readouterr().err.strip().splitlines()
    return code, "\n".join(line for line in lines if not line.endswith(" ..."))


def edit(file: Path, old: str, new: str) -> None:
    """Replace the first occurrence of a text that must be there."""
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new, 1), encoding="utf-8")


def unknown_key(folder: Path) -> None:
    edit(folder / "campaign.toml", "wheelbase_m", "wheelbase_mm")


def missing_log(folder: Path) -> None:
    (folder / RUN).unlink()


def unknown_axle(folder: Path) -> None:
    edit(folder / "campaign.toml", 'lvdt1_mm       = { kind = "suspension_deflection", axle = "front steer"',
         'lvdt1_mm       = { kind = "suspension_deflection", axle = "front stear"')  # fmt: skip


def masses_that_do_not_add_up(folder: Path) -> None:
    edit(folder / "campaign.toml", "sprung_mass_kg = [5103, 10094]", "sprung_mass_kg = [5103, 12094]")


def toml_syntax(folder: Path) -> None:
    edit(folder / "campaign.toml", "schema = 1", "schema = = 1")


def outside_path(folder: Path) -> None:
    edit(folder / "campaign.toml", DROP, "../" + DROP)


def log_is_a_folder(folder: Path) -> None:
    (folder / RUN).unlink()
    (folder / RUN).mkdir()


def text_in_a_cell(folder: Path) -> None:
    lines = (folder / RUN).read_text().splitlines()
    cells = lines[40].split(",")
    cells[3] = "broken"
    lines[40] = ",".join(cells)
    (folder / RUN).write_text("\n".join(lines))


def backward_time(folder: Path) -> None:
    lines = (folder / RUN).read_text().splitlines()
    lines[100], lines[300] = lines[300], lines[100]
    (folder / RUN).write_text("\n".join(lines))


def binary_garbage(folder: Path) -> None:
    (folder / RUN).write_bytes(bytes(range(256)) * 200)


def empty_log(folder: Path) -> None:
    (folder / DROP).write_text("")


def duplicate_header(folder: Path) -> None:
    edit(folder / RUN, "lvdt2_mm", "lvdt1_mm")


def wrong_unit(folder: Path) -> None:
    edit(folder / "campaign.toml", 'frame_axle_mm = { kind = "suspension_deflection", unit = "mm", range = 150 }',
         'frame_axle_mm = { kind = "suspension_deflection", unit = "m", range = 150 }')  # fmt: skip


FAULTS: list[tuple[Callable[[Path], None], int, list[str]]] = [
    (unknown_key, 2, ["campaign.toml", "wheelbase_mm", "wheelbase_m"]),
    (missing_log, 2, [RUN]),
    (unknown_axle, 2, ["front stear", "front steer"]),
    (masses_that_do_not_add_up, 2, ["kg"]),
    (toml_syntax, 2, ["campaign.toml", "line"]),
    (outside_path, 2, ["../"]),
    (log_is_a_folder, 2, [RUN]),
    (text_in_a_cell, 3, [RUN, "broken"]),
    (backward_time, 3, [RUN, "time"]),
    (binary_garbage, 3, [RUN]),
    (empty_log, 3, [DROP]),
    (duplicate_header, 3, [RUN, "lvdt1_mm"]),
]


@pytest.mark.parametrize(("damage", "code", "words"), FAULTS, ids=[f.__name__ for f, _, _ in FAULTS])
def test_a_fault_is_one_sentence_with_its_exit_code(
    damage: Callable[[Path], None], code: int, words: list[str], campaign: Path, tmp_path: Path, capsys
) -> None:
    damage(campaign)
    found, text = check(campaign, tmp_path / "out", capsys)
    assert found == code
    assert "Traceback" not in text
    assert "\n" not in text
    for word in words:
        assert word in text


def test_a_rejected_channel_is_named_and_check_exits_with_3(campaign: Path, tmp_path: Path, capsys) -> None:
    wrong_unit(campaign)
    code = run_stage("check", campaign, tmp_path / "out", quick=False, seed=0, max_steps=None, laws=None, resume=False)
    assert code == 3
    assert "frame_axle_mm" in capsys.readouterr().out


def test_the_untouched_campaign_passes_the_check(campaign: Path, tmp_path: Path, capsys) -> None:
    code, text = check(campaign, tmp_path / "out", capsys)
    assert (code, text) == (0, "")
    assert (tmp_path / "out" / "result.json").is_file()


@pytest.mark.skipif(os.name == "nt", reason="folders have other modes on Windows")
def test_a_cache_folder_that_others_can_write_to_is_one_sentence(campaign: Path, tmp_path: Path, capsys, monkeypatch):
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    monkeypatch.setenv("SYSID_CACHE_DIR", str(shared))
    monkeypatch.setattr(runtime, "_user_cache", lambda: tmp_path / "own")
    runtime._say.cache_clear()
    before = jax.config.jax_compilation_cache_dir
    try:
        code, text = check(campaign, tmp_path / "output", capsys)
    finally:
        jax.config.update("jax_compilation_cache_dir", before)
    assert code == 0
    (line,) = (" ".join(text.split())).split("calibrate.py check: ")[1:]
    assert line.startswith(f"Compiled code is kept in {tmp_path / 'own'} because {shared} can be written by others")


def test_output_that_is_a_file_is_refused(campaign: Path, tmp_path: Path, capsys) -> None:
    (tmp_path / "out").write_text("")
    code, text = check(campaign, tmp_path / "out", capsys)
    assert code == 2
    assert "--output" in text


def test_a_wrong_command_and_a_wrong_option_exit_with_2() -> None:
    for arguments in (["calibrate"], ["check", "--bogus"], ["check", "--seed", "-1"]):
        assert CliRunner().invoke(cli, arguments).exit_code == 2


def test_a_missing_campaign_is_one_sentence(tmp_path: Path, capsys) -> None:
    code, text = check(tmp_path / "nowhere", tmp_path / "out", capsys)
    assert code == 2
    assert "nowhere" in text
    assert "\n" not in text
