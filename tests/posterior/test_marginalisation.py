"""Motions of runs integrated out against motions sampled, on a small campaign."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from figures import record
from scipy.stats import multivariate_t
from synthetic_fit import NOMINAL_M_S, SyntheticFit, synthetic_fit
from test_log_density import motions, squares

from sysid.estimation.residuals.compressed import compress, run_order
from sysid.estimation.residuals.linearisation import linearise
from sysid.estimation.residuals.run_motion import motion_prior
from sysid.posterior.log_density import LogDensity
from sysid.vehicle_model.motion import Motion

BATCH = 100
DRAWS = 4000
#: Degrees of freedom of the proposals.
FREEDOM = 15.0
#: Standard deviation of a run's speed about the nominal one, and of its change over the passage.
SPEED_SD, CHANGE_SD = 0.03, 0.02


def joint_density(fit: SyntheticFit, points: np.ndarray) -> np.ndarray:
    """Log-density (n,) of log parameters and scaled motions of both runs, (n, p + 6), nothing integrated."""
    model, state = fit.state.model, fit.state
    runs = list(model.groups[0].runs)
    count = fit.truth.size
    parameters, local = points[:, :count], points[:, count:].reshape(-1, len(runs), 3)
    motion, change = motions(fit, runs, np.moveaxis(local, 0, -1))
    weights = (state.point.weights.noise_sd[0], state.point.weights.tempering[0])
    total = [
        squares(
            model.arrays[0],
            model.roads[0],
            *weights,
            jnp.asarray(parameters[k : k + BATCH].T),
            Motion(*(v[:, k : k + BATCH] for v in motion[:3])),
            shape=model.shapes[0],
        )
        for k in range(0, len(points), BATCH)
    ]
    nominal = np.array(NOMINAL_M_S)[runs][:, None]
    expected = ((np.asarray(motion.speed) / nominal - 1.0) / SPEED_SD) ** 2 + (change / CHANGE_SD) ** 2
    data = (np.concatenate(total, axis=1) + expected).sum(axis=0)
    rows, targets = fit.parameters.prior_rows()
    return -0.5 * (data + ((parameters @ rows.T - targets) ** 2).sum(axis=1))


def marginal_density(fit: SyntheticFit, points: np.ndarray) -> np.ndarray:
    density = LogDensity(replace(fit.state, point=replace(fit.state.point, integrated=None)))
    return np.concatenate([density(points[k : k + BATCH]) for k in range(0, len(points), BATCH)])


def weighted_moments(density, centre: np.ndarray, covariance: np.ndarray, seed: int):
    """Mean, standard deviation and effective number of draws by importance sampling from a multivariate t."""
    proposal = multivariate_t(centre, 1.2 * covariance, df=FREEDOM, seed=seed)
    points = proposal.rvs(DRAWS)
    log_weight = density(points) - proposal.logpdf(points)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    mean = weight @ points
    return mean, np.sqrt(weight @ (points - mean) ** 2), 1.0 / (weight**2).sum()


@pytest.mark.long
def test_sampled_motions_give_the_same_posterior():
    fit = synthetic_fit()
    state, count = fit.state, fit.truth.size
    assert list(run_order(state.model)) == list(state.model.groups[0].runs)
    expected = motion_prior(fit.campaign.bump_runs)
    lins = linearise(state.model, state.point.weights, state.point.log_parameters, state.point.motion)
    jacobian = compress(state.model, lins, state.point.log_parameters, state.point.motion, expected).jacobian
    covariance = np.linalg.inv(jacobian.T @ jacobian)
    centre = np.concatenate([state.point.log_parameters, np.zeros(len(covariance) - count)])
    shared = covariance[:count, :count]

    sampled, sampled_sd, size = weighted_moments(lambda x: joint_density(fit, x), centre, covariance, 1)
    ours, ours_sd, other_size = weighted_moments(lambda x: marginal_density(fit, x), centre[:count], shared, 2)
    _, fixed_sd, _ = weighted_moments(
        lambda x: joint_density(fit, np.concatenate([x, np.zeros((len(x), 6))], axis=1)), centre[:count], shared, 3
    )
    assert min(size, other_size) > 400
    error = np.sqrt(1.0 / size + 1.0 / other_size)
    off, ratio = (sampled[:count] - ours) / ours_sd, sampled_sd[:count] / ours_sd
    record("marginalisation", {"means_sd": off.tolist(), "sd_ratio": ratio.tolist(), "limit": 4.0 * error})
    assert np.abs(off).max() < 4.0 * error
    assert np.abs(ratio - 1.0).max() < 4.0 * error
    # Motions that are held fixed make some parameter look better known: the comparison sees the difference.
    assert (fixed_sd / ours_sd).min() < 1.0 - 8.0 * error
