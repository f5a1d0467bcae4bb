"""Trucks with a rocker or a bending frame, simulated by equations of their own, through `calibrate.py fit` (long)."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from independent_campaign import write_truck_campaign
from independent_motion import tire_forces
from independent_truck import LOWBOY, THREE_AXLES, Elements, IndependentTruck

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[2]
ROCKER = '[[vehicle.group]]\nname = "tandem"\nkind = "equaliser"\naxles = ["axle 2", "axle 3"]\n'


def fitted(folder: Path, truck: IndependentTruck, **declared: str | tuple[float, ...]) -> dict:
    """result.json of the fit of a truck's campaign, and how its runs were driven as `driven`."""
    driven = write_truck_campaign(folder / "campaign", truck, **declared)
    output = folder / "output"
    for stage in ("fit", "report"):
        command = [sys.executable, "calibrate.py", stage, str(folder / "campaign"), "--output", str(output)]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=3600)
        assert done.returncode in (0, 4), done.stderr  # 4: a fit without the rocker need not converge
    return json.loads((output / "result.json").read_text(encoding="utf-8")) | {"driven": driven}


def errors(result: dict, truck: IndependentTruck) -> dict[str, float]:
    """Largest relative error of k and of c over the axles."""
    worst = {"stiffness": 0.0, "damping": 0.0}
    for p in result["parameters"]:
        if p["quantity"] in worst:
            case = p["load_case"] or next(iter(truck.load_cases))
            true = truck.stiffness_of(case) if p["quantity"] == "stiffness" else truck.secant_damping()
            truth = true[p["axle"] - 1]
            worst[p["quantity"]] = max(worst[p["quantity"]], abs(p["least_squares"]["value"] / truth - 1.0))
    return worst


def test_a_declared_rocker_of_a_leaf_tandem(tmp_path):
    result = fitted(tmp_path, THREE_AXLES, declare=ROCKER)
    worst = errors(result, THREE_AXLES)
    assert worst["stiffness"] < 0.004
    assert worst["damping"] < 0.006
    (rocker,) = result["rockers"]
    assert rocker["source"] == "estimated"
    assert rocker["q05"] < 0.8 < rocker["q95"]


def test_an_undeclared_rocker_is_named_on_the_first_screen(tmp_path):
    result = fitted(tmp_path, THREE_AXLES)
    worst = errors(result, THREE_AXLES)
    assert worst["stiffness"] < 0.004
    assert worst["damping"] < 0.006
    # Behind what is said of every fit that has not been sampled.
    assert "Axles 2 and 3 behave as if a rocker shared" in " ".join(result["warnings"][:2])
    (rocker,) = result["rockers"]
    assert (rocker["source"], rocker["axles"]) == ("proposed", [2, 3])
    assert rocker["load_share"] == pytest.approx(0.8, abs=0.02)
    page = (tmp_path / "output" / "report.html").read_text(encoding="utf-8")
    first_screen = page[page.index('<section class="first"') :].split("</section>")[0]
    assert "behave as if a rocker shared" in first_screen


def test_a_lowboy_whose_frame_bends(tmp_path):
    bending = "bending = { frequency_hz = 8.4, damping_ratio = 0.03 }"  # as far off as such numbers are
    result = fitted(tmp_path, LOWBOY, bending=bending, speeds=(12.0, 20.0))
    worst = errors(result, LOWBOY)
    assert worst["stiffness"] < 0.004
    assert worst["damping"] < 0.012
    by_name = {p["name"]: p["least_squares"]["value"] for p in result["parameters"]}
    assert by_name["bending_hz[body 2]"] == pytest.approx(8.0, rel=0.002)
    assert by_name["bending_ratio[body 2]"] == pytest.approx(0.025, rel=0.05)


def test_a_lowboy_of_which_nobody_said_that_its_frame_bends(tmp_path):
    result = fitted(tmp_path, LOWBOY, speeds=(12.0, 20.0))
    worst = errors(result, LOWBOY)
    assert worst["stiffness"] < 0.004
    assert worst["damping"] < 0.006
    assert "The frame of 'body 2' behaves as if it bends at 8.0" in " ".join(result["warnings"][:2])


