"""Runs predicted without a fit to them: noise remains under the right model, more than in sample under a wrong one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fit_states import state_at
from rigid_truck import SENSORS, bump, campaign, empty_run, true_log_parameters, with_values
from synthetic_fit import NOISE

from sysid.errors import CampaignError
from sysid.estimation.fit.least_squares import fit_bump_runs
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.parameters.map_tires import map_tires
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs
from sysid.export.tables import validation_csv
from sysid.report.agreement import left_out_table
from sysid.validation import validate
from sysid.validation.channel_agreement import LeftOut, LeftOutRun
from sysid.validation.chosen_runs import chosen_runs
from sysid.validation.leave_out import by_another_truck, leave_out
from sysid.workflow import store

FILES = ("runs/slow.csv", "runs/middle.csv", "runs/fast.csv")
SPEED = np.array([5.6, 7.3, 9.1])
START = np.array([0.5, 0.44, 0.6])
PROFILES = {"bump": bump(height_m=0.04)}


def measured_campaign():
    """Three runs made with the model: noise, and an offset and a gain error of every channel."""
    runs = [empty_run(f, v * 1.01, samples=360) for f, v in zip(FILES, SPEED, strict=True)]
    blank = campaign(runs)
    parameters = campaign_parameters(blank, None)
    truth = true_log_parameters(parameters.names)
    model = bump_model(blank, parameters, PROFILES, tires=map_tires(parameters, truth))
    (signals,) = simulate_runs(model, truth, RunMotion.steady(SPEED, START))
    random = np.random.default_rng(11)
    scale = np.array([NOISE[s.kind] for s in SENSORS])
    filled = []
    for r, run in enumerate(runs):
        clean = signals[:, model.groups[0].runs.index(r)] * (1 + 0.003 * random.normal(size=8))
        values = clean + scale * (3.0 * random.normal(size=8) + random.normal(size=clean.shape))
        filled.append(with_values(run, values))
    return replace(blank, bump_runs=tuple(filled)), parameters


@pytest.fixture(scope="module", params=["footprint", "point"])
def fitted(request):
    data, parameters = measured_campaign()
    options = FitOptions(weight_rounds=1, second_solver=False, contact=request.param)
    return options, *fit_bump_runs(data, parameters, PROFILES, options)


@pytest.fixture(scope="module")
def left(fitted):
    options, fit, state = fitted
    found = tuple(leave_out(fit, state, FILES, options))
    return options.contact, fit, LeftOut(fit.names, found, validate(fit).channels)


def mean_square(rows, fit):
    """Mean square residual over the noise that was put in; what the result takes for noise is an estimate."""
    estimated = {(h.file, c): sd for h in fit.histories for c, sd in zip(h.columns, h.noise_before_sd, strict=True)}
    return float(
        np.mean([(row.residual_over_noise * estimated[row.run, row.column] / NOISE[row.kind]) ** 2 for row in rows])
    )


def test_out_of_sample_residuals(left):
    contact, fit, result = left
    within = mean_square(result.in_sample, fit)
    beyond = mean_square([c for run in result.runs for c in run.channels], fit)
    if contact == "footprint":
        # 24 histories of 360 samples: the mean square of the noise is known to about two per cent.
        assert within == pytest.approx(1.0, abs=0.05)
        assert beyond == pytest.approx(1.0, abs=0.05)
    else:
        # What this contact law lacks its departures make up for, nearly.
        assert within == pytest.approx(1.0, abs=0.1)
        assert beyond == pytest.approx(1.0, abs=0.1)
    assert beyond > within
    assert all(run.converged for run in result.runs)


def test_runs_driven_by_the_truck_of_another_fit(fitted):
    """The truck behind the records leaves noise; one whose damper is 30 % stronger, or with other loads, does not."""
    options, fit, state = fitted
    if options.contact == "point":
        return
    names = state.parameters.names
    truth = true_log_parameters(names)
    weights, motion = state.point.weights, state.point.motion
    tires = map_tires(state.parameters, truth)
    model = bump_model(state.campaign, state.parameters, PROFILES, tires=tires)

    def by(sets: np.ndarray) -> list:
        return by_another_truck(state_at(state.campaign, model, sets, motion, weights), fit, state)

    rows = by(truth)
    assert {row.run for row in rows} == set(FILES)
    assert all(row.out_of_sample for row in rows)
    assert mean_square(rows, fit) == pytest.approx(1.0, abs=0.05)
    other = truth + np.log(1.3) * np.array([name == "c_1" for name in names])
    assert mean_square(by(other), fit) > 1.3
    case = state.campaign.bump_runs[0].load_case
    heavier = replace(state.campaign.load_cases[case], axle_loads_kg=(9000.0, 9000.0))
    weighed = replace(state.campaign, load_cases={case: heavier})
    assert by_another_truck(state_at(weighed, model, truth, motion, weights), fit, state) == ()


def test_speed_and_start_are_the_runs_own(left):
    contact, _, result = left
    if contact == "footprint":
        np.testing.assert_allclose([run.speed_m_s for run in result.runs], SPEED, rtol=4e-3)
        np.testing.assert_allclose([run.start_s for run in result.runs], START, atol=4e-3)


def test_parameters_move_by_what_a_third_of_the_data_may_move_them(left):
    contact, fit, result = left
    for run in result.runs:
        values = np.array([p.value for p in fit.parameters])
        sd = np.sqrt(np.diag(fit.covariance))
        np.testing.assert_allclose(run.values, values * np.exp(run.shift_sd * sd), rtol=1e-6)
        assert np.abs(run.shift_sd).max() > 0.05
        if contact == "footprint":
            # Without one run of three the variance grows by about a half: a shift has a standard deviation of 0.7, and
            # parameters share most of it. 0.5, 0.9 and 1.5 were found.
            assert np.sqrt(np.mean(run.shift_sd**2)) < 1.6


def test_marked_in_table_csv_and_report(left):
    _, fit, result = left
    validation = replace(validate(fit), left_out=result)
    table = validation.summary()
    assert table["out_of_sample"].sum() == 24
    assert len(table) == 48
    assert len(validation.to_pandas()) == 48
    lines = validation_csv(validation).splitlines()
    place = lines[0].split(",").index("out_of_sample")
    assert [line.split(",")[place] for line in lines[1:]] == ["false"] * 24 + ["true"] * 24
    summary = result.summary()
    assert list(summary["run"]) == list(FILES)
    assert "out of sample" in str(left_out_table(result, {}))


def test_left_out_runs_are_kept_between_calls(left, tmp_path):
    _, _, result = left
    store.save(tmp_path / "left.npz", result.runs, "x", tuple[LeftOutRun, ...])
    back = store.load(tmp_path / "left.npz", "x", tuple[LeftOutRun, ...])
    assert back[2].channels == result.runs[2].channels
    np.testing.assert_array_equal(back[1].values, result.runs[1].values)


def test_runs_by_file_or_name():
    assert chosen_runs(FILES, ()) == FILES
    assert chosen_runs(FILES, ["fast", "runs/slow.csv", "fast.csv"]) == (FILES[2], FILES[0])
    with pytest.raises(CampaignError, match=r"none of the runs.*runs/middle\.csv"):
        chosen_runs(FILES, ["nothing"])
    with pytest.raises(CampaignError, match="several"):
        chosen_runs(("a/x.csv", "b/x.csv"), ["x"])
    with pytest.raises(CampaignError, match="fewer than two"):
        chosen_runs(("a.csv",), ["a"])
