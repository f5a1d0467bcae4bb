"""Footprint maps that follow the estimated tires: an optimum moves less or more than under maps that stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigid_truck import bump
from synthetic_fit import synthetic_fit

from sysid.estimation.fit.minimiser import minimise
from sysid.estimation.parameters.map_tires import map_tires
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.problem import Problem
from sysid.estimation.uncertainty.information import optimum_information
from sysid.estimation.uncertainty.map_following import map_following
from sysid.vehicle_model.passes import MapTires


@pytest.fixture(scope="module")
def fit():
    return synthetic_fit()


def optimum(fit, campaign, tires: MapTires) -> np.ndarray:
    """Log parameters of the least-squares optimum under given maps, priors left out of sight by sharp data."""
    model = bump_model(campaign, fit.parameters, {"bump": bump()}, tires=tires)
    problem = Problem(model, campaign, fit.state.point.motion, fit.state.point.weights)
    start = problem.vector(fit.state.point.log_parameters)
    return minimise(problem.evaluate, start, relative_tolerance=1e-10).point[: fit.truth.size]


def matrix_of(fit) -> np.ndarray:
    """D at the optimum of the fit, with masses and departures where they are."""
    state = fit.state
    problem = state.problem()
    vector = problem.vector(state.point.log_parameters)
    data = optimum_information(fit.campaign, problem, vector, state.allowances, state.point.amounts)
    directions = state.allowances.departures.directions
    assert len(directions) == state.allowances.count
    return map_following(data.matrix, fit.parameters, state.point.log_parameters, directions)


def test_an_optimum_whose_maps_follow_moves_as_the_matrix_says(fit):
    """Readings a little different: D times the change with maps made again is the change with maps that stay."""
    random = np.random.default_rng(2)
    runs = []
    for run in fit.campaign.bump_runs:
        channels = []
        for c in run.log.channels:
            size = np.std(c.value[np.isfinite(c.value)]) if np.isfinite(c.value).any() else 0.0
            slow = np.convolve(random.standard_normal(c.value.size), np.hanning(20), mode="same")
            channels.append(replace(c, value=c.value + 0.004 * size * slow))
        runs.append(replace(run, log=replace(run.log, channels=tuple(channels))))
    other = replace(fit.campaign, bump_runs=tuple(runs))
    tires = fit.state.model.tires
    before, stays = (optimum(fit, c, tires) for c in (fit.campaign, other))
    follows = stays
    for _ in range(8):
        follows = optimum(fit, other, map_tires(fit.parameters, follows))
    here = before
    for _ in range(8):
        here = optimum(fit, fit.campaign, map_tires(fit.parameters, here))
    n = list(fit.parameters.names).index("tire_exponent")
    assert abs(stays[n] - before[n]) > 0.001
    # Without the matrix it would be off by a fifth.
    assert abs((follows - here)[n] / (stays - before)[n] - 1.0) > 0.1
    moved = matrix_of(fit) @ (follows - here)
    sd = np.sqrt(np.diag(fit.result.covariance))
    np.testing.assert_allclose(moved / sd, (stays - before) / sd, atol=0.05 * np.abs((stays - before) / sd).max())


def test_exponents_of_maps_stay_where_maps_can_be_made(fit):
    x = fit.truth.copy()
    x[list(fit.parameters.names).index("tire_exponent")] = np.log(3.0)
    assert map_tires(fit.parameters, x).spoke_exponent == 1.5
    assert map_tires(fit.parameters, fit.truth).spoke_exponent == pytest.approx(0.75)
    assert map_tires(fit.parameters, fit.truth).like(map_tires(fit.parameters, fit.truth + 1e-4))
    assert not map_tires(fit.parameters, fit.truth).like(map_tires(fit.parameters, fit.truth + 0.01))
