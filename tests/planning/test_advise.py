"""Further runs and sensors: predicted standard deviations against fits of the runs once they have been driven."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fit_states import state_at
from rigid_truck import (
    SENSORS,
    VEHICLE,
    bump,
    campaign,
    empty_run,
    true_log_parameters,
    with_values,
)
from synthetic_fit import NOISE, synthetic_fit

from sysid.campaign.records import PredictionRequest, Sensor
from sysid.campaign.vehicle_records import MassTolerances
from sysid.estimation.fit.least_squares import fit_bump_runs
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.parameters.estimate import ParameterEstimate
from sysid.estimation.parameters.map_tires import map_tires
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs
from sysid.estimation.uncertainty.data_information import DataInformation
from sysid.estimation.uncertainty.identifiability import Identifiability, assess
from sysid.planning.advice_records import Advice
from sysid.planning.candidate_runs import RunKind, missing_sensors, recording_sensors, run_information
from sysid.planning.ranking import advise, candidate_runs, peak_gradient
from sysid.prediction.driven_range import driven_range
from sysid.prediction.predict_passes import effective_roads, predict, predict_pass

PROFILES = {"bump": bump()}


def unflattened(information: DataInformation) -> DataInformation:
    """The same information without allowance for model error: there is none, and few blocks estimate it badly.

    Neither with that for footprint maps that follow their tires, which the further run changes.
    """
    return replace(information, flattening=np.eye(information.prior.shape[0]))


def test_predicted_standard_deviations_are_those_of_a_fit_with_the_run_driven():
    fit = synthetic_fit()
    speed = 16.0 / 3.6
    sensors = recording_sensors(fit.state)
    (further,) = run_information(fit.state, [RunKind("empty", "bump", speed)], sensors)
    information = fit.result.identifiability.information
    predicted, bare = (
        np.sqrt(np.diag(i.covariance(further.of(sensors)))) for i in (information, unflattened(information))
    )

    run = empty_run("third.csv", speed, samples=1090)
    tires = map_tires(fit.parameters, fit.truth)
    model = bump_model(replace(fit.campaign, bump_runs=(run,)), fit.parameters, fit.profiles, tires=tires)
    (signals,) = simulate_runs(model, fit.truth, RunMotion.steady(np.array([4.4]), np.array([0.95])))
    scale = np.array([NOISE[s.kind] for s in SENSORS])
    run = with_values(run, signals[:, 0] + scale * np.random.default_rng(1).normal(size=signals[:, 0].shape))
    grown = replace(fit.campaign, bump_runs=(*fit.campaign.bump_runs, run))
    result, _ = fit_bump_runs(grown, fit.parameters, fit.profiles, FitOptions(weight_rounds=1, second_solver=False))

    # Departures as large as the two runs say: the third would say it a little differently.
    grown_up = replace(unflattened(result.identifiability.information), sd=information.sd)
    found = np.sqrt(np.diag(grown_up.covariance()))
    np.testing.assert_allclose(bare, found, rtol=0.05)
    # With the allowance for model error, which both estimate from a handful of blocks: it scatters by a fifth.
    np.testing.assert_allclose(predicted, np.sqrt(np.diag(result.covariance)), rtol=0.3)
    # The run is worth something: by up to half of the standard deviation, where the test above allows a twentieth.
    now = np.sqrt(np.diag(unflattened(information).covariance()))
    assert (now / bare).max() > 1.4
    assert (now > bare).all()


def at_truth(columns: tuple[str, ...], noise: float, tolerances: MassTolerances | None = None):
    """A campaign of one run at 6 m/s by some sensors, and its fit had it ended at the truth; `noise` times that of
    ordinary sensors.
    """
    sensors = [s for s in SENSORS if s.column in columns]
    vehicle = VEHICLE if tolerances is None else replace(VEHICLE, tolerances=tolerances)
    run = empty_run("run.csv", 6.0, samples=360, sensors=sensors)
    data = campaign([run], predictions=[PredictionRequest("empty", 10.0)], vehicle=vehicle)
    parameters = campaign_parameters(data, None)
    model = bump_model(data, parameters, PROFILES)
    scale = noise * np.array([[NOISE[s.kind] for s in model.layout.sensors]])
    weights = Weights((scale,), (np.ones_like(scale),))
    x = true_log_parameters(parameters.names)
    state = state_at(data, model, x, RunMotion.steady(np.array([6.0]), np.array([0.5])), weights)
    kind = RunKind("empty", "bump", 6.0)
    (own,) = run_information(state, [kind], sensors)
    rows, _ = parameters.prior_rows()
    tolerances = state.allowances.masses.sd
    # Tires as modelled: no departures.
    sd = np.concatenate([tolerances, np.zeros(state.allowances.count - tolerances.size)])
    information = DataInformation(own.of(sensors), np.eye(x.size), rows.T @ rows, sd, tolerances.size)
    covariance = information.covariance()
    relative = np.sqrt(np.diag(covariance))
    estimates = [
        ParameterEstimate(p.name, p.quantity, p.unit, p.axle, None, None, "linear", "log", v, v * r, v, p.prior_median,
                          p.prior_sd, r < 0.7 * p.prior_sd)
        for p, v, r in zip(parameters.parameters, np.exp(x), relative, strict=True)
    ]  # fmt: skip
    return state, assess(estimates, covariance, information)


LVDTS = tuple(s.column for s in SENSORS if s.kind == "suspension_deflection")
WITHOUT_2 = tuple(c for c in LVDTS if c != "axle2_lvdt")


def advised(noise: float, **more) -> tuple[Identifiability, Advice]:
    """What is known without the deflection sensor of axle 2, and the advice."""
    state, found = at_truth(WITHOUT_2, noise, **more)
    return found, advise(state, found, speeds_km_h=(24.0,))


def test_without_the_deflection_sensor_of_an_axle_its_parameters_are_named():
    """Poor sensors, so that they do not tell everything from the motion of the other axles."""
    _, every = at_truth(LVDTS, 60.0)
    left, advice = advised(60.0)
    loss = dict(zip(left.names, left.sd / every.sd, strict=True))
    suspensions = sorted((n for n in loss if n[0] in "kc" and n[1] == "_"), key=lambda n: -loss[n])
    assert set(suspensions[:2]) == {"k_2", "c_2"}
    (rough,) = [s for s in left.statements if s.startswith("Known only roughly")]
    assert "k_2" in rough
    assert "c_2" in rough
    assert advice.worst(advice.now)[0] == "c_2"
    assert advice.statements[0].startswith("Of k and c, c_2 is known least well")
    # The missing sensor is among the candidates, and it brings back more than the run alone does.
    lvdt = next(p for p in advice.sensors if p.sensor == "LVDT at axle 2")
    (same,) = advice.runs
    at = [left.names.index(n) for n in ("k_2", "c_2")]
    assert (lvdt.sd[at] < 0.95 * same.sd[at]).all()
    assert len(advice.summary()) == 1 + len(advice.runs) + len(advice.sensors)
    assert any("c_2" in s and "add an" in s and "drive" in s for s in advice.statements)


def test_what_is_left_open_gets_a_remedy():
    """With even poorer sensors damping at axle 2 stays as the prior has it."""
    left, advice = advised(500.0)
    open_ = {name for g in left.groups for name in g.names}
    assert "c_2" in open_
    remedies = [s for s in advice.statements if "now known to" in s]
    assert any("c_2" in s and "add an" in s and "drive" in s for s in remedies), advice.statements


def test_wrong_masses_are_named_where_they_limit():
    _, advice = advised(0.1, tolerances=MassTolerances())
    (sentence,) = [s for s in advice.statements if "Most of it comes from the tolerances of the declared masses" in s]
    assert "exact" in sentence
    # Every property alone helps, and none more than all together.
    assert [p.exact != "" for p in advice.masses] == [True] * 3
    assert all((p.sd <= advice.now.sd * (1.0 + 1e-9)).all() for p in advice.masses)
    assert advice.masses[0].exact in sentence
    assert advice.summary()["exact"].iloc[-3] == advice.masses[0].exact


def test_sensors_that_are_missing():
    data = campaign([empty_run("run.csv", 6.0)])
    # The body has accelerometers at 0 and 5.0 m: 5.55 m is further than half a metre away, and so is 4.2 m.
    assert [s.column for s in missing_sensors(data, SENSORS)] == [
        "accelerometer on the frame above axle 2",
        "accelerometer on the frame above axle 3",
    ]
    near = (*SENSORS, Sensor("here", "body_acceleration", "g", body=0, x_m=5.2))
    assert [s.column for s in missing_sensors(data, near)] == ["accelerometer on the frame above axle 2"]
    bare = missing_sensors(data, [s for s in SENSORS if s.column != "axle2_lvdt"])
    assert bare[0] == Sensor("LVDT at axle 2", "suspension_deflection", "mm", axle=1)


def test_candidates_are_every_speed_in_every_load_case_in_use():
    kinds = candidate_runs(synthetic_fit().campaign, (8.0, 16.0))
    assert kinds == (RunKind("empty", "bump", 8.0 / 3.6), RunKind("empty", "bump", 16.0 / 3.6))


def with_other_masses(state):
    """As if the fit had found all masses and departures 3 % above the declared ones."""
    response = state.point.mass_response
    moved = replace(response, amounts=response.amounts + 0.03)
    return replace(state, point=replace(state.point, mass_response=moved))


def test_gradient_of_a_peak_is_that_of_predicted_passes():
    fit = synthetic_fit()
    request, state = fit.campaign.predictions[0], with_other_masses(fit.state)
    target, gradient = peak_gradient(state, request)
    direction = np.random.default_rng(4).normal(size=gradient.size)
    driven = driven_range(state)

    def ratio(along: float) -> float:
        x = state.point.log_parameters + along * direction
        moved = replace(state, point=replace(state.point, log_parameters=x))
        (found,) = predict(moved, None, [request], sweep_km_h=(), driven=driven).passes
        return float(found.peak_ratio_q50[target.axle])

    slope = (ratio(2e-3) - ratio(-2e-3)) / 4e-3
    assert slope == pytest.approx(gradient @ direction, rel=0.02)
    assert target.ratio == pytest.approx(ratio(0.0), rel=1e-9)
    # The declared vehicle has another peak.
    roads = effective_roads(state, [request])
    bare = predict_pass(fit.campaign, fit.parameters, roads, request, state.point.log_parameters[None])
    assert abs(bare.peak_ratio_q50[target.axle] / target.ratio - 1.0) > 1e-3


def test_the_peak_that_advice_names_is_the_one_of_the_predicted_pass():
    """To the digits of the sentence and beyond, with the bands of draws as at the optimum."""
    fit = synthetic_fit()
    state = with_other_masses(fit.state)
    draws = np.random.default_rng(2).multivariate_normal(state.point.log_parameters, fit.result.covariance, 40)
    for some in (None, draws):
        predictions = predict(state, some, fit.campaign.predictions, sweep_km_h=())
        given = None if some is None else predictions
        advice = advise(state, fit.result.identifiability, speeds_km_h=(24.0,), predictions=given)
        ratios = predictions.passes[0].peak_ratio_q50
        assert advice.peak.ratio == pytest.approx(ratios.max(), rel=1e-9)
        assert advice.peak.axle == np.argmax(ratios)
        assert any(f" is {ratios.max():.2f} with a standard deviation" in s for s in advice.statements)
