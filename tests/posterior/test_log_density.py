"""The log-density against brute-force integration over speed and start, and against the covariance of the fit."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import logsumexp
from synthetic_fit import NOMINAL_M_S, SyntheticFit, synthetic_fit

from sysid.estimation.residuals.problem import Problem
from sysid.estimation.residuals.run_motion import SHIFT_UNIT_M, SPEED_UNIT
from sysid.estimation.residuals.signals import simulate_group
from sysid.estimation.uncertainty.information import optimum_information
from sysid.estimation.uncertainty.integrated_unknowns import integrated_unknowns, nothing_integrated
from sysid.estimation.uncertainty.normal_equations import NormalEquations
from sysid.posterior.log_density import LogDensity, _common_slope, _principal_axes
from sysid.posterior.named_density import NamedDensity
from sysid.vehicle_model.engines.reference import REFERENCE
from sysid.vehicle_model.motion import Motion
from sysid.vehicle_model.readings import standardised_residuals


@pytest.fixture(scope="session")
def fit() -> SyntheticFit:
    return synthetic_fit()


@pytest.fixture(scope="session")
def density(fit) -> LogDensity:
    """The density of the parameters alone, masses and departures held, under fixed footprint maps."""
    return LogDensity(replace(fit.state, point=replace(fit.state.point, integrated=None)))


def in_batches(density: LogDensity, points: np.ndarray) -> np.ndarray:
    """Densities of points (n, p), five at a time: one batch size is compiled once."""
    padded = np.concatenate([points, np.tile(points[-1:], (-len(points) % 5, 1))])
    return np.concatenate([density(chunk) for chunk in padded.reshape(-1, 5, points.shape[1])])[: len(points)]


@partial(jax.jit, static_argnames=("shape",))
def squares(arrays, road, noise, tempering, x, motion, *, shape) -> jax.Array:
    """Sum of squared residuals, sensor gains included, of every run and set (R, S), simulated at each set's motion."""
    inputs = REFERENCE.prepare(road, arrays.axle_x, motion, shape.timing)
    signals = simulate_group(arrays, shape, x, inputs)
    residual, gain = standardised_residuals(arrays.readings(noise, tempering), signals)
    return (residual**2).sum(axis=(0, 2)) + (gain**2).sum(axis=1)


def motions(fit: SyntheticFit, runs: list[int], local: np.ndarray) -> tuple[Motion, np.ndarray]:
    """Motions (R, S) at scaled unknowns (R, 3, S) away from the optimum, and their changes of speed (R, S)."""
    best = fit.state.point.motion
    speed0, start0 = best.speed_m_s[runs][:, None], best.start_s[runs][:, None]
    change0 = best.speed_change[runs][:, None]
    change = change0 + 0.02 * local[:, 2]
    speed = speed0 * (1 + change0 / 2) * (1 + SPEED_UNIT * local[:, 0]) / (1 + change / 2)
    length = max(a.x_m for a in fit.campaign.vehicle.axles)
    acceleration = ((1.0 + change) ** 2 - 1.0) * speed**2 / (2.0 * length)
    start = start0 + SHIFT_UNIT_M / speed0 * local[:, 1]
    return Motion(*(jnp.asarray(v) for v in (speed, start, acceleration))), change


def log_marginal(fit: SyntheticFit, x: np.ndarray, widths: np.ndarray) -> float:
    """log of the integral over the motions of both runs, on grids of 7^3 simulations; with the prior of x."""
    model, state = fit.state.model, fit.state
    runs = list(model.groups[0].runs)
    # Steps of 1.4 standard deviations integrate a Gaussian to 1e-4.
    u = np.linspace(-4.2, 4.2, 7)
    # Whitened grid of each run: its unknowns are strongly correlated.
    local = np.einsum("rkl,ls->rks", widths, np.stack([g.ravel() for g in np.meshgrid(u, u, u)]))
    motion, change = motions(fit, runs, local)
    total = squares(
        state.point.weights.on(model.arrays, 0),
        model.roads[0],
        state.point.weights.noise_sd[0],
        state.point.weights.tempering[0],
        jnp.asarray(np.tile(x[:, None], u.size**3)),
        motion,
        shape=model.shapes[0],
    )
    nominal = np.array(NOMINAL_M_S)[runs][:, None]
    total = np.asarray(total) + ((np.asarray(motion.speed) / nominal - 1.0) / 0.03) ** 2 + (change / 0.02) ** 2
    prior = sum(((x[i] - np.log(p.prior_median)) / p.prior_sd) ** 2 for i, p in enumerate(fit.parameters.parameters))
    return float(logsumexp(-0.5 * total, axis=1).sum() - 0.5 * prior)


