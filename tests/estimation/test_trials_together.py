"""Trial models that are simulated in one call, against simulations of each of them alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigid_truck import EMPTY, LADEN, VEHICLE, bump, campaign, empty_run

from sysid.campaign.vehicle_records import Equaliser, MassTolerances
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.residuals.bump_model import BumpModel, bump_model
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import TOGETHER, each, simulate_runs, simulate_trials
from sysid.estimation.uncertainty.allowances import campaign_allowances

ROCKER = Equaliser("tandem", (1, 2), 0.6)
#: One speed falls: the runs of a group differ in all that a motion has.
MOTION = RunMotion(np.array([6.0, 7.0, 3.0]), np.array([0.2, 0.15, 0.1]), np.array([0.0, -0.05, 0.0]))


@pytest.fixture(scope="module", params=["springs", "rocker and stops"])
def trials(request):
    """Models moved by one mass or departure each, friction among them: that one has laws of another structure."""
    vehicle = replace(VEHICLE, tolerances=MassTolerances())
    if request.param == "rocker and stops":
        axles = tuple(replace(a, jounce_travel_m=0.05, rebound_travel_m=0.04) for a in vehicle.axles)
        vehicle = replace(vehicle, axles=axles, equalisers=(ROCKER,))
    runs = [
        empty_run("a.csv", 6.0, samples=150),
        empty_run("b.csv", 7.0, load_case="laden", samples=150),
        empty_run("c.csv", 3.0, load_case="laden", samples=400),
    ]
    data = campaign(runs, load_cases=(EMPTY, LADEN), vehicle=vehicle)
    parameters = campaign_parameters(data, None)
    ours = bump_model(data, parameters, {"bump": bump()})
    allowances = campaign_allowances(data, parameters, ours.felt)
    amounts = 0.02 * np.eye(allowances.count)[: 2 * TOGETHER + 3]
    moved = [allowances.moved(ours, a) for a in amounts]
    # The declared model has no friction: it stands in the middle, and must come back in its place.
    return parameters, [*moved[:5], ours, *moved[5:]]


def alone(trials: list[BumpModel], start: np.ndarray) -> list[tuple[np.ndarray, ...]]:
    return [simulate_runs(trial, start, MOTION) for trial in trials]


@pytest.mark.parametrize("engine", ["native", pytest.param("reference", marks=pytest.mark.long)])
def test_trials_together_are_the_trials_alone(trials, engine, monkeypatch):
    monkeypatch.setenv("SYSID_ENGINE", engine)
    parameters, models = trials
    models = models if engine == "native" else models[:7]
    shown = list(simulate_trials(iter(models), parameters.start, MOTION, each))
    expected = alone(models, parameters.start)
    assert len(shown) == len(models)
    for one, two in zip(shown, expected, strict=True):
        for a, b in zip(one, two, strict=True):
            np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-13 * np.abs(b).max())
    # The trials differ by far more: signals of a neighbour would be seen.
    changes = [
        max(np.abs(a - b).max() / np.abs(b).max() for a, b in zip(x, expected[5], strict=True)) for x in expected
    ]
    assert np.median(changes) > 1e-4


def test_no_trials_are_no_signals():
    assert list(simulate_trials([], np.zeros(3), MOTION, each)) == []
