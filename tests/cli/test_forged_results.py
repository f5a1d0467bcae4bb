"""Stored results that do not fit each other, under a checksum that is right, end in one sentence."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sysid import array_file
from sysid.cli.stages import run_stage
from sysid.workflow import Calibration

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"


def report(output: Path) -> int:
    return run_stage("report", DATA, output, quick=False, seed=0, max_steps=None, laws=None, resume=False)


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
    calibration = Calibration(DATA, output)
    calibration.redo("scan")
    calibration.scan()
    assert report(output) == 0
