"""What the posterior of a small campaign must do, whatever its numbers: prior and doubled data."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from figures import record
from fit_states import state_at
from synthetic_fit import SyntheticFit, synthetic_fit

from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.posterior.log_density import LogDensity
from sysid.posterior.options import SamplingOptions
from sysid.posterior.sampled_posterior import Posterior
from sysid.posterior.sampling import sample_posterior

#: Stiffness and damping: all others stay at the optimum, so that the priors are wide beside the posterior.
SAMPLED = 6


def chain(density, centre: np.ndarray, covariance: np.ndarray, steps: int, seed: int = 1) -> Posterior:
    names = tuple(f"x_{i}" for i in range(centre.size))
    options = SamplingOptions(segment_steps=50, adapting_steps=0, max_steps=steps, min_steps=steps, seed=seed)
    return sample_posterior(density, names, centre, covariance, "test", options)


def moments(posterior: Posterior, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation of the first log parameters."""
    draws = np.log(posterior.draws.reshape(-1, len(posterior.names)))[:, :count]
    return draws.mean(axis=0), draws.std(axis=0)


def effective(posterior: Posterior, count: int) -> np.ndarray:
    return np.array([s.ess for s in posterior.summaries[:count]])


@pytest.fixture(scope="module")
def fit() -> SyntheticFit:
    return synthetic_fit()


def test_without_data_the_posterior_is_the_prior(fit):
    """The priors of a campaign are a Gaussian whose mean and covariance are those of weighted least squares."""
    rows, targets = fit.parameters.prior_rows()
    covariance = np.linalg.inv(rows.T @ rows)
    mean = covariance @ rows.T @ targets
    sd = np.sqrt(np.diag(covariance))
    # Proposals from elsewhere, so that the density and not the start decides.
    found = chain(lambda x: -0.5 * ((x @ rows.T - targets) ** 2).sum(axis=1), mean + 0.3 * sd, 1.5 * covariance, 800)
    sampled_mean, sampled_sd = moments(found, mean.size)
    error = 1.0 / np.sqrt(effective(found, mean.size))
    assert error.max() < 0.03
    assert np.all(np.abs(sampled_mean - mean) / sd < 4.0 * error)
    assert np.all(np.abs(sampled_sd / sd - 1.0) < 4.0 * error)


def slice_of(fit: SyntheticFit, density):
    """The density of stiffness and damping with everything else at the optimum."""
    centre = fit.state.point.log_parameters

    def conditional(points: np.ndarray) -> np.ndarray:
        full = np.tile(centre, (len(points), 1))
        full[:, :SAMPLED] = points[:, :SAMPLED]
        return density(full)

    return conditional


def conditional_covariance(fit: SyntheticFit) -> np.ndarray:
    return np.linalg.inv(np.linalg.inv(fit.result.covariance)[:SAMPLED, :SAMPLED])


def doubled(fit: SyntheticFit) -> LogDensity:
    """The density of a campaign in which every run was driven twice with the same readings."""
    runs = fit.campaign.bump_runs
    again = tuple(replace(r, repeat=2, log=replace(r.log, file=f"again_{r.log.file}")) for r in runs)
    campaign = replace(fit.campaign, bump_runs=runs + again)
    model = bump_model(campaign, fit.parameters, fit.profiles, tires=fit.state.model.tires)
    (group,), (old,) = model.groups, fit.state.model.groups
    # A run's weights by its place in the campaign, whatever the order within the group.
    place = [old.runs.index(r % len(runs)) for r in group.runs]
    scale, tempering = (
        tuple(w[place] for w in m) for m in (fit.state.point.weights.noise_sd, fit.state.point.weights.tempering)
    )
    # Normal noise: no reading has a weight of its own.
    assert fit.state.point.weights.reading is None
    weights = Weights(scale, tempering)
    motion = RunMotion(*(np.tile(v, 2) for v in vars(fit.state.point.motion).values()))
    return LogDensity(state_at(campaign, model, fit.state.point.log_parameters, motion, weights))


@pytest.mark.long
def test_doubled_data_shrink_standard_deviations_by_the_square_root_of_two(fit):
    once = LogDensity(replace(fit.state, point=replace(fit.state.point, following=None)))
    centre, covariance = fit.state.point.log_parameters[:SAMPLED], conditional_covariance(fit)
    first = chain(slice_of(fit, once), centre, covariance, 400)
    second = chain(slice_of(fit, doubled(fit)), centre, covariance / 2, 400, seed=2)
    (_, wide), (_, narrow) = moments(first, SAMPLED), moments(second, SAMPLED)
    ratio = wide / narrow
    prior = np.array([p.prior_sd for p in fit.parameters.parameters[:SAMPLED]])
    ess = min(effective(first, SAMPLED).min(), effective(second, SAMPLED).min())
    record(
        "doubled_data",
        {"ratio / sqrt 2": list(ratio / np.sqrt(2)), "prior / posterior sd": list(prior / wide), "ess": float(ess)},
    )
    assert (prior / wide).min() >= 20.0
    assert ess >= 5000.0
    np.testing.assert_allclose(ratio, np.sqrt(2.0), rtol=0.03)
