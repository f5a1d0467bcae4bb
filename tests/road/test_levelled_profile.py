"""A bump whose heights were measured along the road: profile, campaign file and command line."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from sysid.campaign.records import BumpShape, Scan
from sysid.cli.main import cli
from sysid.errors import DataRejectedError
from sysid.road.levelled_profile import levelled_profile
from sysid.road.scan import analyse_scan

TRUCK = Path(__file__).parents[2] / "examples" / "linear_truck"
HEIGHT_M, LENGTH_M = 0.08, 1.6


def rise(station_m: np.ndarray) -> np.ndarray:
    """A raised cosine."""
    inside = (station_m >= 0.0) & (station_m <= LENGTH_M)
    return np.where(inside, 0.5 * HEIGHT_M * (1.0 - np.cos(2.0 * np.pi * station_m / LENGTH_M)), 0.0)


def levelled(station_m: np.ndarray, height_m: np.ndarray) -> Scan:
    shape = BumpShape("points", station_m=tuple(station_m), heights_m=tuple(height_m), source="bump.csv")
    return Scan("bump", "bump.csv", 0.0, np.empty((0, 3)), shape)


@pytest.mark.parametrize(("step_m", "within_m"), [(0.02, 5e-5), (0.05, 2e-4), (0.1, 8e-4)])
def test_the_curve_keeps_the_shape(step_m: float, within_m: float) -> None:
    station = np.arange(-0.2, LENGTH_M + 0.2 + 1e-9, step_m)
    analysis = analyse_scan(levelled(station, rise(station)))
    profile = analysis.profile
    begin = profile.station_m[-1] / 2.0 - LENGTH_M / 2.0
    assert profile.height_m == pytest.approx(rise(profile.station_m - begin), abs=within_m)
    # Where the heights stand in the figure, the curve passes.
    at = np.interp(analysis.strip_station_m, profile.station_m, profile.height_m)
    assert at == pytest.approx(analysis.strip_height_m, abs=1e-4)
    assert not analysis.scanned


def test_stations_that_are_far_apart_are_remarked_on() -> None:
    station = np.linspace(0.0, LENGTH_M, 9)
    assert "0.20 m apart" in " ".join(levelled_profile(levelled(station, rise(station))).messages)
    station = np.linspace(0.0, LENGTH_M, 81)
    assert "apart" not in " ".join(levelled_profile(levelled(station, rise(station))).messages)


@pytest.mark.parametrize("height_m", [np.zeros(5), np.array([0.0, 0.05, 0.08, 0.05, 0.02]), np.full(5, np.nan)])
def test_heights_that_are_no_bump_are_refused(height_m: np.ndarray) -> None:
    with pytest.raises(DataRejectedError):
        levelled_profile(levelled(np.linspace(0.0, 1.0, 5), height_m))


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """The linear truck with a profile of 71 heights in place of its scan."""
    folder = tmp_path / "campaign"
    shutil.copytree(TRUCK, folder)
    (folder / "bump_scan.csv").unlink()
    station = np.arange(0.0, LENGTH_M + 1e-9, 0.02)
    rows = [f"{s:.2f},{h:.5f}" for s, h in zip(station, rise(station), strict=True)]
    (folder / "bump.csv").write_text("station_m,height_m\n" + "\n".join(rows) + "\n")
    file = folder / "campaign.toml"
    lines = file.read_text().splitlines()
    first = lines.index("[scan]")
    last = next(i for i, line in enumerate(lines[first + 1 :], first + 1) if not line or line.startswith("["))
    file.write_text("\n".join([*lines[:first], "[scan]", 'profile = "bump.csv"', *lines[last:]]))
    return folder


def check(campaign: Path, output: Path) -> Result:
    return CliRunner().invoke(cli, ["check", str(campaign), "--output", str(output)], env={"COLUMNS": "200"})


def test_check_shows_the_bump(campaign: Path, tmp_path: Path) -> None:
    found = check(campaign, tmp_path / "out")
    assert found.exit_code == 0
    assert "80.0" in found.output
    assert "goes through 81 heights" in found.output


def test_check_refuses_a_pass_that_only_the_length_of_the_bump_makes_too_long(campaign: Path, tmp_path: Path) -> None:
    file = campaign / "campaign.toml"
    text = file.read_text()
    # 15.93 m take 294 s; the bump is longer than the 0.32 m that are left.
    file.write_text(text.replace("speed_km_h = 24 }", "speed_km_h = 0.195 }"))
    found = check(campaign, tmp_path / "out")
    assert found.exit_code == 2
    assert "the pass of tests.prediction[2].speed_km_h takes 3" in found.output
    file.write_text(text.replace("speed_km_h = 24 }", "speed_km_h = 0.3 }"))
    assert check(campaign, tmp_path / "out").exit_code == 0


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('profile = "bump.csv"', 'profile = "bump.csv"\nheading_deg = 3', "leave out file, heading_deg"),
        ('profile = "bump.csv"', 'profile = "bump.csv"\nunit = "m"', "leave out file, heading_deg"),
        ('profile = "bump.csv"', 'unit = "m"', "heights along the road as profile"),
        ('profile = "bump.csv"', 'file = "bump.csv"', "heading_deg"),
        ('profile = "bump.csv"', 'profile = "missing.csv"', "missing.csv"),
        ('profile = "bump.csv"', 'profile = "../bump.csv"', "bump.csv"),
    ],
)
def test_a_wrong_table_is_one_sentence(campaign: Path, tmp_path: Path, old: str, new: str, words: str) -> None:
    file = campaign / "campaign.toml"
    file.write_text(file.read_text().replace(old, new))
    found = check(campaign, tmp_path / "out")
    assert found.exit_code == 2
    assert words in " ".join(found.output.split())


def test_a_profile_without_columns_is_one_sentence(campaign: Path, tmp_path: Path) -> None:
    (campaign / "bump.csv").write_text("x,z\n0,0\n1,0.05\n2,0\n")
    found = check(campaign, tmp_path / "out")
    assert found.exit_code == 3
    assert "station_m and height_m" in " ".join(found.output.split())
