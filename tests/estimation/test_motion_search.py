"""The search for a run's speed and start, wherever in the record the bump comes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigid_truck import SENSORS, bump, campaign, empty_run, true_log_parameters
from synthetic_fit import NOISE

from sysid.estimation.fit.start_search import search_motion
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs

NOMINAL_M_S = np.array([7.0, 7.0, 7.0, 7.0])
SPEED_M_S = NOMINAL_M_S * np.array([1.02, 0.985, 1.01, 0.99])
#: Early, in the middle, late, and so late that only the first axles are over the bump when the record ends.
START_S = np.array([0.3, 1.4, 2.6, 2.9])
SAMPLES = 720


@pytest.fixture(scope="module")
def truck():
    """Model of four runs of 3.6 s with noise, the campaign, and the truth."""
    runs = [empty_run(f"{i}.csv", v, samples=SAMPLES) for i, v in enumerate(NOMINAL_M_S)]
    blank = campaign(runs)
    parameters = campaign_parameters(blank, None)
    model = bump_model(blank, parameters, {"bump": bump()})
    truth = true_log_parameters(parameters.names)
    (signals,) = simulate_runs(model, truth, RunMotion.steady(SPEED_M_S, START_S))
    scale = np.array([NOISE[s.kind] for s in SENSORS])
    random = np.random.default_rng(3)
    (group,) = model.groups
    # Runs stand in the group in an order of its own, and the readings with them.
    values = signals + 3.0 * scale * random.normal(size=(len(runs), scale.size))
    values = values + scale * random.normal(size=signals.shape)
    model = replace(model, groups=(replace(group, value=values, measured=np.ones(values.shape, bool)),))
    return model, blank, truth, (np.tile(scale, (len(runs), 1)),), parameters


@pytest.mark.parametrize("rough", [False, True])
def test_starts_all_over_the_record(truck, rough):
    model, data, truth, noise, parameters = truck
    if rough:
        # Springs half again as stiff, dampers half as strong.
        names = np.array([n[0] for n in parameters.names])
        truth = truth + np.where(names == "k", 0.4, 0.0) - np.where(names == "c", 0.7, 0.0)
    found = search_motion(model, data, truth, noise)
    np.testing.assert_allclose(found.start_s, START_S, atol=0.03 if rough else 2e-4)
    np.testing.assert_allclose(found.speed_m_s, SPEED_M_S, rtol=0.04 if rough else 1e-9)
