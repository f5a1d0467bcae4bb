"""Gradients of misfits, back in time, against forward derivatives and the reference engine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import rigid_truck
from every_element import campaign_with_every_element
from fit_states import state_at
from native_engine import needs_native
from rigid_truck import bump, campaign, empty_run

from sysid.campaign.records import Campaign
from sysid.errors import SysidError
from sysid.estimation.fit.state import FitState
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.linearisation import linearise_one
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.set_misfits import GroupInputs, group_misfit_gradients
from sysid.estimation.residuals.signals import simulate_runs
from sysid.posterior.log_density import LogDensity
from sysid.vehicle_model.native import kernel
from sysid.vehicle_model.native.buffers import GRADIENT
from sysid.vehicle_model.native.build import BuildError

pytestmark = needs_native


@pytest.fixture(autouse=True)
def native(monkeypatch):
    monkeypatch.setenv("SYSID_ENGINE", "native")


def state_of(data: Campaign) -> FitState:
    """A fit of signals that another parameter set has made, with a clipped channel, a gap and one without readings."""
    model = bump_model(data, campaign_parameters(data, None), {"bump": bump(0.08)})
    runs, random = len(data.bump_runs), np.random.default_rng(3)
    motion = RunMotion(7.1 + np.arange(runs), np.full(runs, 0.35), np.linspace(0.2, -0.3, runs))
    x = model.parameters.start
    arrays, scales, tempering = [], [], []
    for position, y in enumerate(simulate_runs(model, x + 0.05, motion)):
        value, measured, censored = y.copy(), np.ones_like(y), np.zeros_like(y)
        limit = 0.6 * np.abs(y[:, 0, 3]).max()
        censored[:, 0, 3] = np.sign(y[:, 0, 3]) * (np.abs(y[:, 0, 3]) > limit)
        value[:, 0, 3] = np.clip(y[:, 0, 3], -limit, limit)
        measured[:, 0, 3] -= np.abs(censored[:, 0, 3])
        measured[100:120, -1, 5] = measured[:, -1, 1] = 0.0
        noise = 0.1 * y.std(axis=0)
        noise[-1, 1] = np.inf
        own = model.arrays[position]._replace(value=value * (measured + np.abs(censored)), measured=measured)
        arrays.append(own._replace(censored=censored))
        scales.append(noise)
        tempering.append(0.3 + 0.7 * random.random(noise.shape))
    weights = Weights(tuple(scales), tuple(tempering))
    return state_at(data, replace(model, arrays=tuple(arrays)), x, motion, weights)


def forward(state: FitState, inputs: GroupInputs, position: int, x: np.ndarray) -> np.ndarray:
    """The gradient 2 (J' r - J' J_eta N^-1 b) from the residuals' forward derivatives."""
    lin = linearise_one(state.model, state.point.weights, x, state.point.motion, position)
    residual, gain = np.asarray(lin.residual), np.asarray(lin.gain_residual)
    columns, gain_columns = (np.asarray(v)[..., : x.size] for v in (lin.residual_jacobian, lin.gain_jacobian))
    local = inputs.local
    b = np.einsum("trck,trc->rk", local.residual, residual) + np.einsum("rck,rc->rk", local.gain, gain) + local.offset
    share = np.einsum("rlj,rlk,rk->rj", local.factor, local.factor, b)
    pull = residual - np.einsum("trck,rk->trc", local.residual, share)
    gain_pull = gain - np.einsum("rck,rk->rc", local.gain, share)
    return 2.0 * (np.tensordot(pull, columns, axes=3) + np.tensordot(gain_pull, gain_columns, axes=2))


def assert_is_forward(state: FitState, sets: np.ndarray) -> None:
    """Of one set at a time, whose runs share packs, and of all together, which share packs of their own."""
    density = LogDensity(state)
    for position, inputs in enumerate(density._inputs):
        shape = state.model.shapes[position]
        expected = np.stack([forward(state, inputs, position, x) for x in sets.T], axis=1)
        together = np.asarray(group_misfit_gradients(inputs, sets, shape=shape)[1])
        alone = np.concatenate(
            [np.asarray(group_misfit_gradients(inputs, x[:, None], shape=shape)[1]) for x in sets.T], axis=1
        )
        # Parts of a gradient that cancel have larger rounding errors.
        size = np.abs(expected).max(axis=1, keepdims=True) + 1e-6 * np.abs(expected).max()
        assert (np.abs(together - expected) <= 2e-12 * size).all()
        assert (np.abs(alone - together) <= 2e-12 * size).all()
        assert (expected != 0.0).any(axis=1).all()


@pytest.mark.parametrize(("joined", "filtered"), [("beam", True), ("equaliser and bending frame", False)])
def test_gradient_with_every_element_of_suspension_laws(joined, filtered):
    data = campaign_with_every_element(joined, runs=3, antialias=rigid_truck.FILTER if filtered else None)
    state = state_of(data)
    random = np.random.default_rng(5)
    x = state.point.log_parameters
    assert_is_forward(state, x[:, None] + 0.03 * random.normal(size=(x.size, 3)))


@pytest.fixture(scope="module")
def plain() -> FitState:
    """Three linear runs in two load cases, two of one length; the bump throws wheels into the air."""
    runs = [
        empty_run("a.csv", 6.0, samples=240),
        empty_run("b.csv", 8.5, load_case="laden", samples=260),
        empty_run("c.csv", 7.0, samples=240),
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SYSID_ENGINE", "native")
        return state_of(campaign(runs, load_cases=(rigid_truck.EMPTY, rigid_truck.LADEN)))


def points_near(state: FitState, count: int) -> np.ndarray:
    x = state.point.log_parameters
    return x + 0.03 * np.random.default_rng(11).normal(size=(count, x.size))


def test_gradient_of_linear_laws(plain):
    assert_is_forward(plain, points_near(plain, 9).T)


def test_both_engines_give_one_gradient(plain, monkeypatch):
    points, found = points_near(plain, 3), []
    for name in ("native", "reference"):
        monkeypatch.setenv("SYSID_ENGINE", name)
        found.append(LogDensity(plain).gradients(points))
    (ours, slopes), (theirs, expected) = found
    np.testing.assert_allclose(ours, theirs, rtol=2e-13)
    np.testing.assert_allclose(slopes, expected, rtol=1e-11, atol=2e-12 * np.abs(expected).max())


def test_densities_beside_gradients_are_those_of_the_likelihood(plain):
    """To rounding, for they come from another program, and rejected where they are."""
    points = points_near(plain, 10)
    points[4, 0] = 800.0
    density = LogDensity(plain)
    values, slopes = density.gradients(points)
    np.testing.assert_allclose(values, density(points), rtol=1e-13)
    assert np.isneginf(values[4])
    assert np.isfinite(np.delete(slopes, 4, axis=0)).all()


def test_without_the_program_a_sentence_says_what_to_do(plain, monkeypatch):
    load = kernel._loaded

    def only_engine(coordinates, program):
        if program == GRADIENT:
            raise BuildError("no C++ compiler was found")
        return load(coordinates, program)

    density = LogDensity(plain)
    monkeypatch.setattr(kernel, "_loaded", only_engine)
    with pytest.raises(SysidError, match=r"no C\+\+ compiler was found. Install .* SYSID_ENGINE=reference"):
        density.gradients(points_near(plain, 1))
