"""Stored results that do not fit each other, under a checksum that is right, end in one sentence."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sysid import array_file
from sysid.cli.stages import run_stage
from sysid.workflow import Calibration
from sysid.workflow.earlier_files import remember_more
from sysid.workflow.stages import SCAN

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"


def stage(name: str, output: Path) -> int:
    return run_stage(name, DATA, output, quick=False, seed=0, max_steps=None, laws=None, resume=False)


def report(output: Path) -> int:
    return stage("report", output)


def test_arrays_of_another_shape_are_one_sentence_and_computing_them_again_mends_it(tmp_path: Path, capsys) -> None:
    output = tmp_path / "out"
    Calibration(DATA, output).scan()
    path = output / "stages" / "scan.npz"
    content = array_file.read(path)
    assert content is not None
    array_file.write(path, content.fields, {name: np.float64(1.0) for name in content.arrays})
    assert report(output) == 3
    said = " ".join(capsys.readouterr().err.split())
    assert "The stored results in out/ (scan) do not fit each other" in said
    assert "run all stages again without --resume" in said
    assert "Traceback" not in said
    assert (output / "error.log").is_file()
    Calibration(DATA, output).again(SCAN)
    assert report(output) == 0


def test_a_stage_with_other_options_than_the_fit_leaves_what_was_exported(tmp_path: Path, capsys) -> None:
    """As `check` without the --laws of the run; what the fit would need again is not thrown away."""
    output = tmp_path / "out"
    assert stage("check", output) == 0
    table = output / "parameters.csv"
    table.write_text("of the fit\n")
    remember_more(output, "export", [table])
    array_file.write(output / "stages" / "fit.npz", {"fingerprint": "of other options", "result": None}, {})
    capsys.readouterr()
    assert stage("check", output) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "the results in out/ of fit are of other inputs or options; the exported files stay as they are" in said
    assert table.exists()
    (output / "stages" / "fit.npz").unlink()
    assert stage("check", output) == 0
    assert not table.exists()
