"""The examples for other bridge programs, run as a user would with files of a pass: their numbers are ours.

PyCBA, ospgrillage and OpenSeesPy are written by others: what they compute is the oracle of our load effects.
"""

from __future__ import annotations

import csv
import io
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from coupled_truck import TRUCK
from lowboy_fit import state_of

from sysid.bridge.code_vehicles import LOAD_MODELS
from sysid.campaign.bridges import BridgeCourse, BridgeDescription, Surface
from sysid.campaign.records import PredictionRequest
from sysid.campaign.roads import RoadCourse
from sysid.estimates.calibrated_elements import CalibratedSuspension, CalibratedVehicle
from sysid.export.bridge import moving_forces_csv, vehicle_csv
from sysid.prediction.bridge_loads import BridgeVehicles, predict_bridge
from sysid.prediction.driven_range import driven_range
from sysid.prediction.predicted_passes import PassPrediction

pytestmark = pytest.mark.bridges

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "bridges"
SPANS, STIFFNESS, MASS, DAMPING, SPEED = (20.0, 25.0), 2.0e10, 12000.0, 0.015, 22.0


def needs(package: str) -> None:
    if find_spec(package) is None:
        pytest.skip(f"{package} is not installed; see `make test-bridges`")


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> tuple[Path, PassPrediction]:
    """The bridge, the vehicle and the moving forces of a pass, and the pass."""
    folder, state = tmp_path_factory.mktemp("bridge"), state_of(TRUCK)
    described = BridgeDescription(
        "river", SPANS, ("pinned",) * 3, (STIFFNESS,) * 2, (MASS,) * 2, (DAMPING,), 10, (10.0, 32.5)
    )
    course = BridgeCourse(described, Surface(RoadCourse(0.0, "B", 3, 1), 0.0))
    request = PredictionRequest("laden", SPEED, course.label, bridge=course)
    sets = state.point.log_parameters[None]
    found = predict_bridge(BridgeVehicles(state, sets, None, None), request, driven_range(state))
    line = np.array([-0.1, 0.1])
    suspensions = tuple(
        CalibratedSuspension(i, f"axle {i + 1}", "linear", 1e5, k, c, line, k * line, line, c * line, 0.0)
        for i, (k, c) in enumerate(zip(TRUCK.stiffness, TRUCK.damping, strict=True))
    )
    tires = np.array(TRUCK.tire_N_per_m), np.array(TRUCK.tire_N_s_per_m)
    vehicle = CalibratedVehicle("laden", "least squares", suspensions, *tires)
    texts = {
        "vehicle.csv": vehicle_csv(state.campaign, vehicle),
        "forces.csv": moving_forces_csv(state.campaign, found),
    }
    keys = f"bending_stiffness_N_m2 = {STIFFNESS}\nmass_kg_m = {MASS}\ndamping_ratio = {DAMPING}\n"
    texts |= {"two.toml": f"spans_m = {list(SPANS)}\n{keys}", "one.toml": f"spans_m = [30.0]\n{keys}"}
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder, found


def run(script: str, folder: Path, *names: str) -> dict[str, list[float]]:
    """What an example prints: its rows by their first cell."""
    command = [sys.executable, str(EXAMPLES / script), *(str(folder / name) for name in names)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stdout.splitlines() if "," in line]
    _, *rows = csv.reader(io.StringIO("\n".join(lines)))
    return {first: [float(cell) for cell in cells] for first, *cells in rows}


def effect(found: PassPrediction, word: str):
    assert found.bridge is not None
    return next(e for e in found.bridge.effects if e.name == word and e.sense == "largest")


def test_pycba_finds_the_static_and_the_rolling_moments(files):
    needs("pycba")
    folder, found = files
    rows = run("pycba_beam.py", folder, "two.toml", "vehicle.csv", "forces.csv")
    for at, name in (("10", "moment at 10 m"), ("32.5", "moment at 32.5 m")):
        ours = effect(found, name)
        static, rolling = (1e3 * value for value in rows[at])
        # It steps by 0.1 m, and the forces are written every 4 ms.
        assert static == pytest.approx(ours.static.q50[0], rel=2e-3)
        assert rolling == pytest.approx(ours.rolling.q50[0], rel=0.02)


def test_opensees_finds_the_dynamic_moments_and_deflections(files):
    needs("openseespy")
    folder, found = files
    rows = run("openseespy_beam.py", folder, "two.toml", "forces.csv")
    for at, middle in (("10", "10 m"), ("32.5", "32.5 m")):
        moment, deflection = effect(found, f"moment at {middle}"), effect(found, f"deflection at {middle}")
        assert 1e3 * rows[at][0] == pytest.approx(moment.dynamic.q50[0], rel=5e-3)
        assert 1e-3 * rows[at][1] == pytest.approx(deflection.dynamic.q50[0], rel=5e-3)
        # The negative control: at rest it is another number.
        assert 1e3 * rows[at][0] != pytest.approx(moment.static.q50[0], rel=5e-3)


def test_all_members_of_a_grillage_bear_what_one_beam_bears(files):
    """Across mid-span the members together are in balance with the axles, whatever the deck."""
    needs("ospgrillage")
    folder, _ = files
    rows = run("ospgrillage_deck.py", folder, "one.toml", "vehicle.csv")
    load, x = 9.81 * np.array(TRUCK.load_cases["laden"][0]), np.array(TRUCK.x_m)
    place = np.linspace(0.0, 30.0 + x.max(), 100)[:, None] - x
    hand = (np.clip(np.minimum(place, 30.0 - place), 0.0, None) / 2 @ load).max()
    assert 1e3 * rows["all"][0] == pytest.approx(hand, rel=1e-3)
    members = [row[0] for name, row in rows.items() if name != "all"]
    assert len(members) == 6
    assert max(members) < 0.6 * rows["all"][0]


def test_load_models_of_codes_are_those_of_pycba():
    """Axles and distances as another program has them from the codes."""
    needs("pycba")
    from pycba import VehicleLibrary as Library

    library = {
        "LM1": Library.EU.get_lm1(),
        "HL-93": Library.US.get_hl93_truck(),
        "CL-625": Library.CA.get_cl625(),
        "M1600": Library.AU.get_m1600(6.25),
        "HB 45": Library.UK.get_hb(45.0, 6.0),
    }
    for model in LOAD_MODELS:
        other = library[model.name]
        trains = [train for train, _ in model.combinations]
        assert any(
            len(t.load_kN) == len(other.axw)
            and np.allclose(t.load_kN, other.axw)
            and np.allclose(t.x_m, other.axle_coords)
            for t in trains
        ), model.name
