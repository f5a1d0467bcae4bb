"""Files with the numbers of the paper's figures: which there are, and what stands in them."""

import csv
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hostile_text import HOSTILE
from small_results import Words, campaign_only, small_campaign, small_results

from sysid.report import write_paper_figures
from sysid.road import effective_profiles, half_sine, spoke_table
from sysid.road.enveloping import static_deflection

TEXT = "{http://www.w3.org/2000/svg}text"


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    return {p.name: p for p in write_paper_figures(small_results(), tmp_path_factory.mktemp("figures"))}


def words(path):
    return " ".join(e.text or "" for e in ET.parse(path).getroot().iter(TEXT))


def test_every_figure_of_the_paper_has_its_file(written):
    assert sorted(written) == [
        "figure_5_bump.svg", "figure_6c_plank_drops.svg", "figure_7_first_axle.svg", "figure_8_last_axle.svg",
        "figure_9a_load_ratio.svg", "figure_9b_suspension_force.svg", "table_1_axle_loads.csv",
    ]  # fmt: skip
    assert "axle 1, suspension deflection (sensor0_mm)" in words(written["figure_7_first_axle.svg"])
    assert "empty 20 km/h, driven at 20.2 km/h" in words(written["figure_7_first_axle.svg"])
    assert "axle 2, suspension deflection (sensor1_mm)" in words(written["figure_8_last_axle.svg"])
    assert "axle 1, empty, 48 km/h" in words(written["figure_9a_load_ratio.svg"])
    assert "suspension force [kN]" in words(written["figure_9b_suspension_force.svg"])
    assert "rise of the wheel centre [mm]" in words(written["figure_5_bump.svg"])
    rows = list(csv.reader(written["table_1_axle_loads.csv"].read_text(encoding="utf-8").splitlines()))
    assert rows[1:] == [["axle 1", "4000", "4000"], ["axle 2", "3000", "3000"], ["total", "7000", "7000"]]


def test_before_any_stage_there_is_nothing_to_write(tmp_path):
    assert write_paper_figures(campaign_only(), tmp_path) == []


def test_hostile_names_stay_text_in_the_files(tmp_path, written):
    expected = {e.tag for e in ET.parse(written["figure_7_first_axle.svg"]).getroot().iter()}
    made = {p.name: p for p in write_paper_figures(small_results(Words.all("=" + HOSTILE)), tmp_path)}
    assert set(made) == set(written)
    assert {e.tag for e in ET.parse(made["figure_7_first_axle.svg"]).getroot().iter()} == expected
    rows = list(csv.reader(made["table_1_axle_loads.csv"].read_text(encoding="utf-8").splitlines()))
    assert rows[0][1].startswith("'=")


def test_what_a_tire_feels_is_what_its_springs_carry():
    """Laid on the profile at its effective height, the wheel carries its static load again: summed by hand."""
    campaign, profile = small_campaign(), half_sine(0.08, 0.9)
    vehicle, case = campaign.vehicle, campaign.load_cases["empty"]
    roads = effective_profiles(vehicle, case, case, profile)
    assert [r.axle for r in roads] == [0, 1]
    for road, axle, mass in zip(roads, vehicle.axles, case.axle_loads_kg, strict=True):
        radius, load = axle.tire_radius_m, 9.81 * mass
        table = spoke_table(profile, radius)
        deflection = static_deflection(table, load, axle.tire_stiffness_N_per_m)
        unit = load / np.interp(deflection, table.deflection_m, table.flat_force)
        row = int(np.argmin(np.abs(table.station_m - 0.3)))
        height = radius - deflection + road.rise_m[row]
        force = unit * np.interp(table.contact_height_m[row] - height, table.deflection_m, table.force[row])
        assert force == pytest.approx(load, rel=0.01)
