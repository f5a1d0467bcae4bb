"""Files for other programs: read back by readers that share nothing with the writers, with the same numbers."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from dynakw import DynaKeywordReader, KeywordType
from hypothesis import given
from hypothesis import strategies as st
from keyword_reader import read_deck
from small_results import Words, small_campaign, small_results

from sysid.errors import CampaignError
from sysid.estimates.calibrated_elements import CalibratedFrame, CalibratedSuspension, CalibratedVehicle
from sysid.estimation.parameters.rockers import LoadShare
from sysid.export import chrono_merged, write_models
from sysid.export.bridge import vehicle_csv
from sysid.export.chrono import chrono_suspension, chrono_tire
from sysid.export.lsdyna import _field, lsdyna_text
from sysid.results.contents import Judgement

EXTENSION = np.linspace(-0.2, 0.2, 81)
RATE = np.linspace(-3.0, 3.0, 121)
K, C = 418851.283, 10964.0279
FRICTION = 2500.0


def spring(extension):
    """An isothermal gas spring."""
    return 27000.0 * extension / (0.09 + np.maximum(extension, -0.08))


def damper(rate):
    """Twice as strong in rebound."""
    return np.where(np.asarray(rate) > 0.0, 16000.0, 8000.0) * rate


def calibrated(load_case: str = "empty", name: str = "front axle") -> CalibratedVehicle:
    linear = CalibratedSuspension(0, name, "linear", 33000.0, K, C, EXTENSION, K * EXTENSION, RATE, C * RATE, 0.0)
    rich = CalibratedSuspension(
        1, "rear axle", "gas_spring + friction", 21000.0, 3e5, 12000.0, EXTENSION, spring(EXTENSION), RATE,
        damper(RATE), FRICTION,
    )  # fmt: skip
    return CalibratedVehicle(
        load_case, "posterior median", (linear, rich), np.array([1.6e6, 2.9e6]), np.array([2.9e3, 5.1e3])
    )


def test_keyword_file_has_the_linear_values():
    deck = read_deck(lsdyna_text(calibrated()))
    assert set(deck.parts) == set(deck.materials)
    for identifier, (_, section, material) in deck.parts.items():
        assert (section, material) == (9000, identifier)
    assert deck.sections[9000][0][:2] == ["9000", "0"]
    assert deck.materials[9011][0] == "*MAT_SPRING_ELASTIC"
    assert deck.materials[9012][0] == "*MAT_DAMPER_VISCOUS"
    expected = {9011: K, 9012: C, 9013: 1.6e6, 9014: 2.9e3, 9023: 2.9e6, 9024: 5.1e3}
    for identifier, value in expected.items():
        # Ten columns hold eight digits.
        assert float(deck.materials[identifier][1][0]) == pytest.approx(value, rel=1e-7)


def test_keyword_file_has_the_curves_of_the_other_laws(tmp_path):
    text = lsdyna_text(calibrated())
    deck = read_deck(text)
    assert deck.materials[9021] == ("*MAT_SPRING_NONLINEAR_ELASTIC", ["9021"])
    assert deck.materials[9022] == ("*MAT_DAMPER_NONLINEAR_VISCOUS", ["9022"])
    path = tmp_path / "deck.k"
    path.write_text(text)
    with DynaKeywordReader(str(path)) as reader:
        curves = {}
        for keyword in reader.find_keywords(KeywordType.DEFINE_CURVE):
            points = keyword.cards["Card 2"]
            curves[int(keyword.cards["Card 1"]["LCID"][0])] = np.asarray(points["A1"]), np.asarray(points["O1"])
    assert set(curves) == {9021, 9022} == set(deck.curves)
    extension, force = curves[9021]
    np.testing.assert_allclose(force, spring(extension), rtol=1e-10)
    rate, force = curves[9022]
    sliding = np.abs(rate) >= 0.01
    np.testing.assert_allclose(force[sliding], (damper(rate) + FRICTION * np.sign(rate))[sliding], rtol=1e-10)
    assert force[rate == 0.0] == pytest.approx([0.0])
    # The resampled curve keeps the friction's ramp, two hundredths of a metre per second wide.
    assert np.ptp(rate) / (int(deck.curve_heads[9022][7]) - 1) <= 0.01 / 2


def test_keyword_file_says_units_source_and_static_load():
    words = " ".join(read_deck(lsdyna_text(calibrated())).comments)
    assert "Units: kg, m, s, N." in words
    assert "load case empty, posterior median" in words
    assert "static load on the spring 33000.0 N" in words
    offset = float(words.split("gives the static load: ")[1].split()[0])
    assert K * offset == pytest.approx(-33000.0, rel=1e-6)


@pytest.mark.parametrize("name", ["*END", "a\n*MAT_SPRING_ELASTIC\n         1", "ünïcode " * 30, ""])
def test_no_name_breaks_a_keyword_file(name):
    deck = read_deck(lsdyna_text(calibrated(name, name)))
    assert len(deck.materials) == 8


@given(st.floats(1e-30, 1e30) | st.floats(-1e30, -1e-30) | st.just(0.0))
def test_fields_have_ten_columns_and_read_back(value):
    text = _field(value)
    assert len(text) == 10
    assert text.startswith(" ")
    assert float(text) == pytest.approx(value, rel=6e-3)
    if 1.0 <= value < 1e6:
        assert float(text) == pytest.approx(value, rel=1e-7)


#: The part of a Chrono suspension file that matters here, in the layout of its SolidAxle template.
TEMPLATE = {
    "Name": "my axle", "Type": "Suspension", "Template": "SolidAxle",
    "Spring": {"Location Chassis": [-0.08, 0.56, 0.5], "Location Axle": [-0.08, 0.56, 0.1],
               "Spring Coefficient": 1.0, "Damping Coefficient": 7.0, "Free Length": 9.0},
    "Shock": {"Location Chassis": [0.0, 0.5, 0.5], "Location Axle": [0.0, 0.5, 0.1],
              "Damping Curve Data": [[-1.0, -1.0], [1.0, 1.0]], "Spring Coefficient": 5.0, "Free Length": 0.1,
              "Map Data": [[0.0, 1.0]]},
    "Axle": {"Inertia": 0.4},
}  # fmt: skip


def chrono_force(element: dict, length: float, rate: float) -> float:
    """Extending force of a spring-damper as Chrono reads and evaluates it: F = P - K(l - l_0) - C(l')."""
    force = element.get("Preload", 0.0)
    if "Spring Curve Data" in element:
        force -= np.interp(length - element["Free Length"], *np.array(element["Spring Curve Data"]).T)
    elif "Spring Coefficient" in element:
        force -= element["Spring Coefficient"] * (length - element["Free Length"])
    if "Damping Curve Data" in element:
        force -= np.interp(rate, *np.array(element["Damping Curve Data"]).T)
    elif "Damping Coefficient" in element:
        force -= element["Damping Coefficient"] * rate
    return force


@pytest.mark.parametrize("axle", [0, 1])
def test_chrono_elements_give_the_forces_of_the_law(axle):
    vehicle = calibrated()
    patch = json.loads(json.dumps(chrono_suspension(vehicle, vehicle.suspensions[axle])))
    merged = chrono_merged(TEMPLATE, patch)
    assert merged["Axle"] == TEMPLATE["Axle"]
    assert merged["Template"] == "SolidAxle"
    assert merged["Spring"]["Location Axle"] == TEMPLATE["Spring"]["Location Axle"]
    at_rest = 0.4
    assert merged["Spring"]["Free Length"] == pytest.approx(at_rest)
    for e, v in ((0.0, 0.0), (0.05, 0.4), (-0.06, -1.2), (0.02, 0.0)):
        both = 2.0 * sum(chrono_force(merged[name], at_rest + e, v) for name in ("Spring", "Shock"))
        if axle == 0:
            expected = 33000.0 - K * e - C * v
        else:
            expected = 21000.0 - spring(e) - damper(v) - FRICTION * np.sign(v)
        assert both == pytest.approx(expected, rel=1e-9)
    assert not {"Map Data", "Preload"} & set(merged["Shock"])
    assert TEMPLATE["Spring"]["Damping Coefficient"] == 7.0


def test_chrono_needs_a_template_with_a_spring():
    vehicle = calibrated()
    patch = chrono_suspension(vehicle, vehicle.suspensions[0])
    with pytest.raises(CampaignError, match="Location Chassis"):
        chrono_merged({"Template": "HendricksonPRIMAXX"}, patch)


def test_chrono_tire_has_the_vertical_values_of_one_side():
    template = {"Template": "FialaTire", "Fiala Parameters": {"Width": 0.3, "Vertical Stiffness": 1.0, "UMAX": 1.0}}
    merged = chrono_merged(template, chrono_tire(calibrated(), 1))
    assert merged["Fiala Parameters"] == {
        "Width": 0.3, "Vertical Stiffness": 1.45e6, "Vertical Damping": 2.55e3, "UMAX": 1.0
    }  # fmt: skip


def test_vehicle_table_is_in_balance():
    campaign = small_campaign()
    rows = list(csv.DictReader(io.StringIO(vehicle_csv(campaign, calibrated()))))
    bodies, axles = ([r for r in rows if r["kind"] == kind] for kind in ("body", "axle"))
    weight = 9.81 * sum(float(r["mass_kg"]) for r in rows)
    load = np.array([float(r["static_load_N"]) for r in axles])
    # The table alone stands still: forces and moments about axle 1.  The loads of this campaign are exact.
    unsprung = np.array([float(r["mass_kg"]) for r in axles])
    place = np.array([float(r["x_m"]) for r in axles])
    assert load.sum() == pytest.approx(weight)
    assert (load - 9.81 * unsprung) @ place == pytest.approx(
        9.81 * sum(float(r["mass_kg"]) * float(r["x_m"]) for r in bodies)
    )
    assert float(axles[0]["suspension_stiffness_N_per_m"]) == K
    assert float(axles[1]["suspension_friction_N"]) == FRICTION
    assert [float(r["tire_damping_N_s_per_m"]) for r in axles] == [2.9e3, 5.1e3]
    assert axles[0]["hitch_x_m"] == ""
    assert {r["body"] for r in rows} == {"1"}
    assert {(r["load_case"], r["source"]) for r in rows} == {("empty", "posterior median")}


def test_all_files_are_written_and_hold_the_predicted_forces(tmp_path):
    results = small_results()
    vehicles = [calibrated(), calibrated("laden")]
    paths = write_models(results.campaign, vehicles, results.predictions, tmp_path)
    assert {str(p.relative_to(tmp_path)) for p in paths} == {
        *(f"models/{case}/{name}" for case in ("empty", "laden") for name in (
            "lsdyna.k", "vehicle.csv", "chrono_suspension1.json", "chrono_suspension2.json", "chrono_tire1.json",
            "chrono_tire2.json")),
        "moving_forces/empty_48kmh.csv",
    }  # fmt: skip
    assert all(p.is_file() for p in paths)
    forces = np.genfromtxt(tmp_path / "moving_forces/empty_48kmh.csv", delimiter=",", names=True)
    prediction = results.predictions.passes[0]
    speed = 48.0 / 3.6
    np.testing.assert_allclose(forces["station1_m"], speed * forces["time_s"], atol=1e-6)
    # The rear axle is five metres behind: at the same place 5 m / v later.
    np.testing.assert_allclose(forces["station1_m"] - forces["station2_m"], 5.0, atol=2e-6)
    for axle in (1, 2):
        bands = [forces[f"force{axle}_N_{q}"] for q in ("q05", "q50", "q95")]
        np.testing.assert_allclose(bands[1], prediction.tire_force_q50_N[axle - 1], atol=0.006)
        assert np.all(bands[0] <= bands[1])
        assert np.all(bands[1] <= bands[2])
    np.testing.assert_array_equal(forces["beyond_driven2"], prediction.beyond[1])


@pytest.mark.parametrize("trust", ["use", "do_not_bet"])
def test_every_model_file_carries_the_verdict(tmp_path, trust):
    """In each format's own way, read back: a comment of the keyword file, a comment of the patch, a column."""
    results = small_results()
    judgement = Judgement(trust, ("because",))
    paths = write_models(results.campaign, [calibrated()], None, tmp_path, judgement)
    words = f"Verdict: {trust} (trust and reasons: verdict in result.json)."
    for path in paths:
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".k":
            deck = read_deck(text)
            assert words in deck.comments
            assert set(deck.parts) == set(deck.materials)
        elif path.suffix == ".json":
            assert json.loads(text)["Comment"].endswith(f"SI. {words}")
        else:
            assert {row["verdict"] for row in csv.DictReader(io.StringIO(text))} == {trust}
    assert {path.suffix for path in paths} == {".k", ".json", ".csv"}


def test_without_a_judgement_files_claim_nothing():
    assert "Verdict" not in lsdyna_text(calibrated()) + str(chrono_tire(calibrated(), 0))
    assert {row["verdict"] for row in csv.DictReader(io.StringIO(vehicle_csv(small_campaign(), calibrated())))} == {""}


def test_no_cell_becomes_a_formula():
    text = vehicle_csv(small_campaign(Words(front="=cmd|x", rear="@sum")), calibrated())
    names = [r["name"] for r in csv.DictReader(io.StringIO(text))]
    assert "'=cmd|x" in names
    assert "'@sum" in names
    assert all(math.isfinite(float(r["mass_kg"])) for r in csv.DictReader(io.StringIO(text)))


def test_every_format_says_what_a_rocker_does():
    """Formats without rockers hold the springs alone and a sentence; the table has a row with the share."""
    rocker = LoadShare("tandem", (0, 1), 0.8, 0.7, 0.9)
    vehicle = replace(calibrated(), rockers=(rocker,))
    words = " ".join(read_deck(lsdyna_text(vehicle)).comments)
    assert "A rocker joins the springs of axles 1 and 2, load share 0.800" in " ".join(words.split())
    assert "rocker" not in " ".join(read_deck(lsdyna_text(calibrated())).comments)
    assert "load share 0.800" in chrono_suspension(vehicle, vehicle.suspensions[1])["Comment"]
    rows = list(csv.DictReader(io.StringIO(vehicle_csv(small_campaign(), vehicle))))
    (row,) = [r for r in rows if r["kind"] == "equaliser"]
    assert (row["name"], float(row["load_share"]), row["mass_kg"]) == ("tandem (1 2)", 0.8, "")
    assert all(r["load_share"] == "" for r in rows if r["kind"] != "equaliser")


def test_every_format_says_that_a_frame_bends():
    frame = CalibratedFrame(0, "truck", (0, 1), 7.5, 0.024, 8100.0)
    vehicle = replace(calibrated(), frames=(frame,))
    words = " ".join(" ".join(read_deck(lsdyna_text(vehicle)).comments).split())
    assert "bends: first free mode 7.500 Hz, damping ratio 0.0240, modal mass 8100 kg" in words
    assert "7.500 Hz" in chrono_suspension(vehicle, vehicle.suspensions[0])["Comment"]
    rows = list(csv.DictReader(io.StringIO(vehicle_csv(small_campaign(), vehicle))))
    (row,) = [r for r in rows if r["bending_frequency_hz"]]
    assert (row["kind"], float(row["bending_frequency_hz"]), float(row["bending_modal_mass_kg"])) == (
        "body",
        7.5,
        8100.0,
    )
