"""Patches for Chrono::Vehicle, merged into Chrono's own files and read by the rules of its readers."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from chrono_reader import REQUIRED, element, fiala_vertical, suspension

from sysid.errors import CampaignError
from sysid.estimates.calibrated_elements import CalibratedSuspension, CalibratedVehicle
from sysid.export import chrono_merged, read_chrono
from sysid.export.chrono import chrono_suspension, chrono_text, chrono_tire

DATA = Path(__file__).resolve().parents[1] / "data" / "chrono"
#: Files with a spring whose stops leave it alone at rest, and what kinds of elements they come with.
TEMPLATES = {
    "SolidAxle": ("linear spring", "linear damper"),
    "MTV_SolidThreeLinkAxleR": ("spring curve", "damper curve"),
    "HMMWV_DoubleWishboneFront_mapShock": ("linear spring", "map"),
    "MacPhersonStrut": ("linear spring", "linear damper"),
    "MultiLink": ("linear spring", "linear damper"),
}
EXTENSION, RATE = np.linspace(-0.2, 0.2, 81), np.linspace(-3.0, 3.0, 121)
K, C, LOAD = 4.2e5, 1.1e4, 33000.0
#: Small enough for the stops of all templates; a corner of neither curve.
EXCURSIONS = ((0.0, 0.0), (0.02, 0.4), (-0.035, -1.2), (0.013, 0.0))


def spring(extension):
    return np.where(np.asarray(extension) > 0.0, 2e5, 3e5) * extension


def damper(rate):
    return np.where(np.asarray(rate) > 0.0, 1.6e4, 8e3) * rate


LINEAR = CalibratedSuspension(0, "front", "linear", LOAD, K, C, EXTENSION, K * EXTENSION, RATE, C * RATE, 0.0)
RICH = CalibratedSuspension(
    0, "front", "damper_asymmetry", LOAD, 3e5, 1.2e4, EXTENSION, spring(EXTENSION), RATE, damper(RATE), 0.0
)
LAWS = {
    "linear": (LINEAR, lambda e, v: LOAD - K * e - C * v),
    "rich": (RICH, lambda e, v: LOAD - spring(e) - damper(v)),
}


def vehicle(s: CalibratedSuspension) -> CalibratedVehicle:
    return CalibratedVehicle("empty", "posterior median", (s,), np.array([1.6e6]), np.array([3e3]))


def patch_of(s: CalibratedSuspension) -> dict:
    return json.loads(chrono_text(chrono_suspension(vehicle(s), s)))


@pytest.mark.parametrize("template", TEMPLATES)
def test_chronos_own_files_follow_the_rules_of_its_readers(template):
    document = read_chrono(DATA / f"{template}.json")
    spring_found, shock_found, _ = suspension(document)
    assert (spring_found.kind, shock_found.kind) == TEMPLATES[template]
    # The reader of this test misses what the C++ would miss.
    for part in REQUIRED[document["Template"]]:
        with pytest.raises(KeyError):
            suspension({k: v for k, v in document.items() if k != part})
    with pytest.raises(KeyError):
        element({k: v for k, v in document["Spring"].items() if k != "Free Length"})


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("template", TEMPLATES)
def test_merged_files_are_complete_and_carry_the_calibrated_force(template, law):
    calibrated, expected = LAWS[law]
    document = read_chrono(DATA / f"{template}.json")
    found, shock, rest = suspension(json.loads(json.dumps(chrono_merged(document, patch_of(calibrated)))))
    assert found.kind == ("linear spring" if law == "linear" else "spring curve")
    assert shock.kind == ("linear damper" if law == "linear" else "damper curve")
    for e, v in EXCURSIONS:
        both = 2.0 * (found.force(rest + e, v) + shock.force(rest + e, v))
        assert both == pytest.approx(float(expected(e, v)), rel=1e-9)


def test_stops_of_the_template_give_way_to_those_of_the_law():
    document = read_chrono(DATA / "MTV_SolidThreeLinkAxleR.json")
    kept, _, _ = suspension(chrono_merged(document, patch_of(LINEAR)))
    assert kept.stops == (0.22, 0.38)
    own, _, _ = suspension(chrono_merged(document, patch_of(replace(RICH, law="gas_spring + bump_stops"))))
    assert own.stops is None


def test_stops_that_press_at_rest_are_said():
    # This file of Chrono's has its shortest and its longest length in each other's place.
    document = read_chrono(DATA / "UAZBUS_RearLeafspringAxle.json")
    with pytest.raises(CampaignError, match=r"0.2 m long .* 'Minimum Length' is 0.28 and 'Maximum Length' 0.12"):
        chrono_merged(document, patch_of(LINEAR))
    document["Spring"] |= {"Minimum Length": 0.12, "Maximum Length": 0.28}
    found, shock, rest = suspension(chrono_merged(document, patch_of(LINEAR)))
    # Chrono makes a degressive damper of the template's keys; the calibrated one is linear.
    assert shock.kind == "linear damper"
    assert found.force(rest, 0.0) == pytest.approx(LOAD / 2.0)


@pytest.mark.parametrize("template", ["FialaTire", "HMMWV_FialaTire"])
def test_tires_have_the_calibrated_stiffness_also_where_the_template_has_a_curve(template):
    document = read_chrono(DATA / f"{template}.json")
    before = fiala_vertical(document, 0.03, 0.0)
    merged = chrono_merged(document, json.loads(chrono_text(chrono_tire(vehicle(LINEAR), 0))))
    assert fiala_vertical(merged, 0.03, 0.1) == pytest.approx(0.5 * (1.6e6 * 0.03 + 3e3 * 0.1))
    assert before != pytest.approx(0.5 * 1.6e6 * 0.03)


def test_comments_of_chronos_files_are_no_json_but_are_read(tmp_path):
    with pytest.raises(json.JSONDecodeError):
        json.loads((DATA / "HMMWV_FialaTire.json").read_text())
    assert len(read_chrono(DATA / "HMMWV_FialaTire.json")["Fiala Parameters"]["Vertical Curve Data"]) == 17
    path = tmp_path / "file.json"
    path.write_text('{"a": "http://x /* y */ \\" // z", /* one\ntwo */ "b": 1} // end')
    assert read_chrono(path) == {"a": 'http://x /* y */ " // z', "b": 1}
    for text, said in (("{", "is no JSON"), ("[1]", "holds no JSON object"), ("\0", "is no JSON")):
        path.write_text(text)
        with pytest.raises(CampaignError, match=said):
            read_chrono(path)
    path.write_bytes(b"\xff\xfe\x00{")
    with pytest.raises(CampaignError, match="is no JSON"):
        read_chrono(path)
    with pytest.raises(CampaignError, match="cannot be read"):
        read_chrono(tmp_path / "none.json")
