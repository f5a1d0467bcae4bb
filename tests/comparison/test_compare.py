"""Folders compared: what is shared, what cannot be compared, and sentences for folders that are none."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from compared_folders import OWN_SD, SCALE_SD, results, scaled_fit, write_folder
from small_results import campaign_only

import sysid
from sysid.campaign.records import CampaignDetails
from sysid.comparison.page import answer
from sysid.errors import CampaignError, StoredResultsError
from sysid.export import write_result

Z90 = 1.6448536


@pytest.fixture
def before(tmp_path: Path) -> Path:
    return write_folder(tmp_path / "before", results(seed=1))


def after(tmp_path: Path, **how) -> Path:
    return write_folder(tmp_path / "after", results(seed=2, **how))


def test_the_scale_cancels_in_the_difference(before, tmp_path) -> None:
    (pair,) = sysid.compare(before, after(tmp_path, change={"c_2": 0.9})).pairs
    assert pair.one_truck
    assert "the scale" in pair.shared
    found = pair["c_2"]
    assert found.log_ratio == pytest.approx(np.log(0.9), abs=1e-8)
    assert found.log_sd == pytest.approx(np.sqrt(2.0) * OWN_SD, rel=1e-6)
    middle, low, high = found.change
    assert middle == pytest.approx(-0.1, abs=1e-8)
    assert [np.log1p(low), np.log1p(high)] == pytest.approx(
        [np.log(0.9) - Z90 * found.log_sd, np.log(0.9) + Z90 * found.log_sd]
    )
    assert [d.name for d in pair.changed] == ["c_2"]
    assert found.probability_larger < 1e-6
    # Each alone knows its values as well as the scale does.
    assert (found.first[2] - found.first[1]) / found.first[0] > 2.0 * SCALE_SD


def test_nothing_cancels_without_it_and_the_change_is_not_seen(before, tmp_path) -> None:
    (pair,) = sysid.compare(before, after(tmp_path, change={"c_2": 0.9}), cancel=False).pairs
    assert pair["c_2"].log_sd == pytest.approx(np.sqrt(2.0 * (SCALE_SD**2 + OWN_SD**2)), rel=1e-6)
    assert pair.changed == ()
    assert pair["c_2"].least_seen > 0.1


def test_what_did_not_change_is_not_called_so(before, tmp_path) -> None:
    (pair,) = sysid.compare(before, after(tmp_path)).pairs
    assert pair.changed == ()
    assert all(d.p_adjusted == 1.0 for d in pair.of("suspension"))
    # A reading that is used twice is one.
    assert {(d.log_ratio, d.log_sd) for d in pair.of("static loads")} == {(0.0, 0.0)}


def test_another_truck_shares_the_scale_only_if_it_is_named(before, tmp_path) -> None:
    first = write_folder(tmp_path / "a", results(details=CampaignDetails(vehicle_id="A", scale="Pit 3")))
    second = write_folder(tmp_path / "b", results(details=CampaignDetails(vehicle_id="B", scale="Pit 3")))
    third = write_folder(tmp_path / "c", results(details=CampaignDetails(vehicle_id="C")))
    with_scale, without = sysid.compare(first, second, third).pairs
    assert not with_scale.one_truck
    assert with_scale.shared == ("the scale",)
    assert without.shared == ()
    assert without["k_1"].log_sd > 5.0 * with_scale["k_1"].log_sd


def weighed_anew(factor: float):
    again = results(seed=2)
    cases = {
        name: replace(case, axle_loads_kg=tuple(factor * load for load in case.axle_loads_kg))
        for name, case in again.campaign.load_cases.items()
    }
    return replace(again, campaign=replace(again.campaign, load_cases=cases))


def test_a_truck_that_was_weighed_anew_shares_no_scale(before, tmp_path) -> None:
    (pair,) = sysid.compare(before, write_folder(tmp_path / "after", weighed_anew(1.2))).pairs
    assert pair.shared == ("unsprung masses",)
    assert any("weighed anew" in r for r in pair.remarks)
    loads = pair.of("static loads")
    assert loads
    assert all(d.log_ratio == pytest.approx(np.log(1.2)) and d.changed for d in loads)
    assert loads[0].log_sd == pytest.approx(np.sqrt(2.0) * SCALE_SD)


def with_unsprung(seed: int, estimate: float):
    """Results whose data know the unsprung mass as `estimate` tolerances off."""
    base = results(seed=seed)
    known = replace(base.fit.further, estimate=np.array([0.0, estimate]), covariance=np.diag([1.0, 1e-3]))
    return replace(base, fit=replace(base.fit, further=known))


def test_campaigns_that_contradict_each_other_share_no_masses(tmp_path) -> None:
    first = write_folder(tmp_path / "a", with_unsprung(1, 1.0))
    near = write_folder(tmp_path / "b", with_unsprung(2, 1.05))
    far = write_folder(tmp_path / "c", with_unsprung(3, -1.0))
    agreed, apart = sysid.compare(first, near, far).pairs
    assert agreed.shared == ("unsprung masses", "the scale")
    assert apart.shared == ()
    assert any("do not agree on unsprung masses" in r for r in apart.remarks)


def test_nothing_is_called_changed_where_the_masses_contradict_each_other(tmp_path) -> None:
    """A load that nobody declared would look like another suspension."""
    first = write_folder(tmp_path / "a", with_unsprung(1, 1.0))
    halved = [with_unsprung(2, 1.05), with_unsprung(3, -1.0)]
    folders = []
    for name, base in zip("bc", halved, strict=True):
        parameters = tuple(replace(p, value=0.5 * p.value if p.name == "c_2" else p.value) for p in base.fit.parameters)
        folders.append(write_folder(tmp_path / name, replace(base, fit=replace(base.fit, parameters=parameters))))
    agreed, apart = sysid.compare(first, *folders).pairs
    assert [d.name for d in agreed.changed] == ["c_2"]
    assert apart.changed == ()
    assert apart["c_2"].p_adjusted is None
    assert apart["c_2"].probability_larger < 1e-6
    assert answer(apart) == "Undecided: the campaigns contradict each other about the masses."


def test_nothing_is_called_changed_where_a_fit_did_not_converge(tmp_path) -> None:
    """A fit that ended elsewhere has values and a covariance of no minimum."""
    first = write_folder(tmp_path / "a", results(seed=1))
    changed = results(seed=2, change={"c_2": 0.5})
    elsewhere = replace(changed, fit=replace(changed.fit, converged=False), provenance={"seed": 3})
    folders = [write_folder(tmp_path / name, of) for name, of in (("b", changed), ("c", elsewhere))]
    for cancel in (True, False):
        settled, open_ended = sysid.compare(first, *folders, cancel=cancel).pairs
        assert [d.name for d in settled.changed] == ["c_2"]
        assert open_ended.changed == ()
        assert open_ended["c_2"].p_adjusted is None
        assert answer(open_ended) == "Undecided: the fit of c did not converge."


def test_other_laws_are_not_compared(before, tmp_path) -> None:
    other = results(seed=2)
    laws = tuple(replace(p, law="friction" if p.axle == 1 else p.law) for p in other.fit.parameters)
    folder = write_folder(tmp_path / "after", replace(other, fit=replace(other.fit, parameters=laws)))
    (pair,) = sysid.compare(before, folder).pairs
    assert {d.name for d in pair.of("suspension")} == {"k_1", "c_1"}
    assert any("suspension laws differ" in r and "c_2" in r for r in pair.remarks)


def test_a_doubtful_campaign_is_named_first(before, tmp_path) -> None:
    from sysid.results.contents import Judgement

    doubtful = replace(results(seed=2), judgement=Judgement("do_not_bet", ("Parts disagree.",), ("parts_disagree",)))
    (pair,) = sysid.compare(before, write_folder(tmp_path / "after", doubtful)).pairs
    assert pair.remarks[0] == "after: its own verdict is do not bet (Parts disagree)."


@pytest.mark.parametrize(
    ("break_it", "kind", "words"),
    [
        (lambda f: f.rename(f.with_name("gone")), CampaignError, "is no folder"),
        (lambda f: (f / "result.json").unlink(), CampaignError, "holds no result.json"),
        (lambda f: (f / "covariance.json").unlink(), CampaignError, "holds no covariance.json"),
        (lambda f: (f / "covariance.json").write_text("{"), CampaignError, "holds no covariance.json"),
        (lambda f: change(f, "schema", 2), CampaignError, "another version"),
        (lambda f: change(f, "covariance", [[1.0]]), StoredResultsError, "are damaged"),
        (lambda f: change(f, "covariance", [[float("nan")] * 6] * 6), StoredResultsError, "are damaged"),
        (lambda f: change(f, "error_covariance", [[1.0, 2.0], [2.0, 1.0]]), StoredResultsError, "are damaged"),
        (lambda f: change(f, "estimates", []), StoredResultsError, "are damaged"),
        (lambda f: change(f, "seed", 77, "result.json"), StoredResultsError, "was changed after it was written"),
        (lambda f: change(f, "converged", False), StoredResultsError, "covariance.json was changed"),
        (lambda f: write_result(results(seed=9), f / "result.json"), StoredResultsError, "are of two calibrations"),
    ],
)  # fmt: skip
def test_folders_that_are_none_get_a_sentence(before, tmp_path, break_it, kind, words) -> None:
    other = after(tmp_path)
    break_it(other)
    with pytest.raises(kind, match=words) as caught:
        sysid.compare(before, other)
    assert str(caught.value).count(". ") == 0


def change(folder: Path, key: str, value: object, name: str = "covariance.json") -> None:
    document = json.loads((folder / name).read_text(encoding="utf-8"))
    document[key] = value
    (folder / name).write_text(json.dumps(document), encoding="utf-8")


def test_one_folder_or_one_result_twice_is_no_comparison(before, tmp_path) -> None:
    with pytest.raises(CampaignError, match="two to"):
        sysid.compare(before)
    with pytest.raises(CampaignError, match="the same result"):
        sysid.compare(before, write_folder(tmp_path / "copy", results(seed=1)))


def test_without_a_fit_there_is_nothing_to_compare(before, tmp_path) -> None:
    folder = tmp_path / "after"
    folder.mkdir()
    write_result(campaign_only(), folder / "result.json")
    with pytest.raises(CampaignError, match="no fit"):
        sysid.compare(before, folder)


def test_sampled_results_are_compared_by_their_draws(tmp_path) -> None:
    from small_results import small_results

    base = small_results()
    sampled = replace(results(), posterior=base.posterior)
    folder = write_folder(tmp_path / "sampled", sampled)
    stored = json.loads((folder / "covariance.json").read_text(encoding="utf-8"))
    logs = np.log(base.posterior.draws).reshape(-1, 6)
    np.testing.assert_allclose([e["log_value"] for e in stored["estimates"]], logs.mean(axis=0), rtol=1e-8)
    np.testing.assert_allclose(stored["covariance"], np.cov(logs, rowvar=False), rtol=1e-6)
    assert scaled_fit().covariance[0, 0] != pytest.approx(stored["covariance"][0][0], rel=0.1)
