"""A campaign made with the model itself: the fit finds what is behind the readings, and says how well it knows it."""

from __future__ import annotations

import numpy as np
import pytest
from rigid_truck import SENSORS
from synthetic_fit import CLIPPED, LOST, NOISE, NOMINAL_M_S, SAMPLES, SPEED_M_S, START_S, SyntheticFit, synthetic_fit

from sysid.estimation.fit.start_search import search_motion
from sysid.estimation.residuals.compressed import compress, run_normals
from sysid.estimation.residuals.linearisation import linearise
from sysid.estimation.residuals.run_motion import RunMotion, motion_prior
from sysid.estimation.residuals.signals import simulate_runs


@pytest.fixture(scope="session")
def fit() -> SyntheticFit:
    return synthetic_fit()


def test_parameters_lie_within_a_few_standard_deviations(fit):
    result = fit.result
    assert result.converged, result.message
    found = np.log([p.value for p in result.parameters])
    score = (found - fit.truth) / np.sqrt(np.diag(result.covariance))
    assert np.abs(score).max() < 4.0, dict(zip(result.names, score, strict=True))
    # Stiffness and damping to a per cent or better from two runs: far inside their generic priors.
    for p, truth in zip(result.parameters, fit.truth, strict=True):
        assert p.identified
        if p.quantity in ("stiffness", "damping"):
            assert p.value == pytest.approx(np.exp(truth), rel=0.01)
            assert p.sd < 0.01 * p.value


def test_joint_chi_square_of_the_errors(fit):
    """theta_hat - theta, measured by the reported covariance, is a draw of chi-square with 13 degrees of freedom."""
    error = np.log([p.value for p in fit.result.parameters]) - fit.truth
    distance = error @ np.linalg.solve(fit.result.covariance, error)
    assert 3.0 < distance < 35.0  # 99.9 % on both sides are 2.6 and 34.5


def test_speeds_and_starts(fit):
    by_name = {p.name: p for p in fit.result.run_parameters}
    for file, nominal, speed, start in zip(("slow.csv", "fast.csv"), NOMINAL_M_S, SPEED_M_S, START_S, strict=True):
        v, t = by_name[f"speed[{file}]"], by_name[f"start[{file}]"]
        assert v.prior_median == nominal
        assert abs(v.value - speed) < 5 * v.sd + 1e-5
        assert abs(t.value - start) < 5 * t.sd + 1e-6
        assert v.sd < 1e-3 * speed
        assert t.sd < 1e-3


def test_residual_scales_are_the_instrument_noise(fit):
    for history in fit.result.histories:
        assert history.columns == tuple(s.column for s in SENSORS)
        for k, sensor in enumerate(SENSORS):
            if (history.file, sensor.column) == LOST:
                assert np.isinf(history.noise_sd[k])
                assert np.isnan(history.measured[k]).all()
                continue
            assert history.noise_sd[k] == pytest.approx(NOISE[sensor.kind], rel=0.15)
            assert history.instrument_noise_sd[k] == pytest.approx(NOISE[sensor.kind], rel=0.35)
            assert abs(history.gain[k] - 1.0) < 0.012
    assert fit.result.variance_inflation < 1.5
    assert fit.result.residual_evidence.autocorrelation_before.shape[0] == 15


def test_clipped_samples_are_kept_apart(fit):
    file, column, limit = CLIPPED
    history = next(h for h in fit.result.histories if h.file == file)
    k = history.columns.index(column)
    assert (history.censored[k] != 0).sum() > 5
    beyond = history.censored[k] != 0
    assert np.abs(history.simulated[k][beyond]).max() > limit + 5.0
    assert fit.result.residuals == 2 * 8 * SAMPLES - SAMPLES - beyond.sum()


def test_motion_search_comes_close_from_rough_parameters(fit):
    start = fit.parameters.start
    assert np.abs(start - fit.truth).max() > 0.5
    instrument = tuple(np.where(np.isfinite(n), n, np.inf) for n in fit.state.point.weights.noise_sd)
    found = search_motion(fit.state.model, fit.campaign, start, instrument)
    # Springs that are twice as stiff shift the histories: near enough for least squares to converge from there.
    np.testing.assert_allclose(found.speed_m_s, SPEED_M_S, rtol=0.06)
    np.testing.assert_allclose(found.start_s, START_S, atol=0.05)
    exact = search_motion(fit.state.model, fit.campaign, fit.truth, instrument)
    np.testing.assert_allclose(exact.speed_m_s, SPEED_M_S, rtol=0.004)
    np.testing.assert_allclose(exact.start_s, START_S, atol=0.004)


