"""Simulated fleets: what is written is a fleet with that truth, and intervals over some of them hold it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from studies.fleets.joint import compare
from studies.fleets.simulated import NAMES, outliers, replicate, simulate
from studies.fleets.table import alarms, coverage, found, rms, tables, write
from sysid.campaign.quality.check import check_quality
from sysid.campaign.read import read_campaign
from sysid.errors import CampaignError
from sysid.fleet.read import read_fleet
from sysid.fleet.simulate import simulate_fleet
from sysid.road.point_cloud import read_point_cloud

RIGID = Path(__file__).resolve().parents[2] / "examples" / "vehicles" / "rigid3"
BROKEN = {"T2": {"c_2": 0.5}}


def test_a_simulated_fleet_is_one_that_can_be_read(tmp_path: Path) -> None:
    made = simulate_fleet(RIGID, tmp_path, trucks=2, campaigns=2, seed=5, broken=BROKEN)
    fleet = read_fleet(tmp_path)
    assert [len(t.campaigns) for t in fleet.trucks] == [2, 2]
    assert json.loads((tmp_path / "fleet_truth.json").read_text())["trucks"] == {
        k: dict(v) for k, v in made.trucks.items()
    }
    # The load cases of an air spring stay together, and a damper that is half broken is that.
    of = made.trucks["T1"]
    ratio = {n: of[n] / made.mean[n] for n in of}
    assert ratio["k_2[empty]"] == pytest.approx(ratio["k_2[laden]"])
    whole = simulate_fleet(RIGID, tmp_path / "whole", trucks=2, campaigns=1, seed=5)
    assert made.trucks["T2"]["c_2"] == pytest.approx(0.5 * whole.trucks["T2"]["c_2"])
    assert made.trucks["T2"]["c_1"] == whole.trucks["T2"]["c_1"]
    _, campaign = next(fleet.campaigns())
    read = read_campaign(campaign.folder, point_cloud_reader=read_point_cloud)
    assert len(read.bump_runs) == 2
    assert {r.load_case for r in read.bump_runs} == {"empty", "laden"}
    screened, quality = check_quality(read)
    assert {c.verdict for c in quality.channels} == {"good"}
    assert len(screened.bump_runs) == 2


def test_what_cannot_be_simulated_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CampaignError, match="has 12 bump runs, 13 are to be simulated"):
        simulate_fleet(RIGID, tmp_path, runs=13)
    mixed = tmp_path / "mixed"
    shutil.copytree(RIGID, mixed)
    text = (mixed / "campaign.toml").read_text(encoding="utf-8")
    (mixed / "campaign.toml").write_text(text.replace("_run1.csv", "_run1.mf4"), encoding="utf-8")
    with pytest.raises(CampaignError, match="of another format than CSV"):
        simulate_fleet(mixed, tmp_path / "fleet")
    for broken in ({"T9": {"c_2": 0.5}}, {"T1": {"c_9": 0.5}}):
        with pytest.raises(CampaignError, match="not all in the fleet"):
            simulate_fleet(RIGID, tmp_path, trucks=2, broken=broken)


def test_a_short_study_of_fleets() -> None:
    """One whole fleet; outliers, which need no sampling, in twenty: found in 18, false alarms in few."""
    records = [replicate(1)]
    for what in ("mean", "spread", "trucks"):
        held, count = coverage(records, what)
        assert held / count > 0.75, what
    assert rms(records, "shrunk_error") < 1.1 * rms(records, "alone_error")
    broken = [outliers(n) for n in range(20)]
    assert found(broken) >= 18
    assert alarms(broken) <= 4
    assert alarms([outliers(n, broken=False) for n in range(20)]) <= 5


def test_the_truth_of_a_study_is_in_its_campaigns() -> None:
    data, truth, where = simulate(0, 1, True)
    assert data.names == NAMES
    assert where is not None
    values = np.linalg.solve(data.precision, data.shift[..., None])[..., 0]
    off = values - truth["trucks"][data.truck_of]
    assert np.abs(off).mean() < 0.06
    others = np.delete(truth["trucks"][:, where[1]], where[0])
    assert truth["trucks"][where] < others.min()


def test_tables_stand_between_their_marks(tmp_path: Path) -> None:
    one = {
        "number": 0, "converged": True, "mean": [True, False], "spread": [True], "trucks": [True],
        "alone_error": [0.02], "shrunk_error": [0.01], "broken": ["T1", "c_1"], "outliers": [["T1", "c_1", 0.5, 0.001]],
    }  # fmt: skip
    text = tables({"healthy": [one], "broken": [one], "broken_wide": [one | {"outliers": []}]})
    assert "| mean of the type | 1 | 2 | 50.0 % |" in text
    assert "| one broken, c of others differs by 5 to 12 % | 1 of 1 | 0 of 1 |" in text
    assert "| one broken, c of others differs by 8 to 20 % | 0 of 1 | 0 of 1 |" in text
    document = tmp_path / "page.md"
    document.write_text("before\n<!-- fleets: begin -->\nearlier\n<!-- fleets: end -->\nafter\n")
    write(text, document)
    assert "earlier" not in document.read_text()
    assert document.read_text().endswith("after\n")


@pytest.mark.long
def test_two_stages_give_what_three_campaigns_sampled_at_once_give(tmp_path: Path) -> None:
    rows, _ = compare(tmp_path)
    assert max(abs(row.apart) for row in rows) < 0.1
    assert all(0.9 < row.ratio < 1.1 for row in rows)
