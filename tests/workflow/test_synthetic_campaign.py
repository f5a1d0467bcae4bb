"""The writer of synthetic campaigns: its folders are read without complaint and hold what their truth says."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest
from campaign_files import campaign_text
from synthetic_campaign import Physics, bump_height, main, true_vehicle, write_campaign
from vehicles import NAMES, example_vehicle

from sysid.campaign import check_quality, read_campaign
from sysid.campaign.statics import check_statics
from sysid.campaign.toml.schema import CampaignFile
from sysid.road import analyse_scan, read_point_cloud
from sysid.vehicle_model.vibration_modes import natural_modes

SMALL = Physics(speeds_km_h=(25.0,), drops_per_axle=1, bump_length_m=0.6, scan_points=6000, seed=5, axle_range_g=50.0)


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    folder = tmp_path_factory.mktemp("synthetic")
    return folder, write_campaign(folder, SMALL)


def test_folder_is_a_campaign_of_good_quality(small):
    folder, _ = small
    campaign, report = check_quality(read_campaign(folder, point_cloud_reader=read_point_cloud))
    assert [c.verdict for c in report.channels if c.verdict != "good"] == []
    assert len(campaign.plank_drops) == 3
    assert [r.load_case for r in campaign.bump_runs] == ["empty", "laden"]
    profile = analyse_scan(campaign.scans["bump"]).profile
    assert profile.height_m.max() == pytest.approx(SMALL.bump_height_m, abs=2e-3)


def test_axle_1_meets_the_bump_when_the_truth_says(small):
    folder, _ = small
    truth = tomllib.loads((folder / "truth.toml").read_text(encoding="utf-8"))
    campaign = read_campaign(folder, point_cloud_reader=read_point_cloud)
    for run, behind in zip(campaign.bump_runs, truth["bump_run"], strict=True):
        assert run.log.file == behind["file"]
        assert behind["speed_m_s"] == pytest.approx(run.nominal_speed_m_s, rel=0.06)
        channel = next(c for c in run.log.channels if c.sensor.column == "axle1_accel_g")
        level = channel.value - np.median(channel.value)
        first = channel.time_s[np.flatnonzero(np.abs(level) > 3.0)[0]]
        # The tire touches a rising bump half a footprint before its start.
        assert -0.05 < first - behind["start_s"] < 0.06
    for drop, behind in zip(campaign.plank_drops, truth["plank_drop"], strict=True):
        deflection = drop.log.channels[0]
        after = deflection.time_s > behind["start_s"]
        assert np.ptp(deflection.value[~after]) < 0.012
        assert np.ptp(deflection.value[after]) > 0.03


def test_same_seed_same_truck():
    example = example_vehicle("rigid3")
    spread = replace(SMALL, parameter_spread=0.2, unsprung_spread=0.05, inertia_spread=0.05)
    one, two = (true_vehicle(example, spread, np.random.default_rng(9)) for _ in range(2))
    assert one.values == two.values
    assert one.values["k_2[laden]"] / one.values["k_2[empty]"] == pytest.approx(620 / 330)
    assert one.values["k_1"] != pytest.approx(430e3, rel=1e-3)
    for case in one.load_cases.values():
        check_statics(one.vehicle, case)
        declared = example.load_cases[case.name]
        assert sum(case.sprung_mass_kg) != pytest.approx(sum(declared.sprung_mass_kg), abs=1.0)


@pytest.mark.parametrize("name", NAMES)
def test_every_vehicle_makes_a_campaign_file(name):
    example = example_vehicle(name)
    physics = Physics(vehicle=name, suspension_law="friction + asymmetric_damper")
    tables = tomllib.loads(campaign_text(example, physics, [], []))
    tables["scan"] = {"bump": tables["scan"]}
    read = CampaignFile.model_validate(tables)
    assert {a.suspension_law for a in read.vehicle.axle} == {"friction + asymmetric_damper"}
    truth = true_vehicle(example, physics, np.random.default_rng(1))
    assert "F_1" in truth.values
    # Ordinary vehicles: bodies between 1 and 5 Hz, nothing overdamped.
    case = next(iter(example.load_cases))
    behind = example.behind
    rates = (behind.stiffness[case], behind.damping, behind.tire_stiffness, behind.tire_damping)
    modes = natural_modes(example.vehicle, example.load_cases[case], *rates)
    assert 1.0 < modes.frequency_hz[0] < 2.0
    assert modes.damping_ratio.max() < 0.7


@pytest.mark.parametrize("shape", ["cosine", "parabola", "table"])
def test_bumps_have_their_height_and_length(shape):
    physics = Physics(bump_shape=shape, bump_height_m=0.06, bump_length_m=1.2)
    height = bump_height(physics, np.array([-0.61, -0.6, -0.59, 0.0, 0.59, 0.6, 0.61]))
    assert height[3] == pytest.approx(0.06)
    np.testing.assert_allclose(height[[0, 1, 5, 6]], 0.0, atol=1e-15)
    assert height[[2, 4]].min() > 0.0


def test_command_line_names_every_option(capsys):
    with pytest.raises(SystemExit) as end:
        main(["--help"])
    assert end.value.code == 0
    text = capsys.readouterr().out
    for option in ("--vehicle", "--suspension-law", "--tire-exponent", "--unsprung-spread", "--speeds-km-h"):
        assert option in text
