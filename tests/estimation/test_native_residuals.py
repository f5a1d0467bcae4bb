"""Misfits and linearisations by the native engine against the reference engine, with clipped and missing readings."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rigid_truck
from every_element import campaign_with_every_element
from fit_states import state_at
from native_engine import needs_native
from rigid_truck import bump, campaign, empty_run, true_log_parameters

from sysid.campaign.records import Campaign
from sysid.estimation.fit.state import FitState
from sysid.estimation.parameters.axle_laws import LawInputs, axle_laws, laws_side_by_side
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.parameters.suspension_elements import ELEMENTS, law_elements
from sysid.estimation.residuals.bump_model import BumpModel, bump_model
from sysid.estimation.residuals.linearisation import linearise, linearise_group
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs
from sysid.posterior.log_density import LogDensity
from sysid.vehicle_model.engines.protocol import Linearisation

pytestmark = needs_native

#: One run brakes, the other gathers speed.
MOTION = RunMotion(np.array([6.1, 8.3]), np.array([0.44, 0.61]), np.array([-0.05, 0.03]))


@pytest.fixture
def native(monkeypatch):
    monkeypatch.setenv("SYSID_ENGINE", "native")


@pytest.fixture(scope="module")
def made() -> tuple[Campaign, FitState]:
    """Two runs in two load cases near their own optimum: a clipped channel, a gap, a channel without readings."""
    runs = [empty_run("a.csv", 6.0, samples=300), empty_run("b.csv", 8.5, load_case="laden", samples=280)]
    data = campaign(runs, load_cases=(rigid_truck.EMPTY, rigid_truck.LADEN))
    model = bump_model(data, campaign_parameters(data, None), {"bump": bump()})
    truth = true_log_parameters(model.parameters.names)
    random = np.random.default_rng(7)
    (y,) = simulate_runs(model, truth, MOTION)
    value = y * (1 + 0.004 * random.normal(size=y.shape[1:])) + 0.02 * y.std(axis=0) * random.normal(size=y.shape)
    measured, censored = np.ones_like(y), np.zeros_like(y)
    value[:, 0, 3] *= 1.2  # so that the simulation stays inside the range at some of the clipped samples
    limit = 0.6 * np.abs(y[:, 0, 3]).max()
    censored[:, 0, 3] = np.sign(value[:, 0, 3]) * (np.abs(value[:, 0, 3]) > limit)
    value[:, 0, 3] = np.clip(value[:, 0, 3], -limit, limit)
    measured[:, 0, 3] -= np.abs(censored[:, 0, 3])
    measured[100:140, 1, 5] = 0.0
    measured[280:, model.groups[0].runs.index(1)] = 0.0
    measured[:, 1, 7] = 0.0
    value *= measured + np.abs(censored)
    noise = 0.05 * y.std(axis=0)
    noise[1, 7] = np.inf
    arrays = model.arrays[0]._replace(value=value, measured=measured, censored=censored)
    model = replace(model, arrays=(arrays,))
    weights = Weights((noise,), (0.3 + 0.7 * random.random(noise.shape),))
    assert (censored == 1).any()
    assert (censored == -1).any()
    return data, state_at(data, model, truth, MOTION, weights)


def linearised(state: FitState, x: np.ndarray) -> Linearisation:
    (found,) = linearise(state.model, state.point.weights, x, state.point.motion)
    return Linearisation(*(np.asarray(v) for v in found))


@pytest.fixture(scope="module")
def linearisations(made) -> list[Linearisation]:
    """By the native and by the reference engine, a little off the truth."""
    state = made[1]
    found = []
    with pytest.MonkeyPatch.context() as patch:
        for name in ("native", "reference"):
            patch.setenv("SYSID_ENGINE", name)
            found.append(linearised(state, state.point.log_parameters + 0.05))
    return found


@pytest.mark.parametrize("field", Linearisation._fields)
def test_linearisation(linearisations, field):
    ours, theirs = (getattr(x, field) for x in linearisations)
    assert ours.shape == theirs.shape
    over_time = () if field.startswith("gain") else (0,)
    size = np.abs(theirs).max(axis=over_time, keepdims=True) if over_time else np.abs(theirs).max()
    tolerance = 1e-10 if field.endswith("jacobian") else 1e-12
    # A parameter of another load case, or a channel without readings, moves nothing: exactly zero in both.
    assert (np.abs(ours - theirs) <= tolerance * size).all()


@pytest.mark.parametrize(
    # The last has the rocker too, and every case takes half a minute, beams have tests of their own.
    "joined",
    [
        pytest.param("beam", marks=pytest.mark.long),
        pytest.param("equaliser", marks=pytest.mark.long),
        "equaliser and bending frame",
    ],
)
def test_linearisation_with_every_element_of_suspension_laws(monkeypatch, joined):
    data = campaign_with_every_element(joined)
    model = bump_model(data, campaign_parameters(data, None), {"bump": bump()})
    x = model.parameters.start
    assert_laws_by_numpy_are_those_by_jax(model.arrays[0].laws, np.stack([x, x + 0.02, x - 0.3], axis=1))
    motion, found = RunMotion.steady(np.array([7.1]), np.array([0.35])), []
    for name in ("native", "reference"):
        monkeypatch.setenv("SYSID_ENGINE", name)
        (signals,) = simulate_runs(model, x + 0.02, motion)
        arrays = model.arrays[0]._replace(value=signals)
        weights = Weights((0.1 * signals.std(axis=0),), (np.ones(signals.shape[1:]),))
        (one,) = linearise(replace(model, arrays=(arrays,)), weights, x, motion)
        found.append([signals, *(np.asarray(v) for v in one)])
    for ours, theirs in zip(*found, strict=True):
        # Of gains there is one per channel, in place of samples: that of a channel may be next to nothing.
        size = np.abs(theirs).max(axis=0 if len(theirs) > 1 else (0, 1), keepdims=True)
        assert (np.abs(ours - theirs) <= 1e-10 * np.maximum(size, 1e-9 * size.max())).all()
    jacobian = found[1][2]
    used = np.abs(jacobian).max(axis=(0, 1, 2)) > 0.0
    assert used.all(), [n for n, u in zip(model.parameters.names, used, strict=False) if not u]


def test_derivatives_over_a_road_with_edges(made, monkeypatch):
    """By both engines, and as differences along a direction in which everything moves."""
    data, state = made
    model = replace(state.model, roads=tuple(replace(road, edged=True) for road in state.model.roads))
    edged = state_at(data, model, state.point.log_parameters, state.point.motion, state.point.weights)
    x, found = state.point.log_parameters + 0.05, []
    for name in ("reference", "native"):
        monkeypatch.setenv("SYSID_ENGINE", name)
        found.append(linearised(edged, x))
    for theirs, ours in zip(*found, strict=True):
        assert (np.abs(ours - theirs) <= 1e-10 * np.abs(theirs).max()).all()
    way, step = np.random.default_rng(3).normal(size=x.size), 1e-5
    ahead, behind = (linearised(edged, x + sign * step * way).residual for sign in (1.0, -1.0))
    slope = found[1].residual_jacobian[..., : x.size] @ way
    by_difference = (ahead - behind) / (2.0 * step)
    assert np.sqrt(np.mean((slope - by_difference) ** 2)) < 5e-5 * np.sqrt(np.mean(slope**2))
    smooth = linearised(state, x).residual_jacobian[..., : x.size] @ way
    assert np.sqrt(np.mean((smooth - by_difference) ** 2)) > 1e-4 * np.sqrt(np.mean(slope**2))


def test_every_element_of_campaign_files_is_in_that_comparison():
    """A bilinear damper is part of the asymmetric one; stops of unknown travel have the test below."""
    laws = (law_elements(axle.suspension_law) for axle in campaign_with_every_element("beam").vehicle.axles)
    assert set(ELEMENTS) - frozenset().union(*laws) == {"bilinear_damper", "estimated_bump_stops"}


def assert_laws_by_numpy_are_those_by_jax(inputs: LawInputs, sets: np.ndarray) -> None:
    ours, theirs = axle_laws(inputs, sets), axle_laws(inputs, jnp.asarray(sets))
    assert jax.tree.structure(ours) == jax.tree.structure(theirs)
    for mine, other in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        assert not isinstance(mine, jax.Array)
        np.testing.assert_allclose(mine, other, rtol=1e-15)
    # One set at a time, and side by side as passes.
    alone = laws_side_by_side([inputs] * 3, list(sets.T[:, :, None]))
    for mine, other in zip(jax.tree.leaves(alone), jax.tree.leaves(ours), strict=True):
        if np.ndim(other) > 2:
            whole = np.broadcast_to(other, (*np.shape(other)[:-1], 3))
            np.testing.assert_array_equal(mine[..., 0], np.concatenate(np.moveaxis(whole, -1, 0), axis=-2))


def test_derivatives_by_travels_to_the_stops_are_differences(native):
    """Both stops of every axle are reached."""
    law = "friction + estimated_bump_stops"
    vehicle = replace(rigid_truck.VEHICLE, axles=tuple(replace(a, suspension_law=law) for a in rigid_truck.AXLES))
    data = campaign([empty_run("a.csv", 7.0, samples=260)], vehicle=vehicle)
    model = bump_model(data, campaign_parameters(data, None), {"bump": bump()})
    names = list(model.parameters.names)
    x = model.parameters.start.copy()
    travels = [i for i, n in enumerate(names) if n.startswith(("jounce", "rebound"))]
    assert len(travels) == 6
    x[travels] = np.log(0.012)
    motion = RunMotion.steady(np.array([7.1]), np.array([0.35]))
    (signals,) = simulate_runs(model, x + 0.02, motion)
    model = replace(model, arrays=(model.arrays[0]._replace(value=signals),))
    weights = Weights((0.1 * signals.std(axis=0),), (np.ones(signals.shape[1:]),))

    def residual(point: np.ndarray) -> np.ndarray:
        (one,) = linearise(model, weights, point, motion)
        return np.asarray(one.residual)[:, 0]

    (here,) = linearise(model, weights, x, motion)
    jacobian = np.asarray(here.residual_jacobian)[:, 0]
    for k in travels:
        step = 1e-5 * np.eye(x.size)[k]
        slope = (residual(x + step) - residual(x - step)) / 2e-5
        size = np.sqrt((slope**2).sum())
        assert size > 1.0
        assert np.sqrt(((jacobian[..., k] - slope) ** 2).sum()) < 1e-5 * size, names[k]


def test_clipped_samples_matter(linearisations, made):
    """Otherwise the comparison above would say nothing about them: some count and some do not."""
    censored = made[1].model.arrays[0].censored != 0
    counted = linearisations[1].residual[censored] != 0.0
    assert counted.any()
    assert not counted.all()


def test_many_parameters_need_several_passes(made, native):
    """Thirty-one columns a pass: doubling the parameter vector with unused ones changes nothing."""
    state = made[1]
    model: BumpModel = state.model
    x = np.concatenate([state.point.log_parameters, np.zeros(40)])
    wide = linearise_group(
        model.arrays[0],
        model.roads[0],
        state.point.weights.noise_sd[0],
        state.point.weights.tempering[0],
        jnp.asarray(x),
        MOTION.of(model.groups[0].runs),
        shape=model.shapes[0],
    )
    plain = linearised(state, state.point.log_parameters)
    count = state.point.log_parameters.size
    jacobian = np.asarray(wide.residual_jacobian)
    used = np.r_[0:count, x.size : x.size + 3]
    np.testing.assert_allclose(
        jacobian[..., used], plain.residual_jacobian, rtol=0, atol=1e-11 * np.abs(plain.residual_jacobian).max()
    )
    assert (np.delete(jacobian, used, axis=-1) == 0.0).all()


def test_log_density(made, monkeypatch):
    _, state = made
    points = state.point.log_parameters + 0.03 * np.random.default_rng(11).normal(
        size=(9, state.point.log_parameters.size)
    )
    found = {}
    for name in ("native", "reference"):
        monkeypatch.setenv("SYSID_ENGINE", name)
        found[name] = LogDensity(state)(points)
    assert np.ptp(found["reference"]) > 100.0
    np.testing.assert_allclose(found["native"], found["reference"], rtol=1e-12)


def test_the_density_of_a_point_does_not_depend_on_its_batch(made, native):
    _, state = made
    points = state.point.log_parameters + 0.03 * np.random.default_rng(12).normal(
        size=(10, state.point.log_parameters.size)
    )
    density = LogDensity(state)
    together = density(points)
    np.testing.assert_array_equal([density(p)[0] for p in points], together)


def test_infinite_and_undefined_points_are_rejected_alone(made, native):
    _, state = made
    points = np.tile(state.point.log_parameters, (10, 1))
    points[1, 0], points[4, 2] = 800.0, np.nan
    points[7, 0] += 14.0  # a spring far too stiff for the step
    density = LogDensity(state)
    found = density(points)
    np.testing.assert_array_equal(np.isneginf(found), np.isin(np.arange(10), [1, 4, 7]))
    assert np.unique(found[np.isfinite(found)]).size == 1
