"""A full-model fit of the drops that breaks down costs its own rows only: readings are kept, shown and written."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from sysid.cli.stages import run_stage

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"
KEPT = ("plank_drops/axle1_drop1.csv", "plank_drops/axle6_drop1.csv")


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """The linear truck with two of its drops."""
    folder = tmp_path / "campaign"
    shutil.copytree(DATA, folder)
    file = folder / "campaign.toml"
    lines = file.read_text(encoding="utf-8").splitlines()
    file.write_text(
        "\n".join(x for x in lines if "plank_drops/" not in x or any(k in x for k in KEPT)) + "\n", encoding="utf-8"
    )
    return folder


@pytest.mark.parametrize("failure", [np.linalg.LinAlgError("SVD did not converge"), FloatingPointError("overflow")])
def test_readings_stay_when_the_full_model_breaks_down(failure, campaign, tmp_path, capsys, monkeypatch) -> None:
    def broken(*arguments):
        raise failure

    monkeypatch.setattr("sysid.estimation.fit.drop_model.fit_drops", broken)
    output = tmp_path / "out"
    code = run_stage("drops", campaign, output, quick=False, seed=0, max_steps=None, laws=None, resume=False)
    said = capsys.readouterr()
    shown = " ".join(said.out.split())
    assert code == 0
    assert "Traceback" not in said.out + said.err
    assert str(failure) in shown
    assert "were not fitted by the full model" in shown
    drops = json.loads((output / "result.json").read_text(encoding="utf-8"))["drops"]
    pooled = [d for d in drops if d["file"] is None]
    assert {(d["axle"], d["method"]) for d in pooled} == {
        (axle, method) for axle in (1, 6) for method in ("paper", "corrected", "free_decay")
    }
    # Equation (1) with the period that stands beside it: what was read is what is shown and written.
    mass = {1: 3955.0 - 540.0, 6: 3946.0 - 740.0}
    for d in pooled:
        if d["method"] == "paper":
            assert d["stiffness"] == pytest.approx(mass[d["axle"]] * (2.0 * np.pi / d["damped_period"]) ** 2, rel=0.02)
            assert re.search(rf"{d['damped_period']:.3f}", shown)
    assert all(
        d["note"].startswith("not usable alone") for d in pooled if d["method"] == "corrected" and d["axle"] == 6
    )
