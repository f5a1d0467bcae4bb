"""The main job on the linear truck, from logs to a converged posterior: several minutes, so marked long."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from sysid.cli.stages import run_stage

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> dict:
    """``result.json`` of a complete run."""
    output = tmp_path_factory.mktemp("run")
    assert run_stage("run", DATA, output, quick=False, seed=0, max_steps=None, laws=None, resume=False) == 0
    return json.loads((output / "result.json").read_text(encoding="utf-8"))


@pytest.mark.long
def test_the_run_converges(document: dict) -> None:
    assert document["status"] == "converged"
    sampled = [p["posterior"] for p in document["parameters"] if p["run"] is None]
    assert all(p["rhat"] < 1.01 and p["ess"] >= 400 for p in sampled)


@pytest.mark.long
def test_predicted_peak_ratios_are_near_the_truth(document: dict) -> None:
    with (DATA / "truth.toml").open("rb") as handle:
        truth = {p["load_case"]: p["peak_tire_force_over_static"] for p in tomllib.load(handle)["prediction"]}
    errors = [
        p["peak_dynamic_load_ratio"]["q50"] / truth[p["load_case"]][p["axle"] - 1] - 1.0
        for p in document["predictions"]
    ]
    assert len(errors) == 12
    # 1.4 % was found.
    assert np.abs(errors).max() < 0.04


@pytest.mark.long
def test_credible_intervals_hold_the_truth(document: dict) -> None:
    keys = {"stiffness": "suspension_stiffness_N_per_m", "damping": "suspension_damping_N_s_per_m"}
    with (DATA / "truth.toml").open("rb") as handle:
        axles = tomllib.load(handle)["axle"]
    held = [
        p["posterior"]["q05"] <= axles[p["axle"] - 1][keys[p["quantity"]]] <= p["posterior"]["q95"]
        for p in document["parameters"]
        if p["quantity"] in keys
    ]
    assert len(held) == 14
    assert sum(held) >= 12