def test_compressed_problem_has_the_squares_and_products_of_the_dense_one(fit):
    """J'J, J'r and r'r of all residuals, stacked densely here, priors included."""
    state, campaign = fit.state, fit.campaign
    nominal = np.array([r.nominal_speed_m_s for r in campaign.bump_runs])
    parameters = fit.truth + 0.02
    motion = RunMotion(state.point.motion.speed_m_s * 1.001, state.point.motion.start_s, np.array([-0.03, 0.01]))
    lin = linearise(state.model, state.point.weights, parameters, motion)
    small = compress(state.model, lin, parameters, motion, motion_prior(campaign.bump_runs))
    p = parameters.size
    residuals, jacobians = [], []
    for position, group in enumerate(state.model.groups):
        for r, run in enumerate(group.runs):
            column = p + 3 * [g for grp in state.model.groups for g in grp.runs].index(run)
            for part, slopes in (
                (np.asarray(lin[position].residual)[:, r].reshape(-1), lin[position].residual_jacobian[:, r]),
                (np.asarray(lin[position].gain_residual)[r], lin[position].gain_jacobian[r]),
            ):
                rows = np.asarray(slopes).reshape(-1, p + 3)
                wide = np.zeros((rows.shape[0], p + 3 * nominal.size))
                wide[:, :p], wide[:, column : column + 3] = rows[:, :p], rows[:, p:]
                residuals.append(part)
                jacobians.append(wide)
            speed = motion.speed_m_s[run] / nominal[run]
            prior = np.zeros((2, p + 3 * nominal.size))
            prior[0, column] = 0.01 * speed / 0.03
            change = motion.speed_change[run]
            prior[0, column + 2] = -speed / (2.0 + change) * 0.02 / 0.03
            prior[1, column + 2] = 1.0
            residuals.append(np.array([(speed - 1.0) / 0.03, change / 0.02]))
            jacobians.append(prior)
    for k, parameter in enumerate(fit.parameters.parameters):
        residuals.append(np.array([(parameters[k] - np.log(parameter.prior_median)) / parameter.prior_sd]))
        jacobians.append(np.eye(1, p + 3 * nominal.size, k) / parameter.prior_sd)
    r, jacobian = np.concatenate(residuals), np.concatenate(jacobians)
    assert small.residual.size < r.size / 20
    assert small.residual @ small.residual == pytest.approx(r @ r, rel=1e-10)
    for ours, exact in (
        (small.jacobian.T @ small.jacobian, jacobian.T @ jacobian),
        (small.jacobian.T @ small.residual, jacobian.T @ r),
    ):
        np.testing.assert_allclose(ours, exact, rtol=1e-8, atol=1e-9 * np.abs(exact).max())
    assert sum(len(list(run_normals(one))) for one in lin) == nominal.size


def test_local_columns_count_in_units_of_the_reference(fit):
    """Derivatives with respect to the solver's vector by differences, away from the reference motion."""
    problem = fit.state.problem()
    vector = np.concatenate([fit.truth, [2.0, -1.0, 1.5, -1.5, 3.0, -0.7]])
    residual, jacobian = problem.evaluate(vector)
    gradient = jacobian.T @ residual
    for k in range(fit.truth.size, vector.size):
        step = np.zeros(vector.size)
        step[k] = 1e-4
        up, down = (problem.evaluate(vector + s * step)[0] for s in (1, -1))
        slope = (up @ up - down @ down) / (4e-4)
        assert gradient[k] == pytest.approx(slope, rel=2e-4, abs=1e-5 * np.abs(gradient).max())


def test_step_halving_is_reported(fit):
    assert 0.0 < fit.result.step_halving_error < 5e-3
    coarse = simulate_runs(fit.state.model, fit.state.point.log_parameters, fit.state.point.motion)
    assert coarse[0].shape == (SAMPLES, 2, 8)
