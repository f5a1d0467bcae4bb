"""Rockers that nobody declared: found where there is one, and nowhere else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigid_truck import AXLES, DAMPING, EMPTY, LADEN, STIFFNESS, VEHICLE, bump, campaign, empty_run, with_values

from sysid.campaign.vehicle_records import AxleGroup, Equaliser
from sysid.estimation.fit.law_choice import fit_with_laws
from sysid.estimation.fit.least_squares import optimise
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.fit.rocker_search import joined_axles
from sysid.estimation.fit.thresholds import MISFIT
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.parameters.rockers import LoadShare, load_shares, share_from_fit
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs
from sysid.progress import unwatched

SPEED_M_S, START_S = np.array([6.07, 8.39, 6.02]), np.array([0.44, 0.61, 0.5])
PROFILES = {"bump": bump()}
TANDEM = (Equaliser("tandem", (1, 2)),)


def measured(share: float, friction: float):
    """A campaign of linear laws without a rocker, its readings from a truck with a rocker or friction."""
    linear = tuple(replace(a, suspension_law="linear", load_dependent=False) for a in AXLES)
    rubbing = tuple(replace(a, suspension_law="friction" if friction else "linear") for a in linear)
    runs = [empty_run("slow.csv", 6.0, samples=340), empty_run("fast.csv", 8.5, samples=340),
            empty_run("laden.csv", 6.0, load_case="laden", samples=340)]  # fmt: skip
    cases = (EMPTY, LADEN)
    behind = campaign(
        runs, load_cases=cases, vehicle=replace(VEHICLE, axles=rubbing, equalisers=TANDEM if share else ())
    )
    parameters = campaign_parameters(behind, None)
    truth = {"share_odds[tandem]": share / (1.0 - share) if share else 1.0}
    for i in range(3):
        truth |= {f"k_{i + 1}": STIFFNESS[i], f"c_{i + 1}": DAMPING[i], f"F_{i + 1}": friction}
    logs = np.log([truth.get(p.name, p.start) for p in parameters.parameters])
    model = bump_model(behind, parameters, PROFILES)
    random, filled = np.random.default_rng(11), {}
    for signals, group in zip(
        simulate_runs(model, logs, RunMotion.steady(SPEED_M_S, START_S)), model.groups, strict=True
    ):
        for position, r in enumerate(group.runs):
            clean = signals[: len(runs[r].log.channels[0].value), position]
            noise = np.array([2e-4 if c.sensor.kind == "suspension_deflection" else 0.1 for c in runs[r].log.channels])
            filled[r] = with_values(runs[r], clean + noise * random.normal(size=clean.shape))
    declared = campaign([filled[r] for r in range(3)], load_cases=cases, vehicle=replace(VEHICLE, axles=linear))
    return declared


OPTIONS = FitOptions(weight_rounds=1, cross_check=False, laws="declared")


def test_a_rocker_that_nobody_declared_is_named():
    fit, _ = fit_with_laws(measured(0.7, 0.0), None, PROFILES, OPTIONS)
    (found,) = fit.undeclared_rockers
    assert found.axles == (1, 2)
    assert found.share == pytest.approx(0.7, abs=0.05)
    assert "rocker shared" in fit.warnings[0]
    assert "Axles 2 and 3" in fit.warnings[0]


def test_a_declared_one_is_estimated_and_nothing_more_is_asked_for():
    data = measured(0.7, 0.0)
    fit, _ = fit_with_laws(replace(data, vehicle=replace(data.vehicle, equalisers=TANDEM)), None, PROFILES, OPTIONS)
    assert fit.undeclared_rockers == ()
    (share,) = fit.load_shares
    assert share.low < 0.7 < share.high
    assert share.high - share.low < 0.1


def test_friction_that_is_not_modelled_is_no_rocker():
    data = measured(0.0, 1500.0)
    fit, _ = fit_with_laws(data, None, PROFILES, OPTIONS)
    # There was reason to look: the vehicle as declared does not explain the readings. Departures do, friction is one.
    optimum = optimise(data, campaign_parameters(data, None), PROFILES, OPTIONS, unwatched)
    assert optimum.misfit > MISFIT
    assert fit.undeclared_rockers == ()


def test_candidates_are_near_neighbours_under_one_body_that_nothing_joins():
    assert joined_axles(VEHICLE) == ((1, 2),)
    assert joined_axles(replace(VEHICLE, equalisers=TANDEM)) == ()
    assert joined_axles(replace(VEHICLE, groups=(AxleGroup("beam", (1, 2), 1.0, 1.0),))) == ()
    tridem = (AXLES[0], AXLES[1], AXLES[2], replace(AXLES[2], name="lift", x_m=6.9))
    assert joined_axles(replace(VEHICLE, axles=tridem)) == ((1, 2), (2, 3), (1, 2, 3))
    trailer = (*tridem[:3], replace(tridem[3], body=1))
    assert joined_axles(replace(VEHICLE, axles=trailer)) == ((1, 2),)


def test_shares_from_odds():
    """By hand: odds of 4 are a share of 0.8; a log sd of ln 2 / 1.645 reaches from odds 2 to 8."""
    found = share_from_fit("a", (1, 2), 4.0, np.log(2.0) / 1.6448536)
    assert (found.low, found.share, found.high) == pytest.approx((2 / 3, 0.8, 8 / 9), rel=1e-7)
    vehicle = replace(VEHICLE, equalisers=(Equaliser("a", (1, 2), 0.25),))
    assert load_shares(vehicle, ()) == (LoadShare("a", (1, 2), 0.25, 0.25, 0.25, declared=True),)
