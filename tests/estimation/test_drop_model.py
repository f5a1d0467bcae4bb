"""Plank drops fitted by the full model, against the linear truck's truth (made by another engine)."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from sysid.campaign import check_quality, read_campaign
from sysid.errors import DataRejectedError
from sysid.estimation.fit import drop_model
from sysid.estimation.fit.drop_model import fit_drops, with_model_estimates
from sysid.estimation.fit.options import FitOptions
from sysid.road import read_point_cloud
from sysid.sdof.summary import analyse_drops

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"
FILES = ("axle1_drop2.csv", "axle3_drop3.csv", "axle5_drop1.csv")
OPTIONS = FitOptions(weight_rounds=1, tolerance=1e-4)


@pytest.fixture(scope="module")
def campaign():
    whole, _ = check_quality(read_campaign(DATA, point_cloud_reader=read_point_cloud))
    return replace(whole, plank_drops=tuple(d for d in whole.plank_drops if d.log.file.endswith(FILES)))


@pytest.fixture(scope="module")
def analysed(campaign):
    return analyse_drops(campaign)


@pytest.fixture(scope="module")
def found(campaign, analysed):
    return {e.axle: e for e in fit_drops(campaign, analysed, OPTIONS)}


def errors(estimates) -> dict[int, tuple[float, float]]:
    """Relative errors of k and c by axle."""
    axles = tomllib.loads((DATA / "truth.toml").read_text(encoding="utf-8"))["axle"]
    return {
        e.axle: (
            e.stiffness / axles[e.axle]["suspension_stiffness_N_per_m"] - 1.0,
            e.damping / axles[e.axle]["suspension_damping_N_s_per_m"] - 1.0,
        )
        for e in estimates
    }


def test_one_drop_per_axle_is_enough_for_stiffness_and_damping(found):
    assert sorted(found) == [0, 2, 4]
    # The search has converged by its own, coarse tolerance: the values become priors of the bump runs.
    assert all(e.usable for e in found.values())
    for k, c in errors(found.values()).values():
        assert abs(k) < 0.05
        assert abs(c) < 0.12


def test_closer_to_the_truth_than_the_paper(found, analysed):
    """Median over the axles, for stiffness and for damping."""
    paper = errors(e for e in analysed.pooled if e.method == "paper")
    for part in (0, 1):
        ours = np.median([abs(e[part]) for e in errors(found.values()).values()])
        assert ours < 0.5 * np.median([abs(e[part]) for e in paper.values()])


def test_estimates_stand_beside_the_single_axle_ones(campaign, analysed, found, monkeypatch):
    monkeypatch.setattr("sysid.estimation.fit.drop_model.fit_drops", lambda *arguments: tuple(found.values()))
    summary = with_model_estimates(campaign, analysed, OPTIONS)
    assert [e.method for e in summary.pooled if e.axle == 2] == ["model", "paper", "corrected", "free_decay"]


def test_drops_without_dampers_are_not_fitted(campaign, analysed):
    bare = replace(campaign, plank_drops=tuple(replace(d, dampers=False) for d in campaign.plank_drops))
    with pytest.raises(DataRejectedError, match="dampers"):
        fit_drops(bare, analysed, OPTIONS)
    assert "dampers" in with_model_estimates(bare, analysed, OPTIONS).messages[-1]


@pytest.mark.parametrize(
    "failure",
    [np.linalg.LinAlgError("SVD did not converge"), FloatingPointError("overflow"), RuntimeError("nonfinite solve")],
)
def test_a_fit_that_breaks_down_costs_its_estimates_only(campaign, analysed, monkeypatch, failure):
    def broken(*arguments):
        raise failure

    monkeypatch.setattr("sysid.estimation.fit.drop_model.fit_drops", broken)
    summary = with_model_estimates(campaign, analysed, OPTIONS)
    assert summary.pooled == analysed.pooled
    assert summary.files is analysed.files
    assert summary.messages[: len(analysed.messages)] == analysed.messages
    assert str(failure) in summary.messages[-1]


def test_numbers_that_are_not_finite_are_no_estimates(campaign, analysed, found, monkeypatch):
    bad = replace(found[0], stiffness=float("nan"))
    monkeypatch.setattr("sysid.estimation.fit.drop_model.fit_drops", lambda *arguments: (bad, found[2]))
    summary = with_model_estimates(campaign, analysed, OPTIONS)
    assert [e.axle for e in summary.pooled if e.method == "model"] == [2]
    assert "no finite numbers" in summary.messages[-1]


def test_bodies_that_are_let_go_are_not_fitted(campaign, analysed):
    bodies = tuple(replace(d, release="body", plank_height_m=None) for d in campaign.plank_drops)
    summary = with_model_estimates(replace(campaign, plank_drops=bodies), analysed, OPTIONS)
    assert summary.pooled == analysed.pooled
    assert "let go" in summary.messages[-1]


@pytest.mark.parametrize(
    ("misfit", "converged", "little"), [(1.5, True, False), (1.7, True, True), (1.7, False, False), (3.3, False, True)]
)
def test_the_search_of_drops_ends_early_only_where_linear_laws_do_not_suit(misfit, converged, little):
    """A search that has not ended may still come below what is doubtful: it goes on."""
    optimum = SimpleNamespace(misfit=misfit, minimum=SimpleNamespace(converged=converged))
    assert drop_model._says_little(optimum) is little
