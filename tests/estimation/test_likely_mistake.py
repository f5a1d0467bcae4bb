"""One mistake in a campaign is named after the fit; a truck that is unlike its model is not accused of one."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from rigid_truck import AXLES, DAMPING, EMPTY, LADEN, STIFFNESS, VEHICLE, bump, campaign, empty_run, with_values

from sysid.campaign.records import Campaign, Channel
from sysid.estimation.fit.causes import Cause
from sysid.estimation.fit.law_choice import fit_with_laws
from sysid.estimation.fit.least_squares import optimise
from sysid.estimation.fit.likely_mistake import NAMED_SHARE, MistakeScore, likely_mistake, mistake_scores, named_mistake
from sysid.estimation.fit.mistake_candidates import MistakeCandidate
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs
from sysid.progress import unwatched
from sysid.road.contact_laws import ContactLaw

SPEED_M_S, START_S = np.array([6.07, 8.39, 6.02]), np.array([0.44, 0.61, 0.5])
PROFILES = {"bump": bump()}
OPTIONS = FitOptions(weight_rounds=1, second_solver=False, laws="declared")
SAMPLES, STEP_S = 340, 0.005


@lru_cache
def measured(friction: float = 0.0, contact: ContactLaw = "footprint", lag: tuple[str, float] = ("", 0.0)) -> Campaign:
    """A campaign of linear laws, its readings from a truck that may rub or roll otherwise; one sensor may lag.

    The lag is made by shifting the start of the run that this sensor sees, not by moving its samples.
    """
    linear = tuple(replace(a, suspension_law="linear", load_dependent=False) for a in AXLES)
    rubbing = tuple(replace(a, suspension_law="friction" if friction else "linear") for a in linear)
    runs = [empty_run("slow.csv", 6.0, samples=SAMPLES), empty_run("fast.csv", 8.5, samples=SAMPLES),
            empty_run("laden.csv", 6.0, load_case="laden", samples=SAMPLES)]  # fmt: skip
    behind = campaign(runs, load_cases=(EMPTY, LADEN), vehicle=replace(VEHICLE, axles=rubbing))
    parameters = campaign_parameters(behind, None)
    truth: dict[str, float] = {}
    for i in range(3):
        truth |= {f"k_{i + 1}": STIFFNESS[i], f"c_{i + 1}": DAMPING[i], f"F_{i + 1}": friction}
    logs = np.log([truth.get(p.name, p.start) for p in parameters.parameters])
    model = bump_model(behind, parameters, PROFILES, contact=contact)
    random, filled = np.random.default_rng(11), {}
    on_time, late = (simulate_runs(model, logs, RunMotion.steady(SPEED_M_S, START_S + s)) for s in (0.0, lag[1]))
    for signals, shifted, group in zip(on_time, late, model.groups, strict=True):
        for position, r in enumerate(group.runs):
            channels = runs[r].log.channels
            clean = signals[:SAMPLES, position].copy()
            for c, channel in enumerate(channels):
                if channel.sensor.column == lag[0]:
                    clean[:, c] = shifted[:SAMPLES, position, c]
            noise = np.array([2e-4 if c.sensor.kind == "suspension_deflection" else 0.1 for c in channels])
            filled[r] = with_values(runs[r], clean + noise * random.normal(size=clean.shape))
    return campaign([filled[r] for r in range(3)], load_cases=(EMPTY, LADEN), vehicle=replace(VEHICLE, axles=linear))


def changed(data: Campaign, column: str, change: Callable[[Channel], Channel]) -> Campaign:
    """The campaign with one sensor changed in all runs."""
    runs = []
    for run in data.bump_runs:
        channels = tuple(change(c) if c.sensor.column == column else c for c in run.log.channels)
        runs.append(replace(run, log=replace(run.log, channels=channels)))
    return replace(data, bump_runs=tuple(runs))


def times(factor: float) -> Callable[[Channel], Channel]:
    return lambda c: replace(c, value=factor * c.value)


def at_x(place: float) -> Callable[[Channel], Channel]:
    return lambda c: replace(c, sensor=replace(c.sensor, x_m=place))


def sentence_of(data: Campaign) -> str | None:
    optimum = optimise(data, campaign_parameters(data, None), PROFILES, OPTIONS, unwatched)
    return sentence(likely_mistake(data, optimum))


def sentence(causes: Sequence[Cause]) -> str | None:
    return causes[0].sentence if causes else None


@pytest.mark.parametrize(
    ("friction", "contact"), [(0.0, "footprint"), (1500.0, "footprint"), (5000.0, "footprint"), (0.0, "cams")]
)
def test_a_truck_unlike_its_model_is_accused_of_nothing(friction: float, contact: ContactLaw):
    data = measured(friction, contact)
    optimum = optimise(data, campaign_parameters(data, None), PROFILES, OPTIONS, unwatched)
    if friction or contact != "footprint":
        assert optimum.misfit > 1.3  # so that there is reason to look
    scores = mistake_scores(data, optimum)
    # A part on springs may have any mass, so one fits a little to anything.
    most = {"own springs": 0.4}
    assert all(score.share < most.get(score.candidate.kind, 0.25) * NAMED_SHARE for score in scores if score.whole)
    assert named_mistake(data, scores) == ()


@pytest.mark.parametrize("column", ["axle2_lvdt", "frame1_accel", "axle3_accel"])
def test_a_wrong_sign(column: str):
    said = sentence_of(changed(measured(), column, times(-1.0)))
    assert said is not None
    assert f"probably the sensor '{column}' has the wrong sign" in said
    assert "set sign = -1 for it" in said


def test_a_lag():
    said = sentence_of(measured(lag=("axle1_lvdt", 0.03)))
    assert said is not None
    late = float(re.findall(r"probably the sensor 'axle1_lvdt' is (\d+) ms late", said)[0])
    assert late == pytest.approx(30.0, abs=6.0)


def test_a_scale():
    said = sentence_of(changed(measured(), "axle3_lvdt", times(1.25)))
    assert said is not None
    factor = float(re.findall(r"probably the sensor 'axle3_lvdt' reads (\S+) times what it should", said)[0])
    assert factor == pytest.approx(1.25, abs=0.05)


def test_a_frame_sensor_that_is_not_at_its_place():
    said = sentence_of(changed(measured(), "frame2_accel", at_x(3.5)))
    assert said is not None
    place = float(re.findall(r"probably the sensor 'frame2_accel' is at x_m = (\S+), not at 3.5", said)[0])
    assert place == pytest.approx(5.0, abs=0.3)


def test_an_axle_that_is_not_at_its_place():
    data = measured()
    moved = tuple(replace(a, x_m=a.x_m - 0.3) if i == 1 else a for i, a in enumerate(data.vehicle.axles))
    said = sentence_of(replace(data, vehicle=replace(data.vehicle, axles=moved)))
    assert said is not None
    assert re.search(rf"probably the axle '{moved[1].name}' is about [234]0 cm behind its declared place", said)


@pytest.mark.parametrize(("run", "listed"), [(0, "laden"), (2, "empty")])
def test_a_run_of_another_load_case(run: int, listed: str):
    data = measured()
    runs = tuple(replace(r, load_case=listed) if i == run else r for i, r in enumerate(data.bump_runs))
    said = sentence_of(replace(data, bump_runs=runs))
    assert said is not None
    driven = data.bump_runs[run]
    assert f"{driven.log.file} was driven in the load case '{driven.load_case}', not '{listed}'" in said


def test_a_sentence_says_the_share_and_comes_first():
    data = changed(measured(), "axle2_lvdt", times(-1.0))
    fit, _ = fit_with_laws(data, None, PROFILES, OPTIONS)
    assert fit.warnings[0].startswith("One mistake would explain 100 % of what the residuals hold beyond the noise")


def score(share: float, amplitude: float = 1.0, column: str = "axle1_lvdt", kind="sign") -> MistakeScore:
    sensor = next(c.sensor for c in measured().bump_runs[0].log.channels if c.sensor.column == column)
    return MistakeScore(MistakeCandidate(kind, sensor=sensor), share, amplitude)


def test_only_a_large_share_that_one_step_takes_is_named():
    data = measured()
    assert named_mistake(data, []) == ()
    assert named_mistake(data, [score(0.9 * NAMED_SHARE)]) == ()
    assert named_mistake(data, [score(0.9, amplitude=0.2)]) == ()
    assert "90 %" in (sentence(named_mistake(data, [score(0.9)])) or "")
    other = score(0.85, column="axle2_lvdt")
    both = sentence(named_mistake(data, [score(0.9), other]))
    assert both is not None
    assert "It may as well (85 %) be that the sensor 'axle2_lvdt'" in both
    # Three that say the same say nothing.
    assert named_mistake(data, [score(0.9), other, score(0.84, column="axle3_lvdt")]) == ()
