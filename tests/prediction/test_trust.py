"""How far a pass goes beyond the driven runs: against the pass itself, and against histories written by hand."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from fit_states import state_at
from rigid_truck import DAMPING, EMPTY, EXPONENT, STIFFNESS, VEHICLE, bump, campaign, empty_run, true_log_parameters

from sysid.campaign.records import PredictionRequest
from sysid.estimation.fit.state import FitState
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.prediction.driven_range import driven_range, spring_deflection
from sysid.prediction.predict_passes import effective_roads, predict, predict_pass, speed_sweep
from sysid.prediction.predicted_passes import PassPrediction
from sysid.prediction.trust import DrivenRange, Extrapolation, Reached, beyond_driven, extrapolations
from sysid.vehicle_model.contact import tire_law

SPEED_M_S = 8.0
SAME, FAST = PredictionRequest("empty", SPEED_M_S), PredictionRequest("empty", 2.0 * SPEED_M_S)


@pytest.fixture(scope="module")
def state() -> FitState:
    """A fit that ended at the true values, of one long run whose speed is known."""
    data = campaign([empty_run("a.csv", SPEED_M_S)], predictions=[SAME])
    parameters = campaign_parameters(data, None)
    model = bump_model(data, parameters, {"bump": bump()}, target_step_s=0.001)
    scale = np.ones((1, len(model.layout.sensors)))
    motion = RunMotion.steady(np.array([SPEED_M_S]), np.array([0.5]))
    return state_at(data, model, true_log_parameters(parameters.names), motion, Weights((scale,), (scale,)))


@pytest.fixture(scope="module")
def driven(state) -> DrivenRange:
    return driven_range(state)


@pytest.fixture(scope="module")
def passes(state, driven) -> tuple[PassPrediction, PassPrediction]:
    """A pass like the driven run, and one at twice its speed."""
    same, fast = predict(state, None, (SAME, FAST), sweep_km_h=(), driven=driven).passes
    return same, fast


def sunk(p: PassPrediction) -> np.ndarray:
    """Largest deflection of every tire by its law, F_ref (u / u_ref)^n with the tangent k_t = n F_ref / u_ref."""
    stiffness = np.array([a.tire_stiffness_N_per_m for a in VEHICLE.axles])
    return EXPONENT * p.static_load_N / stiffness * (p.tire_force_q50_N.max(axis=1) / p.static_load_N) ** (1 / EXPONENT)


def damper_speed(p: PassPrediction) -> np.ndarray:
    """Largest rate from the force alone: k e + c de/dt = F_0 - F, solved exactly for a force linear over each ms."""
    pull = p.suspension_force_N.q50[:, :1] - p.suspension_force_N.q50
    decay = np.exp(-STIFFNESS / DAMPING * 1e-3)
    extension = np.zeros_like(pull)
    for i in range(1, pull.shape[1]):
        middle = 0.5 * (pull[:, i - 1] + pull[:, i]) / STIFFNESS
        extension[:, i] = decay * extension[:, i - 1] + (1.0 - decay) * middle
    return np.abs((pull - STIFFNESS[:, None] * extension) / DAMPING[:, None]).max(axis=1)


def test_a_driven_run_predicted_again_reaches_what_it_reached(driven, passes):
    same, _ = passes
    assert same.trust == ()
    assert not same.beyond.any()
    assert driven.speed_m_s == {"empty": SPEED_M_S}
    np.testing.assert_allclose(driven.jounce_m, same.jounce_m.q50, rtol=0.01)
    np.testing.assert_allclose(driven.rebound_m, same.rebound_m.q50, rtol=0.01)
    np.testing.assert_allclose(driven.tire_deflection_m, sunk(same), rtol=0.01)
    np.testing.assert_allclose(driven.damper_speed_m_s, damper_speed(same), rtol=0.01)


def test_a_faster_pass_is_compared_axle_by_axle(driven, passes):
    _, fast = passes
    named = {(e.what, e.axle): e for e in fast.trust}
    for axle in range(3):
        assert (named["speed", axle].reached, named["speed", axle].driven) == (2.0 * SPEED_M_S, SPEED_M_S)
        larger = sunk(fast)[axle]
        assert (("tire_deflection", axle) in named) == (larger > 1.05 * driven.tire_deflection_m[axle])
        if ("tire_deflection", axle) in named:
            assert named["tire_deflection", axle].reached == pytest.approx(larger, rel=1e-9)
    assert len(fast.warnings) > 1
    # Where a tire alone exceeds the driven deflection its axle is marked at that instant.
    for axle in {e.axle for e in fast.trust if e.what == "tire_deflection"}:
        peak = int(np.argmax(fast.tire_force_q50_N[axle]))
        assert fast.beyond[axle, peak]
        assert not fast.beyond[axle, :300].any()


def test_the_ratio_against_speed_is_marked_like_the_passes(state, driven, passes):
    roads = effective_roads(state, (SAME,))
    sets = state.point.log_parameters[:, None]
    speeds = [SPEED_M_S, 2.0 * SPEED_M_S]
    found = speed_sweep(state.campaign, state.parameters, "empty", "bump", roads, sets, speeds, driven=driven)
    expected = [[any(e.axle == i and e.what != "speed" for e in p.trust) for i in range(3)] for p in passes]
    assert found.beyond.tolist() == expected
    assert any(expected[1])
    assert speed_sweep(state.campaign, state.parameters, "empty", "bump", roads, sets, speeds[:1]).beyond is None


def test_without_driven_runs_nothing_is_said(state):
    found = predict_pass(
        state.campaign, state.parameters, effective_roads(state, (SAME,)), SAME, state.point.log_parameters[None]
    )
    assert (found.trust, found.beyond) == ((), None)


FAR = DrivenRange({"empty": 5.0}, *(np.array(v) for v in ([0.04], [0.05], [0.02], [1.0], [0.0])))
NEAR = Reached(5.0, *(np.array(v) for v in ([0.04], [0.05], [0.02], [1.0], [0.0])))


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, None),
        ({"speed_m_s": 5.2}, None),
        ({"speed_m_s": 5.3}, ("speed", 5.3, 5.0)),
        ({"tire_deflection_m": np.array([0.043])}, ("tire_deflection", 0.043, 0.04)),
        ({"jounce_m": np.array([0.06])}, ("travel", 0.06, 0.05)),
        # Twice the driven rebound is worse than a fifth more jounce.
        ({"jounce_m": np.array([0.06]), "rebound_m": np.array([0.04])}, ("travel", 0.04, 0.02)),
        ({"damper_speed_m_s": np.array([1.1])}, ("damper_speed", 1.1, 1.0)),
        ({"lift_off_s": np.array([0.003])}, ("lift_off", 0.003, 0.0)),
    ],
)
def test_each_quantity_is_named_with_what_was_reached_and_driven(changes, expected):
    found = extrapolations(replace(NEAR, **changes), FAR, "empty")
    assert found == (() if expected is None else (Extrapolation(expected[0], 0, *expected[1:]),))


def test_a_wheel_that_lifted_in_a_run_may_lift_again():
    lifted = replace(FAR, lift_off_s=np.array([0.002]))
    assert extrapolations(replace(NEAR, lift_off_s=np.array([0.1])), lifted, "empty") == ()


def test_a_load_case_nobody_drove_is_beyond_at_any_speed():
    (found,) = extrapolations(NEAR, FAR, "laden")
    assert (found.what, found.driven) == ("speed", 0.0)


def test_instants_beyond_are_those_of_half_of_the_draws():
    """One axle, four instants, two draws: nothing, tire in one draw, in both, damper in one and travel in the other."""
    sunk = np.array([[0.04, 0.04], [0.05, 0.03], [0.05, 0.05], [0.0, 0.0]])[:, None, :]
    extension = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.03, 0.0]])[:, None, :]
    rate = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, -1.2]])[:, None, :]
    force = np.ones_like(sunk)
    assert beyond_driven(FAR, sunk, extension, rate, force).tolist() == [[False, True, True, True]]
    force[0] = 0.0
    assert beyond_driven(FAR, sunk, extension, rate, force)[0, 0]
    never = np.concatenate([sunk, np.zeros((4, 1, 1))], axis=2)
    same = (np.concatenate([a, np.zeros((4, 1, 1))], axis=2) for a in (extension, rate))
    # One draw of three is not half of them.
    assert not beyond_driven(FAR, never, *same, np.ones_like(never))[0, 1]


def test_deflection_of_the_spring_inverts_the_tire_law():
    load = jnp.array(EMPTY.axle_loads_kg)[None, :, None] * 9.81
    law = tire_law(jnp.full((1, 3, 1), 1.5e6), jnp.zeros((1, 3, 1)), jnp.array([1.3]), 1.4 * load, load)
    found = np.asarray(spring_deflection(law, 1.4 * load))
    np.testing.assert_allclose(found, law.static_deflection, rtol=1e-12)
    # u_ref = n F_ref / k_t, by hand.
    reference = 1.3 * EMPTY.axle_loads_kg[0] * 9.81 / 1.5e6
    assert float(np.asarray(spring_deflection(law, 2.0 * load))[0, 0, 0]) == pytest.approx(reference * 2 ** (1 / 1.3))
