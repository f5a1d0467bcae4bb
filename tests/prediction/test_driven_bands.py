"""Posterior bands of driven runs: against a linear response, a loop over vehicles, and sampled readings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from fit_states import state_at
from rigid_truck import true_log_parameters
from scipy import stats
from synthetic_fit import NOISE, SPEED_M_S, START_S, synthetic_campaign

from sysid import limits
from sysid.campaign.records import Campaign
from sysid.campaign.vehicle_records import MassTolerances
from sysid.estimation.fit.state import FitState
from sysid.estimation.parameters.parameter_set import ParameterSet
from sysid.estimation.residuals.bump_model import GAIN_SD, bump_model
from sysid.estimation.residuals.histories import run_histories
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_history import HistoryBand
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs
from sysid.estimation.uncertainty.mass_response import MassResponse
from sysid.estimation.uncertainty.uncertain_masses import uncertain_masses
from sysid.prediction.run_bands import DRAWS, run_bands, with_bands
from sysid.road.road_profile import RoadProfile


@dataclass(frozen=True)
class Case:
    """A campaign, and the state of a fit that ended at the truth."""

    campaign: Campaign
    parameters: ParameterSet
    profiles: dict[str, RoadProfile]
    state: FitState
    truth: np.ndarray


@pytest.fixture(scope="module")
def fit() -> Case:
    data, parameters, profiles = synthetic_campaign()
    model = bump_model(data, parameters, profiles)
    (group,) = model.groups
    noise = np.array([NOISE[s.kind] for s in model.layout.sensors])
    scale = np.where(group.measured.any(axis=0), noise, np.inf)
    truth = true_log_parameters(parameters.names)
    weights = Weights((scale,), (np.full_like(scale, 0.6),))
    state = state_at(data, model, truth, RunMotion.steady(SPEED_M_S, START_S), weights)
    return Case(data, parameters, profiles, state, truth)


def shown(campaign: Campaign, parameters, profiles, state: FitState, x: np.ndarray, run: int) -> np.ndarray:
    """Signals (channels, T) of a run, offset and gain of every sensor by dense least squares with the gain's prior."""
    motion, weights = state.point.motion, state.point.weights
    model = bump_model(campaign, parameters, profiles)
    (group,), (signals,) = model.groups, simulate_runs(model, x, motion)
    r = group.runs.index(run)
    rows = []
    for c, sensor in enumerate(model.layout.sensors):
        y, keep = signals[:, r, c], group.measured[:, r, c] > 0
        scale = weights.noise_sd[0][r, c] / weights.tempering[0][r, c]
        if not np.isfinite(scale):
            # Nothing but the gain's prior.
            rows.append(np.full(y.size, np.nan))
            continue
        prior = 1.0 / GAIN_SD[sensor.kind]
        left = np.stack([np.ones(keep.sum()), y[keep]], axis=1) / scale
        right = np.append(group.value[keep, r, c] / scale, prior)
        (offset, gain), *_ = np.linalg.lstsq(np.concatenate([left, [[0.0, prior]]]), right, rcond=None)
        rows.append(offset + gain * y)
    return np.array(rows)


def test_a_narrow_posterior_has_the_band_of_a_linear_response(fit):
    # All draws on one line, at normal quantiles t: the signal is y + t J v, its 90 % band y +- 1.645 |J v|, which is
    # z sqrt(diag(J C J')) for C = v v'.
    state, z = fit.state, stats.norm.ppf(0.95)
    direction = np.random.default_rng(3).normal(size=len(fit.truth))
    direction *= 3e-4 / np.linalg.norm(direction)
    t = np.clip(stats.norm.ppf(np.arange(61) / 60.0), -3.0, 3.0)
    draws = state.point.log_parameters + t[:, None] * direction
    bands = run_bands(state, draws)
    for run, band in enumerate(bands):
        up, down = (
            shown(fit.campaign, fit.parameters, fit.profiles, state, state.point.log_parameters + s * direction, run)
            for s in (0.5, -0.5)
        )
        slope, middle = np.abs(up - down), 0.5 * (up + down)
        largest = slope.max(axis=1, keepdims=True)
        known = np.isfinite(largest[:, 0])
        assert known.sum() >= 7
        for end, sign in ((band.high, 1.0), (band.low, -1.0)):
            np.testing.assert_allclose(((end - middle - sign * z * slope) / largest)[known], 0.0, atol=0.02)