def test_marginalisation_equals_brute_force_integration(fit, density):
    centre = fit.state.point.log_parameters
    sd = np.sqrt(np.diag(fit.result.covariance))
    by_run = {p.run: {} for p in fit.result.run_parameters}
    for p in fit.result.run_parameters:
        by_run[p.run][p.quantity] = p.sd
    files = [fit.campaign.bump_runs[r].log.file for r in fit.state.model.groups[0].runs]
    # Conditional widths for the grid, in the solver's units: a factor of the local normal matrix.
    own = density._inputs[0].columns.residual[..., :3]
    normal = np.einsum("trck,trcl->rkl", own, own) + np.diag([0.0, 0.0, 1.0])
    widths = np.linalg.inv(np.linalg.cholesky(normal)).transpose(0, 2, 1)
    assert all(by_run[f]["speed"] > 0 for f in files)
    random = np.random.default_rng(3)
    points = [centre, centre + sd * np.eye(13)[0], centre + sd * random.normal(size=13)]
    brute = np.array([log_marginal(fit, x, widths) for x in points])
    ours = in_batches(density, np.array(points))
    # The columns of the motion are frozen at the optimum: exact up to their change over a standard deviation.
    np.testing.assert_allclose(ours - ours[0], brute - brute[0], rtol=5e-3, atol=0.02)
    assert np.ptp(brute) > 1.0


def test_maps_that_follow_the_tires_act_as_a_change_of_the_parameters(fit, density):
    following = np.eye(13) + 0.3 * np.random.default_rng(2).normal(size=(13, 13))
    integrated = replace(nothing_integrated(13), following=following)
    followed = LogDensity(replace(fit.state, point=replace(fit.state.point, integrated=integrated)))
    centre = fit.state.point.log_parameters
    points = centre + 0.01 * np.random.default_rng(4).normal(size=(5, 13))
    rows, targets = fit.parameters.prior_rows()

    def prior(x: np.ndarray) -> np.ndarray:
        return -0.5 * ((x @ rows.T - targets) ** 2).sum(axis=1)

    # The priors are those of the parameters themselves.
    there = centre + (points - centre) @ following.T
    np.testing.assert_allclose(followed(points) - prior(points), density(there) - prior(there), rtol=1e-9)


def test_the_density_is_that_of_the_covariance_and_mode_of_the_fit(fit):
    """One and two standard deviations along any principal axis cost half a unit and two of log-density."""
    point = fit.state.point
    np.testing.assert_allclose(point.covariance, fit.result.covariance)
    axes, density = _principal_axes(point.covariance), LogDensity(fit.state)
    here = density(point.mode[None])
    for far in (1.0, 2.0):
        up, down = (in_batches(density, point.mode + s * far * axes) for s in (1.0, -1.0))
        np.testing.assert_allclose((0.5 * (up + down) - here) / far**2, -0.5, atol=0.03)
        # The joint optimum ends within a tenth of a standard deviation, where the slope is 0.1 either way.
        np.testing.assert_allclose((up - down) / far, 0.0, atol=0.2)
    # With masses and tires held some direction costs more.
    held = LogDensity(replace(fit.state, point=replace(point, integrated=None)))
    assert (in_batches(held, point.mode + axes) - held(point.mode[None])).min() < -0.56


def test_masses_are_integrated_as_the_truck_moves_with_them(fit):
    """Along the widest axis, against the cost of trucks of other masses, each simulated, motions followed.

    For a normal distribution the integral over unknowns is, up to a constant, the density at their best.
    """
    state, point, count = fit.state, fit.state.point, fit.truth.size
    allowances, problem = state.allowances, state.problem()
    known = problem.vector(point.log_parameters), allowances, point.amounts
    data = optimum_information(state.campaign, problem, *known)
    _, prior = state.parameters.prior_pull(point.log_parameters)
    # Departures stay.
    sd = np.concatenate([allowances.masses.sd, np.zeros(len(allowances.departures.directions))])
    integrated = integrated_unknowns(data.matrix, prior, np.zeros((count, 0)), sd, point.amounts, 1.0, np.eye(count))
    _, response = NormalEquations.of(data.matrix, sd=sd).eliminate(slice(count, None))
    axis = _principal_axes(point.covariance)[-1]
    points = point.log_parameters + np.array([-2.0, 0.0, 2.0])[:, None] * axis
    costs = []
    for x in points:
        amounts = point.amounts + response @ (x - point.log_parameters)
        model = allowances.on_same_roads(state.model, amounts)
        problem = Problem(model, state.campaign, point.motion, point.weights)
        residual, jacobian = problem.evaluate(problem.vector(x))
        own = jacobian[:, len(x) :]
        left = residual - own @ np.linalg.lstsq(own, residual, rcond=None)[0]
        costs.append(0.5 * left @ left + 0.5 * np.sum((amounts[sd > 0.0] / sd[sd > 0.0]) ** 2))
    density = LogDensity(replace(state, point=replace(point, integrated=integrated)))(points)
    np.testing.assert_allclose(density - density[1], np.array(costs[1]) - costs, atol=5e-3)
    assert np.ptp(density) > 1.0


