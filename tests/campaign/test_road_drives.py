"""Drives over ordinary roads are read with the sensors of the bump runs, or refused in a sentence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sysid.campaign.quality.check import check_quality
from sysid.campaign.read import read_campaign
from sysid.errors import CampaignError

TEXT = """
schema = 1
[campaign]
title = "drives"
[vehicle]
name = "truck"
[[vehicle.body]]
name = "body"
[[vehicle.axle]]
name = "front"
body = "body"
x_m = 0.0
unsprung_mass_kg = 500
tire_stiffness_N_per_m = 1.6e6
tire_damping_N_s_per_m = 3000
tire_radius_m = 0.5
suspension = "leaf"
[[vehicle.axle]]
name = "rear"
body = "body"
x_m = 4.0
unsprung_mass_kg = 900
tire_stiffness_N_per_m = 2.9e6
tire_damping_N_s_per_m = 3000
tire_radius_m = 0.5
suspension = "leaf"
[load_case.empty]
axle_loads_kg = [4500, 5000]
sprung_mass_kg = [8100]
pitch_inertia_kg_m2 = [20000]
cg_height_m = [1.1]
[acquisition]
sample_interval_s = 0.005
[sensors.bump_run]
q1 = { kind = "suspension_deflection", axle = "front", unit = "mm" }
speed = { kind = "speed", unit = "km/h" }
[tests]
road_drive = [ENTRY]
"""


def written(folder: Path, entry: str, speed: bool = True) -> Path:
    time = 0.005 * np.arange(2000)
    columns = {"time_s": time, "q1": 3.0 * np.sin(9.0 * time)} | ({"speed": 0.0 * time + 54.0} if speed else {})
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(folder / "drive.csv", rows, delimiter=",", header=",".join(columns), comments="", fmt="%.4f")
    (folder / "campaign.toml").write_text(TEXT.replace("ENTRY", entry), encoding="utf-8")
    return folder


def test_a_drive_has_its_listed_speed_or_the_logged_one(tmp_path: Path) -> None:
    listed = '{ file = "drive.csv", load_case = "empty", nominal_speed_km_h = 72 }'
    (drive,) = read_campaign(written(tmp_path, listed)).road_drives
    assert (drive.load_case, drive.speed_m_s, drive.speed_held) == ("empty", pytest.approx(20.0), "servo")
    assert [c.sensor.column for c in drive.log.channels] == ["q1"]
    logged = '{ file = "drive.csv", load_case = "empty", speed_held = "free" }'
    campaign = read_campaign(written(tmp_path, logged))
    assert campaign.road_drives[0].speed_m_s == pytest.approx(15.0)
    assert campaign.load_cases_in_use == ("empty",)
    assert set(campaign.input_sha256) == {"campaign.toml", "drive.csv"}


def test_a_drive_of_no_speed_or_no_load_case_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CampaignError, match=r"tests\.road_drive\[1\] has no nominal_speed_km_h"):
        read_campaign(written(tmp_path, '{ file = "drive.csv", load_case = "empty" }', speed=False))
    with pytest.raises(CampaignError, match="full"):
        read_campaign(written(tmp_path, '{ file = "drive.csv", load_case = "full", nominal_speed_km_h = 50 }'))


def test_nobody_expects_a_drive_to_begin_at_rest(tmp_path: Path) -> None:
    _, report = check_quality(
        read_campaign(written(tmp_path, '{ file = "drive.csv", load_case = "empty", nominal_speed_km_h = 50 }'))
    )
    assert not any("at rest" in m for m in report.messages)


def test_channels_of_drives_are_checked(tmp_path: Path) -> None:
    folder = written(tmp_path, '{ file = "drive.csv", load_case = "empty", nominal_speed_km_h = 50 }')
    text = (folder / "drive.csv").read_text(encoding="utf-8").splitlines()
    dead = [text[0], *(f"{row.split(',')[0]},1.0,54.0" for row in text[1:])]
    (folder / "drive.csv").write_text("\n".join(dead), encoding="utf-8")
    cleaned, report = check_quality(read_campaign(folder))
    assert cleaned.road_drives == ()
    assert any(c.column == "q1" and c.verdict == "rejected" for c in report.channels)
