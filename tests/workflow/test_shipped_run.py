"""The main job on the shipped campaign, a truck that rubs, stiffens and hits its stops: minutes, so marked long."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from sysid.cli.stages import run_stage

DATA = Path(__file__).parents[2] / "data"
#: Where a damper's c is stated [m/s].
STATED_RATE_M_S = 0.5


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> dict:
    """``result.json`` of a complete run with default options."""
    output = tmp_path_factory.mktemp("run")
    assert run_stage("run", DATA, output, quick=False, seed=0, max_steps=None, laws=None, resume=False) == 0
    return json.loads((output / "result.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def truth() -> dict:
    """What the data were made with."""
    with (DATA / "truth.toml").open("rb") as handle:
        return tomllib.load(handle)


def true_value(axle: dict, parameter: dict) -> float:
    """k of the load case, or the secant of the damper c r v / (1 + |v| / v_s), mean of both directions."""
    if parameter["quantity"] == "stiffness":
        case = f"suspension_stiffness_{parameter['load_case']}_N_per_m"
        return axle.get(case, axle["suspension_stiffness_N_per_m"])
    ratio = 0.5 * (axle["damper_bump_ratio"] + axle["damper_rebound_ratio"])
    return axle["suspension_damping_N_s_per_m"] * ratio / (1.0 + STATED_RATE_M_S / axle["damper_saturation_m_s"])


def suspension(document: dict, truth: dict, quantity: str) -> list[tuple[dict, float]]:
    """Parameters of a quantity with their true values."""
    found = [p for p in document["parameters"] if p["quantity"] == quantity]
    return [(p, true_value(truth["axle"][p["axle"] - 1], p)) for p in found]


@pytest.mark.long
def test_the_run_converges(document: dict) -> None:
    assert document["status"] == "converged"


@pytest.mark.long
def test_the_laws_are_those_of_the_truck(document: dict, truth: dict) -> None:
    """Friction where leaves rub and nowhere else, progressive springs where there is air."""
    rubs = {p["axle"] for p in document["parameters"] if p["quantity"] == "friction"}
    assert rubs == {i for i, a in enumerate(truth["axle"], 1) if a["friction_breakaway_unloaded_N"] > 0.0}
    assert any(p["quantity"] == "progressivity" for p in document["parameters"])


@pytest.mark.long
@pytest.mark.parametrize(("quantity", "limit"), [("stiffness", 0.02), ("damping", 0.08)])
def test_suspensions_are_near_the_truth(document: dict, truth: dict, quantity: str, limit: float) -> None:
    errors = [p["posterior"]["q50"] / true - 1.0 for p, true in suspension(document, truth, quantity)]
    assert len(errors) == {"stiffness": 8, "damping": 6}[quantity]
    # 1.7 % of k and 7.2 % of c were found.
    assert np.abs(errors).max() < limit


@pytest.mark.long
def test_intervals_hold_the_truth(document: dict, truth: dict) -> None:
    """Of 14 independent 90 % intervals 11 or more hold in 96 % of campaigns."""
    pairs = suspension(document, truth, "stiffness") + suspension(document, truth, "damping")
    assert sum(p["posterior"]["q05"] <= true <= p["posterior"]["q95"] for p, true in pairs) >= 11


@pytest.mark.long
@pytest.mark.xfail(
    strict=True, reason="4.1 % on one axle: priors of the dampers' shape pull where speeds go beyond the driven ones"
)
def test_predicted_peak_ratios_are_near_the_truth(document: dict, truth: dict) -> None:
    true = {p["load_case"]: p["peak_tire_force_over_static"] for p in truth["prediction"]}
    errors = [
        p["peak_dynamic_load_ratio"]["q50"] / true[p["load_case"]][p["axle"] - 1] - 1.0 for p in document["predictions"]
    ]
    assert len(errors) == 12
    # All axles but one are within 2.9 %; at the least-squares optimum all of them.
    assert np.abs(errors).max() < 0.04