def test_batches_and_single_points_agree(fit, density):
    points = fit.state.point.log_parameters + 0.01 * np.random.default_rng(5).normal(size=(5, 13))
    together = density(points)
    assert together.shape == (5,)
    np.testing.assert_allclose(density(points[0]), together[:1], rtol=1e-10)


def test_a_point_without_a_finite_simulation_is_rejected(fit):
    density = LogDensity(fit.state)
    points = np.tile(fit.state.point.log_parameters, (5, 1))
    points[1, 0] = 800.0
    points[3, 2] = np.nan
    found = density(points)
    np.testing.assert_array_equal(np.isneginf(found), [False, True, False, True, False])


def test_larger_steps_nearly_keep_value_and_slope_at_the_centre_and_all_around_it(fit):
    exact = LogDensity(fit.state)
    larger = exact.with_larger_steps()
    assert larger is not exact
    factor = np.linalg.cholesky(fit.state.point.covariance)
    steps = 0.01 * factor.T
    near = np.concatenate([exact.centre[None], exact.centre + steps, exact.centre - steps])
    values = np.array([in_batches(d, near) for d in (exact, larger)])
    # The gains of the sensors, which are eliminated, follow the signals: nothing else changes.
    np.testing.assert_allclose(values[1, 0], values[0, 0], rtol=0.0, atol=0.02)
    up, down = values[:, 1:14], values[:, 14:]
    slopes = (up - down) / 0.02
    # A slope of 0.01 moves a mean by a hundredth of its standard deviation.
    np.testing.assert_allclose(slopes[1], slopes[0], rtol=0.0, atol=0.006)
    points = exact.centre + np.random.default_rng(9).normal(size=(20, 13)) @ factor.T
    fine = in_batches(exact, points)
    off = in_batches(larger, points) - fine
    assert np.ptp(fine) > 5.0
    assert off.std() < 0.035
    # The larger steps alone would move the posterior.
    coarse = replace(larger._model, arrays=fit.state.model.arrays)
    alone = in_batches(LogDensity(replace(fit.state, model=coarse)), points) - fine
    assert alone.std() > 30.0 * 0.035, (off.std(), alone.std())


def test_the_linear_term_is_what_both_sides_have_in_common():
    """A plane is found exactly; a corner, whose derivative on one side is 300, adds nothing to it."""
    random = np.random.default_rng(3)
    covariance = np.cov(random.normal(size=(4, 40)) * np.array([[1e-3], [0.2], [0.05], [3.0]]))
    axes, slope = _principal_axes(covariance), random.normal(size=4)
    np.testing.assert_allclose(axes.T @ axes, covariance, rtol=1e-9, atol=1e-12)
    points = np.concatenate([np.zeros((1, 4)), axes, -axes])
    np.testing.assert_allclose(_common_slope(5.0 + points @ slope, axes), slope, rtol=1e-9)
    first = axes[np.argmax(np.abs(axes @ slope))]
    across = points @ np.linalg.solve(covariance, first)
    corner = points @ slope + 300.0 * np.minimum(0.0, across * np.sign(first @ slope) + 1e-6)
    found = _common_slope(corner, axes)
    np.testing.assert_allclose(found, slope, rtol=1e-9)


def test_the_density_by_names_takes_a_residual_of_ones_own(fit: SyntheticFit) -> None:
    named = NamedDensity(fit.state, fit.result.histories)
    at = named.names.index("k_1")
    sd = float(np.sqrt(named.log_covariance[at, at]))
    along = named.log_covariance[:, at] / sd  # how all others follow it
    steps = np.array([-1.0, 0.0, 1.0, 1.5, 2.0, 3.0])
    points = named.optimum * np.exp(steps[:, None] * along)
    # A rig has measured k_1 as well as the runs, three of these standard deviations higher: the mean is half way.
    own = -0.5 * ((np.log(points[:, at] / named.optimum[at]) - 3.0 * sd) / sd) ** 2
    assert steps[np.argmax(named(points) + own)] == 1.5
    assert steps[np.argmax(named(points))] == 0.0


def test_readings_of_named_values_are_those_of_the_records(fit: SyntheticFit) -> None:
    named = NamedDensity(fit.state, fit.result.histories)

    def squares(values: np.ndarray) -> float:
        runs = named.simulate(values)
        assert [run.file for run in runs] == [run.log.file for run in fit.campaign.bump_runs]
        off = [((run.measured - run.simulated) / run.noise_sd[:, None])[run.censored == 0] for run in runs]
        return float(np.nanmean(np.concatenate(off) ** 2))

    assert squares(named.optimum) == pytest.approx(1.0, abs=0.2)
    assert squares(named.values({"k_1": 1.5 * named.optimum[named.names.index("k_1")]})) > 1.5
    with pytest.raises(KeyError, match="k_77"):
        named.values({"k_77": 1.0})
