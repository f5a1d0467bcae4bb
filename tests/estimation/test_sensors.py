"""Elimination of sensor offset and gain, clipped and missing samples: against dense least squares of NumPy."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from sysid.estimation.residuals.bump_model import GroupArrays
from sysid.vehicle_model.readings import eliminate_sensors, residuals_of_trials, standardised_residuals

SAMPLES, RUNS, CHANNELS, SETS = 60, 2, 3, 4
GAIN_SD = np.array([0.005, 0.01, 0.01])


@pytest.fixture
def case() -> tuple[GroupArrays, np.ndarray, np.ndarray]:
    """Data arrays with missing samples, residual scales (R, C), simulated signals (T, R, C, S)."""
    random = np.random.default_rng(11)
    simulated = random.normal(size=(SAMPLES, RUNS, CHANNELS, SETS)).cumsum(axis=0)
    noise = random.uniform(0.05, 0.2, (RUNS, CHANNELS))
    value = 0.7 + 1.01 * simulated[..., 0] + noise * random.normal(size=(SAMPLES, RUNS, CHANNELS))
    measured = (random.random((SAMPLES, RUNS, CHANNELS)) > 0.2).astype(float)
    arrays = GroupArrays(None, None, None, value * measured, measured, np.zeros_like(value), GAIN_SD, np.zeros(RUNS))
    return arrays, noise, simulated


def test_offset_and_gain_equal_dense_least_squares(case):
    arrays, noise, simulated = case
    fit = eliminate_sensors(arrays.readings(noise, np.ones_like(noise)), jnp.asarray(simulated))
    for r, c, s in np.ndindex(RUNS, CHANNELS, SETS):
        keep = arrays.measured[:, r, c] > 0
        y, d = simulated[keep, r, c, s], arrays.value[keep, r, c]
        rows = np.stack([np.ones(y.size), y], axis=1) / noise[r, c]
        rows = np.concatenate([rows, [[0.0, 1.0 / GAIN_SD[c]]]])
        right = np.concatenate([d / noise[r, c], [1.0 / GAIN_SD[c]]])
        offset, gain = np.linalg.lstsq(rows, right, rcond=None)[0]
        assert float(fit.offset[r, c, s]) == pytest.approx(offset, abs=1e-9)
        assert float(fit.gain[r, c, s]) == pytest.approx(gain, abs=1e-10)


def test_residuals_carry_the_minimum_of_the_dense_problem(case):
    arrays, noise, simulated = case
    residual, prior = standardised_residuals(arrays.readings(noise, np.ones_like(noise)), jnp.asarray(simulated))
    for r, c, s in np.ndindex(RUNS, CHANNELS, SETS):
        keep = arrays.measured[:, r, c] > 0
        rows = np.stack([np.ones(keep.sum()), simulated[keep, r, c, s]], axis=1) / noise[r, c]
        rows = np.concatenate([rows, [[0.0, 1.0 / GAIN_SD[c]]]])
        right = np.concatenate([arrays.value[keep, r, c] / noise[r, c], [1.0 / GAIN_SD[c]]])
        smallest = np.linalg.lstsq(rows, right, rcond=None)[1][0]
        assert float((residual[:, r, c, s] ** 2).sum() + prior[r, c, s] ** 2) == pytest.approx(smallest, rel=1e-9)
        assert not np.asarray(residual[:, r, c, s])[~keep].any()


@pytest.mark.parametrize("clipped", [False, True])
def test_residuals_of_models_by_numpy_are_those_by_jax(case, clipped: bool):
    """With a channel that has no reading, and one of which no reading is plain."""
    arrays, noise, simulated = case
    noise = noise.copy()
    noise[1, 2] = np.inf
    arrays.measured[:, 1, 2] = 0.0
    if clipped:
        arrays.censored[:20, 0] = 1.0
        arrays.censored[20:30, 1] = -1.0
        arrays.measured[:20, 0] = arrays.measured[20:30, 1] = arrays.measured[:, 0, 1] = 0.0
    tempering = np.linspace(0.3, 1.0, noise.size).reshape(noise.shape)
    residual, gain = standardised_residuals(arrays.readings(noise, tempering), jnp.asarray(simulated))
    found, of_gain = residuals_of_trials(arrays.readings(noise, tempering), np.moveaxis(simulated, -1, 2))
    np.testing.assert_allclose(found, np.transpose(residual, (3, 1, 2, 0)), rtol=0.0, atol=2e-13)
    np.testing.assert_allclose(of_gain, np.moveaxis(np.asarray(gain), -1, 0), rtol=0.0, atol=4e-13)


def test_an_offset_of_the_data_changes_no_residual(case):
    arrays, noise, simulated = case
    moved = arrays._replace(value=(arrays.value + 5.0) * arrays.measured)
    first, second = (
        standardised_residuals(a.readings(noise, np.ones_like(noise)), jnp.asarray(simulated)) for a in (arrays, moved)
    )
    for a, b in zip(first, second, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)


def test_a_channel_without_readings_says_nothing(case):
    arrays, noise, simulated = case
    silent = arrays._replace(
        measured=arrays.measured * np.array([0.0, 1.0, 1.0]), value=arrays.value * np.array([0.0, 1.0, 1.0])
    )
    scale = noise.copy()
    scale[:, 0] = np.inf
    residual, prior = standardised_residuals(silent.readings(scale, np.ones_like(noise)), jnp.asarray(simulated))
    assert np.isfinite(residual).all()
    assert np.isfinite(prior).all()
    assert not np.asarray(residual[:, :, 0]).any()
    assert not np.asarray(prior[:, 0]).any()


def test_clipped_samples_count_only_where_the_simulation_stays_inside_the_range(case):
    """The signal is clipped at +-2: where the simulation exceeds the range it agrees, elsewhere it does not."""
    _, noise, simulated = case
    noise = np.full_like(noise, 0.1)
    signal = simulated[..., :1]
    value = np.clip(signal[..., 0], -2.0, 2.0)
    side = (signal[..., 0] >= 2.0).astype(float) - (signal[..., 0] <= -2.0)
    assert (side == 1).sum() > 20
    assert (side == -1).sum() > 20
    arrays = GroupArrays(None, None, None, value, (side == 0).astype(float), side, GAIN_SD, np.zeros(RUNS))
    exact, _ = standardised_residuals(arrays.readings(noise, np.ones_like(noise)), jnp.asarray(signal))
    np.testing.assert_allclose(exact, 0.0, atol=1e-8)
    # A simulation that is too small everywhere misses the range at the clipped samples.
    small = np.clip(signal, -1.5, 1.5)
    residual, _ = standardised_residuals(arrays.readings(noise, np.ones_like(noise)), jnp.asarray(small))
    fit = eliminate_sensors(arrays.readings(noise, np.ones_like(noise)), jnp.asarray(small))
    shown = np.asarray(fit.offset + fit.gain * small)[..., 0]
    expected = np.where(side > 0, np.minimum(shown - 2.0, 0.0), np.where(side < 0, np.maximum(shown + 2.0, 0.0), 0.0))
    clipped = side != 0
    np.testing.assert_allclose(np.asarray(residual)[..., 0][clipped], (expected / 0.1)[clipped], atol=1e-9)
    assert np.abs(expected[clipped]).max() > 0.1


def test_tempering_acts_like_a_wider_scale(case):
    """In the elimination too: the gain's prior must not lose against readings that count for less."""
    arrays, noise, simulated = case
    wider = standardised_residuals(arrays.readings(noise / 0.4, np.ones_like(noise)), jnp.asarray(simulated))
    tempered = standardised_residuals(arrays.readings(noise, np.full_like(noise, 0.4)), jnp.asarray(simulated))
    for a, b in zip(wider, tempered, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-12)
