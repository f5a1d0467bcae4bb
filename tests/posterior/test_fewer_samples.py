"""Fast logs with fewer samples: the same differences of the log-density, and refusals where that does not hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fit_states import state_at
from rigid_truck import SENSORS, bump, campaign, empty_run, true_log_parameters, with_values
from synthetic_fit import NOISE

from sysid.estimation.fit.state import FitState
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.residuals import fewer_samples
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.fewer_samples import with_fewer_samples
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs
from sysid.posterior.log_density import LogDensity

SAMPLES, INTERVAL_S = 2201, 0.001
SPEED_M_S, START_S = np.array([6.0, 8.5]), np.array([0.44, 0.35])


@pytest.fixture(scope="module")
def state() -> FitState:
    """A fit that ended at the truth: two runs at 1 kHz with noise, offsets and gains, a gap and some outliers."""
    runs = [
        empty_run(f, v, samples=SAMPLES, interval_s=INTERVAL_S) for f, v in zip("ab", SPEED_M_S.tolist(), strict=True)
    ]
    blank = campaign(runs)
    parameters = campaign_parameters(blank, None)
    truth, motion = true_log_parameters(parameters.names), RunMotion.steady(SPEED_M_S, START_S)
    model = bump_model(blank, parameters, {"bump": bump()})
    (signals,) = simulate_runs(model, truth, motion)
    random, scale = np.random.default_rng(7), np.array([NOISE[s.kind] for s in SENSORS])
    filled = []
    for r, run in enumerate(runs):
        clean = signals[:, model.groups[0].runs.index(r)]
        values = 3.0 * scale + clean * (1 + 0.004 * random.normal(size=8)) + scale * random.normal(size=clean.shape)
        values[900:937, 2] = np.nan
        filled.append(with_values(run, values))
    data = replace(blank, bump_runs=tuple(filled))
    model = bump_model(data, parameters, {"bump": bump()})
    shape = model.groups[0].value.shape
    reading = np.where(random.uniform(size=shape) < 0.01, 0.05, 1.0)
    noise = np.tile(scale, (2, 1))
    weights = Weights((noise,), (np.full(noise.shape, 0.7),), (reading,))
    made = state_at(data, model, truth, motion, weights)
    root = root_of_covariance(made)[: truth.size]
    return replace(made, point=replace(made.point, covariance=root @ root.T))


def root_of_covariance(state: FitState) -> np.ndarray:
    """F with F F' the covariance of log parameters and motions."""
    information = state.problem().compressed(state.problem().vector(state.point.log_parameters)).jacobian
    return np.linalg.inv(np.linalg.cholesky(information.T @ information)).T


def differences(density: LogDensity, points: np.ndarray) -> np.ndarray:
    values = density(np.concatenate([density.centre[None], points]))
    return values[1:] - values[0]


def near(state: FitState, size: float) -> np.ndarray:
    """Points about `size` standard deviations away, in random directions."""
    factor = root_of_covariance(state)
    count = state.point.log_parameters.size
    steps = np.random.default_rng(9).normal(size=(6, len(factor))) @ factor.T
    return state.point.log_parameters + size * steps[:, :count]


def test_the_log_density_falls_as_with_all_samples(state):
    density = LogDensity(state)
    fewer = density.with_larger_steps()
    (shape,) = fewer._model.shapes
    assert shape.interval_s == pytest.approx(0.005)
    assert shape.samples == -(-SAMPLES // 5)
    points = near(state, 1.5)
    exact, found = differences(density, points), differences(fewer, points)
    assert exact.max() < -1.0
    # 1.5 standard deviations, masses and departures integrated out, in all of 12 directions: five standard deviations
    # away, where the log-density has fallen by ten and more.
    np.testing.assert_allclose(found, exact, atol=0.05, rtol=0.007)
    factor = np.linalg.cholesky(state.point.covariance)
    steps = 0.01 * factor.T
    slopes = [(d(d.centre + steps) - d(d.centre - steps)) / 0.02 for d in (fewer, density)]
    np.testing.assert_allclose(*slopes, rtol=0.0, atol=0.012)


def test_single_readings_in_place_of_joined_ones_lose_four_fifths(state, monkeypatch):
    monkeypatch.setattr(fewer_samples, "_with_residuals", lambda arrays, exact, kept, m: arrays._replace(
        value=arrays.value[::m] + kept - exact[::m], measured=arrays.measured[::m], censored=0.0 * kept))  # fmt: skip
    density = LogDensity(state)
    points = near(state, 1.5)
    assert (differences(density.with_larger_steps(), points) > 0.5 * differences(density, points)).all()


def test_readings_beside_gaps_keep_their_weight_and_residual(state):
    model, weights = state.model, state.point.weights
    made = with_fewer_samples(model, weights, state.point.log_parameters, state.point.motion)
    assert made is not None
    (arrays,), plain = made[0].arrays, made[1]
    assert plain.reading is None
    whole = weights.on(model.arrays, 0).measured ** 2
    # All the weight is there, but for what lies beside the gap and the ends.
    np.testing.assert_allclose((arrays.measured**2).sum(axis=0), whole.sum(axis=0), rtol=1e-12)
    assert not arrays.measured[182:186, :, 2].any()
    # The mean residual, an offset here, is that of all readings.
    (signals,) = simulate_runs(model, state.point.log_parameters, state.point.motion)
    (kept,) = simulate_runs(made[0], state.point.log_parameters, state.point.motion)
    before = (whole * (signals - model.arrays[0].value)).sum(axis=0) / whole.sum(axis=0)
    after = (arrays.measured**2 * (kept - arrays.value)).sum(axis=0) / (arrays.measured**2).sum(axis=0)
    size = np.abs(before).max(axis=0)
    np.testing.assert_allclose(after / size, before / size, atol=0.001)


def test_clipped_readings_and_slow_logs_stay_as_they_are(state):
    point, model = state.point, state.model
    clipped = model.arrays[0].censored.copy()
    clipped[1000, 0, 0] = 1.0
    bounded = replace(model, arrays=(model.arrays[0]._replace(censored=clipped),))
    assert with_fewer_samples(bounded, point.weights, point.log_parameters, point.motion) is None
    assert with_fewer_samples(model, point.weights, point.log_parameters, point.motion, (0.0015, 0.001)) is None


def test_signals_faster_than_the_kept_samples_are_not_thinned_out(state, monkeypatch):
    # Samples every 25 ms show nothing of wheel hop at 10 Hz and of the bump itself.
    point = state.point
    assert with_fewer_samples(state.model, point.weights, point.log_parameters, point.motion, (0.025,)) is None
