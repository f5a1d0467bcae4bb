"""Estimates follow from the stages that have run, whichever these are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from small_results import campaign_only, small_fit, small_results

from sysid.estimates import Estimates
from sysid.estimates.derive import derive_estimates
from sysid.road import half_sine


def of(results) -> Estimates:
    return derive_estimates(results.campaign, results.drops, results.scans, results.fit, results.posterior)


def test_before_any_stage_there_is_nothing():
    assert of(campaign_only()) == Estimates()
    assert of(campaign_only()).summary().empty


@pytest.mark.parametrize(
    ("missing", "source", "stiffness"),
    [
        ({}, "posterior", None),
        ({"posterior": None}, "fitted", 4.2e5),
        ({"posterior": None, "fit": None}, "corrected", 3.8e5),
    ],
)
def test_the_most_informed_stage_gives_the_best_value(missing, source, stiffness):
    results = small_results(**missing)
    first = of(results).summary().iloc[0]
    expected = stiffness or np.median(results.posterior.draws[..., 0])
    # Drops belong to a load case, the fitted stiffness of this axle to all.
    case = "empty" if source == "corrected" else ""
    assert (first["axle"], first["load_case"], first["stiffness_N_per_m_source"]) == (1, case, source)
    assert first["stiffness_N_per_m"] == pytest.approx(expected, rel=1e-12)
    assert first["stiffness_N_per_m_q05"] < first["stiffness_N_per_m"] < first["stiffness_N_per_m_q95"]


def test_modes_need_a_fit_and_stand_for_every_load_case():
    assert [m.load_case.name for m in of(small_results()).modes] == ["empty", "laden"]
    drops_alone = of(small_results(fit=None, posterior=None))
    assert (drops_alone.modes, drops_alone.vehicles, drops_alone.loops) == ((), (), ())
    assert drops_alone.stiffness


def test_roads_are_those_of_bumps_that_have_a_height():
    results = small_results()
    (name,) = results.scans
    flat = replace(results.scans[name].profile, height_m=0.0 * results.scans[name].profile.height_m)
    scans = {name: replace(results.scans[name], profile=half_sine(0.08, 0.9))}
    scans["flat"] = replace(results.scans[name], profile=flat)
    roads = of(replace(results, scans=scans)).roads
    assert list(roads) == [name]
    assert [road.axle for road in roads[name]] == [0, 1]
    # No wheel centre rises higher than the bump.
    assert all(0.0 < road.rise_m.max() <= 0.08 for road in roads[name])


def test_linear_laws_have_no_loops():
    assert of(small_results()).loops == ()


def test_a_quantity_is_asked_for_by_its_name():
    found = derive_estimates(small_results().campaign, None, {}, small_fit(), None)
    assert found.suspension("stiffness") is found.stiffness
    assert found.suspension("damping") is found.damping
    assert [row.best.value for row in found.damping] == [1.1e4, 9.0e3]


def test_viscous_damping_of_a_drop_that_rubs_only_is_not_below_zero():
    results = small_results(posterior=None, fit=None)
    pooled = tuple(replace(e, damping=0.0, damping_sd=2e4) for e in results.drops.pooled)
    best = of(replace(results, drops=replace(results.drops, pooled=pooled))).damping[0].best
    assert (best.low, best.value) == (0.0, 0.0)
    assert best.high == pytest.approx(stats.norm.ppf(0.95) * 2e4, rel=1e-3)


@pytest.mark.parametrize("spread", [0.05, 0.8, 1e3, 1e150])
def test_intervals_of_drops_are_lognormal_with_the_standard_deviation_of_the_record(spread):
    results = small_results(posterior=None, fit=None)
    pooled = tuple(replace(e, damping_sd=spread * e.damping) for e in results.drops.pooled)
    row = of(replace(results, drops=replace(results.drops, pooled=pooled))).damping[0]
    best = row.best
    assert 0.0 < best.low < best.value < best.high < np.inf
    # Never narrower than the normal one: a damping that is next to zero may be as large as its standard deviation says.
    assert best.high >= best.value * (1.0 + stats.norm.ppf(0.95) * spread) * (1.0 - 1e-3)
    if spread < 1e6:  # beyond it SciPy's moments overflow
        variable = stats.lognorm(np.log(best.value / best.low) / stats.norm.ppf(0.95))
        assert variable.std() / variable.mean() == pytest.approx(spread, rel=1e-3)
    if spread < 10.0:
        assert best.high / best.value == pytest.approx(best.value / best.low)
