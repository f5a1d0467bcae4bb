"""A campaign file with other values: what a notebook changes in vehicle, laws and tests."""

from __future__ import annotations

import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest

from sysid.campaign import changed_campaign
from sysid.campaign.declared import read_declared
from sysid.errors import CampaignError

ROOT = Path(__file__).parents[2]


@pytest.fixture
def source(tmp_path: Path) -> Path:
    return Path(shutil.copy(ROOT / "data" / "campaign.toml", tmp_path / "campaign.toml"))


def test_without_changes_the_file_says_the_same(source: Path) -> None:
    before = source.read_bytes()
    made = changed_campaign(source, "other.toml", {})
    assert tomllib.loads(made.read_text(encoding="utf-8")) == tomllib.loads(before.decode("utf-8"))
    assert (made.parent, source.read_bytes()) == (source.parent, before)


def test_a_law_is_a_function_of_ones_own(source: Path) -> None:
    def force(extension: np.ndarray) -> np.ndarray:
        return 4e5 * extension + 2e7 * extension**3

    at = np.linspace(-0.1, 0.1, 33)
    law = {"extension_m": at, "force_N": force(at)}
    changes = {"vehicle.axle[4].suspension_law": "spring_table", "vehicle.axle[4].spring_table": law}
    axles = read_declared(changed_campaign(source, "law.toml", changes)).vehicle.vehicle.axles
    assert axles[3].suspension_law == "spring_table"
    np.testing.assert_allclose(np.interp(0.05, at, axles[3].spring_table.force_N), force(np.array(0.05)), rtol=1e-9)
    assert axles[4].spring_table is None


def test_values_are_changed_added_and_removed(source: Path) -> None:
    tables = tomllib.loads(source.read_text(encoding="utf-8"))
    changes = {
        "vehicle.axle[2].unsprung_mass_kg": np.float64(512.5),
        f"tests.bump_run[{len(tables['tests']['bump_run']) + 1}]": tables["tests"]["bump_run"][0],
        "acquisition.filter": None,
        'load_case."half full"': tables["load_case"]["loaded"],
    }
    made = tomllib.loads(changed_campaign(source.parent, "made.toml", changes).read_text(encoding="utf-8"))
    assert made["vehicle"]["axle"][1]["unsprung_mass_kg"] == 512.5
    assert made["tests"]["bump_run"] == [*tables["tests"]["bump_run"], tables["tests"]["bump_run"][0]]
    assert "filter" not in made["acquisition"]
    assert made["load_case"]["half full"] == tables["load_case"]["loaded"]


@pytest.mark.parametrize(
    ("name", "changes", "said"),
    [
        ("x.toml", {"vehicle.axle[9].x_m": 1.0}, "leads nowhere"),
        ("x.toml", {"vehicle.axle[8]": {}}, "leads nowhere"),
        ("x.toml", {"vehicle.axle[7]": None}, "leads nowhere"),
        ("x.toml", {"vehicle.axel": 1}, "did you mean 'axle'"),
        ("x.toml", {"vehicle..axle": 1}, "is no key"),
        ("x.toml", {"vehicle.axle[1].unsprung_mass_kg": "heavy"}, "unsprung_mass_kg"),
        ("campaign.toml", {}, "is no name"),
        ("../x.toml", {}, "is no name"),
    ],
)
def test_wrong_changes_write_nothing(source: Path, name: str, changes: dict[str, object], said: str) -> None:
    before = source.read_bytes()
    with pytest.raises(CampaignError, match=said):
        changed_campaign(source, name, changes)
    assert source.read_bytes() == before
    assert [p.name for p in source.parent.iterdir()] == ["campaign.toml"]
