"""Single-axle readings of the linear truck that are far from the truth carry a caution and an error that covers it."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sysid.campaign import read_campaign
from sysid.estimation.fit import drop_coupling
from sysid.estimation.fit.drop_coupling import with_cautions
from sysid.sdof.drop_results import NOT_ALONE, DropEstimate
from sysid.sdof.summary import analyse_drops

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"


@pytest.fixture(scope="module")
def campaign():
    return read_campaign(DATA)


@pytest.fixture(scope="module")
def analysed(campaign):
    return analyse_drops(campaign)


@pytest.fixture(scope="module")
def truth():
    """True stiffness and damping (axles, 2) of the linear truck."""
    axles = tomllib.loads((DATA / "truth.toml").read_text(encoding="utf-8"))["axle"]
    names = ("suspension_stiffness_N_per_m", "suspension_damping_N_s_per_m")
    return np.array([[axle[name] for name in names] for axle in axles])


def with_model(drops, truth):
    """The readings beside a full model that has found the truth, as good as it can."""
    rows = tuple(
        DropEstimate(i, "unloaded", None, "model", k, 0.01 * k, c, 0.03 * c, float("nan"), float("nan"), True)
        for i, (k, c) in enumerate(truth)
    )
    return replace(drops, pooled=(*rows, *drops.pooled))


def model_beside_truth(drops, truth, seed):
    """A full model that is off the truth by what its standard deviations say: 4 % of k and 12 % of c."""
    normal = np.random.default_rng(seed).standard_normal(truth.shape)
    rows = with_model(drops, truth * (1.0 + np.array([0.04, 0.12]) * normal)).pooled[: len(truth)]
    rows = tuple(replace(e, stiffness_sd=0.04 * k, damping_sd=0.12 * c) for e, (k, c) in zip(rows, truth, strict=True))
    return replace(drops, pooled=(*rows, *drops.pooled))


def largest_error(drops, truth):
    """Of all single-axle estimates, in their own standard deviations."""
    return max(np.abs(errors(e, truth)[1]).max() for e in drops.pooled if e.method != "model" and e.usable)


def errors(e, truth):
    value = np.array([e.stiffness, e.damping])
    return value / truth[e.axle] - 1.0, (value - truth[e.axle]) / np.array([e.stiffness_sd, e.damping_sd])


def test_readings_far_off_are_marked_beside_the_full_model(campaign, analysed, truth):
    found = with_cautions(campaign, with_model(analysed, truth))
    single = [e for e in found.pooled if e.method != "model"]
    assert len(single) == 18
    usable = [e for e in single if e.usable]
    assert len(usable) >= 15
    for e in usable:
        off, in_sd = errors(e, truth)
        if abs(off[0]) > 0.15 or abs(off[1]) > 0.35:
            assert e.caution.startswith(NOT_ALONE)
        # The readings are compared with the truth itself here: what is kept is within two of their own errors.
        assert np.all(np.abs(in_sd) < 2.1)
    assert "read the rows of method model" in found.messages[0]


@pytest.mark.parametrize("seed", range(10))
def test_intervals_hold_beside_a_model_with_errors(campaign, analysed, truth, seed):
    """The truth lies elsewhere than the model that the departures are taken from."""
    assert largest_error(analysed, truth) > 5.0
    assert largest_error(with_cautions(campaign, model_beside_truth(analysed, truth, seed)), truth) < 2.3


def test_intervals_do_not_hold_beside_a_wrong_model_that_is_sure():
    """Negative control: a reading of 0.6 of the true k and c, beside a model that knows half of them to 1 %."""
    single = DropEstimate(4, "unloaded", None, "free_decay", 6e5, 6e3, 6e3, 60.0, 0.31, 0.7, True)
    model = DropEstimate(4, "unloaded", None, "model", 5e5, 5e3, 5e3, 50.0, float("nan"), float("nan"), True)
    found = drop_coupling._marked(single, drop_coupling._Coupling(1, {}), model)
    assert (1e6 - found.stiffness) / found.stiffness_sd > 2.3
    assert (1e4 - found.damping) / found.damping_sd > 2.3


def test_records_with_several_modes_are_named(campaign, analysed, truth):
    """Axle 2 stands over the middle of the tractor: heave, pitch and the trailer all show in its records."""
    found = with_cautions(campaign, with_model(analysed, truth))
    notes = {e.axle: e.note for e in found.pooled if e.method == "corrected"}
    assert "3 modes in this record" in notes[1]
    assert "modes in this record" not in notes[0]
    of_files = [e for a in found.files if a.axle == 1 for e in a.estimates if e.usable]
    assert of_files
    assert all("3 modes in this record" in e.note for e in of_files)


def test_without_the_full_model_the_modes_alone_mark_the_worst(campaign, analysed, truth):
    found = with_cautions(campaign, analysed)
    for e in found.pooled:
        off, _ = errors(e, truth)
        if abs(off[0]) > 0.3:
            assert e.caution.startswith(NOT_ALONE)
    assert "the remedy" in found.messages[0]


def test_the_numbers_themselves_stay(campaign, analysed, truth):
    found = with_cautions(campaign, with_model(analysed, truth))
    before = [(e.stiffness, e.damping, e.usable) for e in analysed.pooled]
    assert [(e.stiffness, e.damping, e.usable) for e in found.pooled if e.method != "model"] == before


def test_a_model_that_knows_little_does_not_clear_an_estimate():
    """66 % above a model known to 40 %, with 13 % of its own, on a vehicle whose modes would not show it."""
    single = DropEstimate(4, "unloaded", None, "free_decay", 1.87e6, 2.4e5, 3.5e4, 5.6e3, 0.31, 0.7, True)
    model = DropEstimate(4, "unloaded", None, "model", 1.125e6, 4.5e5, 2.0e4, 2.0e4, float("nan"), float("nan"), True)
    found = drop_coupling._marked(single, drop_coupling._Coupling(1, {}), model)
    assert found.caution.startswith(NOT_ALONE)
    assert found.stiffness_sd >= np.hypot(single.stiffness - model.stiffness, model.stiffness_sd)