def test_every_draw_is_a_truck_of_its_own(fit):
    random = np.random.default_rng(8)
    # Declared masses with tolerances, and factors that go with the draws as the response says.
    # Loads as declared: a vehicle declared with others has other footprints.
    vehicle = replace(fit.campaign.vehicle, tolerances=MassTolerances(axle_load=0.0, axle_load_scale=0.0))
    data = replace(fit.campaign, vehicle=vehicle)
    masses = uncertain_masses(data)
    model = bump_model(data, fit.parameters, fit.profiles)
    state = FitState(data, fit.state.point, model)
    count = state.allowances.count
    response = MassResponse(
        fit.truth,
        np.zeros((count, len(fit.truth))),
        np.diag(np.r_[masses.sd, np.zeros(count)][:count]),
        np.zeros(count),
    )
    state = replace(state, point=replace(state.point, mass_response=response))
    draws = state.point.log_parameters + 0.02 * random.normal(size=(5, len(fit.truth)))
    bands = run_bands(state, draws, seed=4)
    factors = response.draws(draws, np.random.default_rng(4))[:, : masses.sd.size]
    assert np.abs(factors).max() > 0.01
    for run, band in enumerate(bands):
        signals = []
        for x, own in zip(draws, factors, strict=True):
            truck, cases = masses.applied(own)
            declared = replace(data, vehicle=truck, load_cases=cases)
            signals.append(shown(declared, fit.parameters, fit.profiles, state, x, run))
        low, high = np.quantile(signals, [0.05, 0.95], axis=0)
        known = np.isfinite(low[:, 0])
        np.testing.assert_allclose(band.low[known], low[known], atol=1e-8)
        np.testing.assert_allclose(band.high[known], high[known], atol=1e-8)


def test_a_reading_scatters_about_every_draw():
    random = np.random.default_rng(2)
    spread, noise = np.array([0.5, 1.0, 0.0])[:, None], np.array([1.0, 0.3, 0.7])
    low, high = (4.0 + stats.norm.ppf(q) * spread for q in (0.05, 0.95))
    found = HistoryBand(low, high).with_scatter(noise)
    draws = 4.0 + spread * random.normal(size=(3, 400_000))
    readings = draws + noise[:, None] * random.normal(size=draws.shape)
    expected = np.quantile(readings, [0.05, 0.95], axis=1)
    np.testing.assert_allclose([found.low[:, 0], found.high[:, 0]], expected, atol=0.01)


def test_histories_get_the_bands_of_their_own_length(fit):
    point = fit.state.point
    histories = run_histories(
        fit.campaign, fit.state.model, point.weights, point.motion, fit.truth, *[point.weights.noise_sd] * 2
    )
    count = histories[0].measured.shape
    bands = [HistoryBand(np.zeros((count[0], count[1] + 7)), np.ones((count[0], count[1] + 7)))] * 2
    found = with_bands(histories, bands)
    assert [h.band.low.shape for h in found] == [count, count]
    assert found[0].reading_band.high.shape == count
    table = found[0].to_pandas()
    column = found[0].columns[0]
    assert list(table.columns[:5]) == ["time_s", *(f"{column}_{e}" for e in ("measured", "simulated", "q05", "q95"))]
    assert set(found[0].to_xarray().data_vars) == {"measured", "simulated", "censored", "q05", "q95"}
    assert histories[0].reading_band is None


def test_long_chains_are_thinned(fit, monkeypatch):
    seen = []
    monkeypatch.setattr("sysid.prediction.run_bands.DRAWS", 3)
    run_bands(fit.state, np.tile(fit.truth, (10, 1)), progress=lambda message, share: seen.append(share))
    assert len(seen) == 3
    assert DRAWS >= 64


def test_group_by_group_the_bands_are_the_same(fit, monkeypatch):
    monkeypatch.setattr(limits, "GROUP_READINGS", 10)
    model = bump_model(fit.campaign, fit.parameters, fit.profiles)
    assert len(model.groups) == 2
    ((scale,), (tempering,)) = fit.state.point.weights.noise_sd, fit.state.point.weights.tempering
    order = [list(fit.state.model.groups[0].runs).index(g.runs[0]) for g in model.groups]
    weights = Weights(tuple(scale[r : r + 1] for r in order), tuple(tempering[r : r + 1] * (1 + r) for r in order))
    state = state_at(fit.campaign, model, fit.truth, fit.state.point.motion, weights)
    draws = fit.truth + 0.02 * np.random.default_rng(6).normal(size=(5, len(fit.truth)))
    together = run_bands(state, draws)
    monkeypatch.setattr(limits, "DERIVATIVES_BYTES", 0)
    heard: list[float] = []
    in_turn = run_bands(state, draws, progress=lambda _, done: heard.append(done))
    for one, other in zip(in_turn, together, strict=True):
        np.testing.assert_allclose(one.low, other.low, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(one.high, other.high, rtol=1e-12, atol=1e-14)
    assert sorted(heard) == [0.0, 0.5]