def test_wheel_forces_of_a_lowboy_of_which_nobody_said_that_its_frame_bends(tmp_path):
    """The whole command, and a pass at a speed that nobody drove."""
    case = next(iter(LOWBOY.load_cases))
    write_truck_campaign(tmp_path / "campaign", LOWBOY, speeds=(12.0, 20.0), predicted=((case, 48.0),))
    output = tmp_path / "output"
    command = [sys.executable, "calibrate.py", "run", str(tmp_path / "campaign"), "--output", str(output)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=3600)
    assert done.returncode == 0, done.stderr
    result = json.loads((output / "result.json").read_text(encoding="utf-8"))
    (file,) = {p["file"] for p in result["predictions"]}
    ours = pd.read_csv(output / file)
    time, force = tire_forces(LOWBOY, case, 48.0)
    off = []
    for shift in np.arange(-0.05, 0.0501, 0.001):
        rms = []
        for i in range(force.shape[1]):
            given = np.interp(time + shift, ours["time_s"], ours[f"tire_force{i + 1}_N_q50"])
            rms.append(np.sqrt(np.mean((given - force[:, i]) ** 2) / np.mean((force[:, i] - force[0, i]) ** 2)))
        off.append((np.mean(rms), max(rms)))
    mean, largest = min(off)
    # Seen with -s, for the page of figures.
    sys.stdout.write(f"relative RMS of the wheel forces: mean of the axles {mean:.3f}, largest {largest:.3f}\n")
    assert mean < 0.03


@pytest.mark.parametrize(
    ("truck", "load_shift", "of_k", "of_c"),
    [
        (replace(THREE_AXLES, rocker=(), share=0.0), False, 0.003, 0.006),
        (replace(THREE_AXLES, rocker=(), share=0.0), True, 0.004, 0.012),
        (replace(LOWBOY, bending=()), False, 0.004, 0.012),
    ],
    ids=["three axles", "three axles with load shift", "lowboy"],
)
def test_a_truck_whose_speed_falls_by_five_per_cent(tmp_path, truck, load_shift, of_k, of_c):
    result = fitted(tmp_path, truck, changes=(-0.05,), load_shift=load_shift)
    worst = errors(result, truck)
    assert worst["stiffness"] < of_k
    assert worst["damping"] < of_c
    found = {(p["quantity"], p["run"]): p["least_squares"]["value"] for p in result["parameters"] if p["run"]}
    for file, (speed, change) in result["driven"].items():
        assert found["speed", file] == pytest.approx(speed, rel=0.006)
        assert found["speed_change", file] == pytest.approx(change, abs=0.006)


def test_what_a_constant_speed_makes_of_it(tmp_path):
    """The parameter switched off: the three axles that the test above finds within 0.3 %."""
    truck = replace(THREE_AXLES, rocker=(), share=0.0)
    result = fitted(tmp_path, truck, changes=(-0.05,), of_runs="speed_change_sd = 0")
    assert errors(result, truck)["stiffness"] > 0.03
    assert not [p for p in result["parameters"] if p["quantity"] == "speed_change"]


RUBBING = replace(THREE_AXLES, rocker=(), share=0.0)
DAMPERS = {"bump_ratio": 0.7, "rebound_ratio": 1.3, "knee_m_per_s": 1.2}
STOPS = {"jounce_m": 0.075, "rebound_m": 0.085, "declared": False}
AIR = {"air": (2.5, 30.0), "load_exponent": 0.7}
ON_AIR = replace(RUBBING, stiffness=(4.3e5, 2.6e5, 2.8e5), suspension=("leaf", "air", "air"))


@pytest.mark.parametrize(
    ("truck", "of_k", "of_c"),
    [
        (replace(RUBBING, elements=(Elements(friction_share=0.1),) * 3), 0.006, 0.015),
        (replace(RUBBING, elements=(Elements(knee_m_per_s=0.4),) * 3), 0.006, 0.006),
        (replace(THREE_AXLES, elements=(Elements(friction_share=0.06, **DAMPERS),) * 3), 0.008, 0.01),
        (
            replace(
                ON_AIR,
                elements=(Elements(friction_share=0.05, **DAMPERS, **STOPS),)
                + (Elements(**DAMPERS, **STOPS, **AIR),) * 2,
            ),
            0.02,
            0.02,
        ),
    ],
    ids=["10 % friction", "saturating dampers", "rocker that rubs", "air springs and stops"],
)
def test_laws_and_parts_that_nobody_declared(tmp_path, truck, of_k, of_c):
    worst = errors(fitted(tmp_path, truck), truck)
    assert worst["stiffness"] < of_k
    assert worst["damping"] < of_c
