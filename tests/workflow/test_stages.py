"""When a stage is computed again: a larger limit, other speeds, an interrupt; and in which order stages run."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from small_results import small_advice, small_driven, small_fit, small_profile, small_results

from sysid.campaign.records import PredictionRequest
from sysid.errors import CampaignError
from sysid.estimates import Estimates
from sysid.estimation.fit.state import FitPoint
from sysid.estimation.parameters.parameter_set import Parameter, ParameterSet
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_history import HistoryBand
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.posterior import sampling
from sysid.posterior.options import SamplingOptions
from sysid.workflow import Calibration, Settings
from sysid.workflow.progress import Steps
from sysid.workflow.stages import BANDS, CHECK, DROPS, FIT, PREDICT, SAMPLE, SCAN, STAGES

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"


class StandardNormal:
    """A density that needs no vehicle."""

    def __init__(self, state: object):
        pass

    def with_larger_steps(self) -> StandardNormal:
        return self

    def __call__(self, points: np.ndarray) -> np.ndarray:
        return -0.5 * (points**2).sum(axis=1)


@pytest.fixture
def stubbed(tmp_path: Path, monkeypatch) -> Callable[..., Calibration]:
    """Calibrations of one output folder whose fit is at hand and whose posterior is a normal distribution."""
    fit, small = small_fit(), small_results()
    count = len(fit.names)
    state = SimpleNamespace(
        point=FitPoint(
            parameters=ParameterSet((Parameter("k_1", "stiffness", "N/m", 1.0, 1.0, 0.1),)),
            contact="footprint",
            tires=None,
            target_step_s=0.001,
            log_parameters=np.zeros(count),
            motion=RunMotion.steady(np.ones(2), np.zeros(2)),
            weights=Weights((), ()),
            mode=np.zeros(count),
            covariance=np.eye(count),
        )
    )
    at_hand = {CHECK: small.quality, DROPS: small.drops, SCAN: dict(small.scans)}
    monkeypatch.setattr("sysid.estimation.fit.law_choice.fit_with_laws", lambda *given: (fit, state))
    for place in ("fit", "posterior", "loads"):
        monkeypatch.setattr(f"sysid.workflow.stages.{place}.fit_state", lambda context: state)
    # The fit is that of another truck than the campaign's.
    monkeypatch.setattr("sysid.estimates.derive.derive_estimates", lambda *given: Estimates())
    monkeypatch.setattr("sysid.prediction.driven_range.driven_range", lambda state: small_driven())
    monkeypatch.setattr("sysid.posterior.log_density.LogDensity", StandardNormal)
    sample = sampling.sample_posterior
    monkeypatch.setattr(
        sampling,
        "sample_posterior",
        lambda density, names, centre, covariance, *rest, **more: sample(
            density, names, centre, np.eye(count), *rest, **more
        ),
    )
    monkeypatch.setattr(
        "sysid.prediction.run_bands.run_bands",
        lambda state, draws, **more: (HistoryBand(np.zeros((4, 400)), np.full((4, 400), float(len(draws)))),) * 2,
    )

    def made(*, resume: bool = False, max_steps: int = 20, progress=None) -> Calibration:
        options = SamplingOptions(
            segment_steps=10, adapting_steps=0, min_steps=10, max_steps=max_steps, min_effective=5e3
        )
        found = Calibration(DATA, tmp_path / "out", replace(Settings(), sampling=options), progress, resume=resume)
        for stage, result in at_hand.items():
            if found._folder.known(stage) is None:
                found._folder.keep(stage, result)
        return found

    return made


def test_what_the_draws_say_about_the_optimum_is_a_warning(stubbed, monkeypatch) -> None:
    monkeypatch.setattr(
        "sysid.posterior.sampled_posterior.optimum_warnings", lambda draws, at, density: (f"{density:+.1f}",)
    )
    assert stubbed().sample().warnings[-1] == "-0.0"


def test_a_chain_that_has_not_converged_goes_on_with_a_larger_limit(stubbed) -> None:
    first = stubbed()
    before = first.sample()
    assert not before.converged
    # Without --resume what is known is shown, and under the same limit nothing is left to do.
    assert stubbed(max_steps=40).sample().message == before.message
    assert stubbed(resume=True).sample().message == before.message
    longer = stubbed(resume=True, max_steps=40)
    after = longer.sample()
    assert "40 steps" in after.message
    band = longer._folder.known(BANDS)[0]
    assert band.high[0, 0] == after.draws[..., 0].size
    assert after.burn_in + after.draws.shape[1] == 40


def test_advice_for_other_speeds_is_computed_anew(stubbed, monkeypatch) -> None:
    asked = []

    def advise(*given, speeds_km_h, **more):
        asked.append(tuple(speeds_km_h))
        advice = small_advice(small_fit())
        return replace(advice, runs=tuple(replace(advice.runs[0], speed_m_s=v / 3.6) for v in speeds_km_h))

    # The package has a function of the module's name.
    monkeypatch.setattr(importlib.import_module("sysid.planning.ranking"), "advise", advise)
    calibration = stubbed()
    calibration.advise((20.0, 30.0))
    assert [p.speed_m_s for p in calibration.advise((40.0,)).runs] == [40.0 / 3.6]
    stubbed().advise((40.0,))
    assert asked == [(20.0, 30.0), (40.0,)]


def test_profiles_of_before_and_those_that_are_done_survive_an_interrupt(stubbed, monkeypatch) -> None:
    calls = []

    def profile(state, fit, name, progress):
        calls.append(name)
        if name == "c_1":
            raise KeyboardInterrupt
        return small_profile(name)

    monkeypatch.setattr("sysid.estimation.fit.profiles.profile_parameter", profile)
    names = small_fit().names
    stubbed().profile([names[0]])
    with pytest.raises(KeyboardInterrupt):
        stubbed().profile([names[1], "c_1"])
    assert [p.name for p in stubbed().profile(names[:2])] == list(names[:2])
    assert calls == [names[0], names[1], "c_1"]
    assert [p.name for p in stubbed().results().profiles] == list(names[:2])


def test_other_passes_are_predicted_for_the_campaign_that_was_fitted(stubbed, monkeypatch) -> None:
    """Draws of masses and departures count the load cases of its runs and predictions."""
    given = {}
    monkeypatch.setattr("sysid.workflow.stages.loads.fit_state", lambda context: context)
    monkeypatch.setattr(
        "sysid.prediction.predict_passes.predict",
        lambda state, draws, requests, **more: given.update(more, campaign=state.campaign, requests=requests),
    )
    calibration = stubbed()
    calibration.predict_passes([PredictionRequest("unloaded", 5.0)])
    assert given["campaign"] is calibration.campaign
    assert given["requests"] == (PredictionRequest("unloaded", 5.0),)
    assert given["sweep_km_h"] == ()


def test_a_stage_runs_those_that_it_needs_and_says_which_of_how_many(stubbed) -> None:
    seen: list[tuple[str, float]] = []
    calibration = stubbed(progress=lambda message, fraction: seen.append((message, fraction)))
    calibration.sample()
    places = list(dict.fromkeys(message.split(":")[0] for message, _ in seen))
    assert places == ["1 of 3 fit", "2 of 3 sample", "3 of 3 bands"]
    assert {"fit", "sample", "sample: sampling", "bands"} <= calibration.results().provenance["timings"].keys()
    seen.clear()
    calibration.sample()
    assert seen == []


def test_the_engine_is_compiled_ahead_once_and_only_for_stages_that_simulate(stubbed, monkeypatch) -> None:
    begun, ended = [], []

    @contextmanager
    def ahead(vehicle: object, *, parts: bool) -> Iterator[None]:
        begun.append(parts)
        yield
        ended.append(parts)

    monkeypatch.setattr("sysid.vehicle_model.engine.compiled_ahead", ahead)
    calibration = stubbed()
    calibration.check()
    assert begun == []
    # Sampling needs the fit, which is missing; a whole run asks for it inside.
    with calibration._runner.engine_ahead([FIT, SAMPLE]):
        calibration.sample()
        assert (begun, ended) == ([True], [])
    assert begun == ended == [True]
    calibration.sample()
    assert begun == [True]
    again = stubbed()
    again._folder.forget((DROPS, FIT))
    monkeypatch.setattr("sysid.sdof.summary.analyse_drops", lambda campaign, **rest: small_results().drops)
    monkeypatch.setattr("sysid.estimation.fit.drop_model.with_model_estimates", lambda campaign, drops, *rest: drops)
    monkeypatch.setattr("sysid.estimation.fit.drop_coupling.with_cautions", lambda campaign, drops: drops)
    again.drops()
    assert begun == ended == [True, False]


def test_a_result_without_a_place_of_its_own_is_kept_under_its_name(stubbed, monkeypatch) -> None:
    calibration = stubbed()
    put = FIT.put
    object.__setattr__(FIT, "put", None)
    try:
        kept = calibration.result(FIT)
        found = calibration.results()
        assert found.further == {"fit": kept}
        assert found.fit is None
    finally:
        object.__setattr__(FIT, "put", put)


def test_what_cannot_be_asked_for_is_said_before_minutes_are_spent(stubbed, monkeypatch) -> None:
    def no_fit(*given):
        raise AssertionError("fitted")

    monkeypatch.setattr("sysid.estimation.fit.law_choice.fit_with_laws", no_fit)
    with pytest.raises(CampaignError, match="--leave-out nonsense is none of the runs"):
        stubbed().leave_out(["nonsense"])
    with pytest.raises(CampaignError, match="--load-case 'nowhere' is not in the campaign"):
        stubbed().aside(PREDICT, {"speeds": (20.0,), "load_case": "nowhere"})
    with pytest.raises(AssertionError, match="fitted"):
        stubbed().fit()


def test_a_stage_sees_those_only_that_its_record_names(stubbed) -> None:
    context = stubbed()._runner.context(FIT)
    assert context[DROPS].pooled
    with pytest.raises(KeyError, match="'sample' is none of the stages"):
        context.known(SAMPLE)


def test_estimates_follow_whatever_has_run(stubbed, monkeypatch) -> None:
    given = []
    monkeypatch.setattr("sysid.estimates.derive.derive_estimates", lambda *parts: given.append(parts) or Estimates())
    calibration = stubbed()
    assert calibration.results().estimates == Estimates()
    calibration.fit()
    calibration.results()
    calibration.sample()
    calibration.results()
    calibration.results()
    # (campaign, drops, scans, fit, posterior): once after each stage, never twice for the same.
    assert [(fit is not None, posterior is not None) for _, _, _, fit, posterior in given] == [
        (False, False), (True, False), (True, True),
    ]  # fmt: skip
    assert all(drops.pooled and scans for _, drops, scans, _, _ in given)


def test_stages_stand_behind_those_that_they_rest_on():
    for number, stage in enumerate(STAGES):
        assert {*stage.needs, *stage.uses} <= set(STAGES[:number])
        assert stage.along_with is None or stage.along_with in stage.needs
    assert len({stage.name for stage in STAGES}) == len(STAGES)


@pytest.fixture
def steps() -> tuple[Steps, list[tuple[str, float]]]:
    seen: list[tuple[str, float]] = []
    return Steps(lambda message, fraction: seen.append((message, fraction))), seen


def test_progress_never_goes_back_and_weighs_what_takes_long(steps) -> None:
    found, seen = steps
    with found.planned({"a": 1.0, "b": 3.0}):
        with found.step("a"):
            found("first", 0.5)
            # A search that begins again, and a stage that overstates itself.
            found("first, again", 0.1)
            found("second", 7.0)
        with found.planned({"c": 1.0}), found.step("b"):
            found("third", 0.5)
    assert seen == [
        ("1 of 2 a", 0.0), ("1 of 2 a: first", 0.125), ("1 of 2 a: first, again", 0.125), ("1 of 2 a: second", 0.25),
        ("2 of 2 b", 0.25), ("2 of 2 b: third", 0.625),
    ]  # fmt: skip
    assert list(found.parts) == ["a: first", "a: second", "b: third"]


def test_one_step_alone_has_no_number_and_an_unplanned_one_says_nothing(steps) -> None:
    found, seen = steps
    with found.planned({"a": 2.0}), found.step("a"):
        found("working", 0.5)
    with found.step("b"):
        found("quietly", 0.5)
    assert seen == [("working", 0.5)]
    assert list(found.parts) == ["a: working", "b: quietly"]
