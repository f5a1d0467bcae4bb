"""When a stage is computed again: other settings of a stage before it, a larger limit, other speeds, an interrupt."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from small_results import small_advice, small_fit, small_profile

from sysid.campaign.records import PredictionRequest
from sysid.estimation.fit.options import FitOptions
from sysid.posterior.sampling import SamplingOptions, sample_posterior
from sysid.workflow import Calibration, Settings, stage_folder
from sysid.workflow.calibration import Calibration as Stages
from sysid.workflow.stage_folder import STAGES, StageFolder

DATA = Path(__file__).parents[2] / "data"
EVERY = (*STAGES, "left_out")
FROM_FIT = {"fit", "advise", "profile", "left_out", "sample", "crosscheck", "bands", "predict"}


def stale(folder: Path, settings: Settings) -> set[str]:
    """Stages of a filled folder that other settings do not know."""
    found = StageFolder(folder, settings, {})
    return {name for name in EVERY if found.known(name) is None}


@pytest.fixture
def filled(tmp_path: Path) -> Path:
    """Output folder with a result of every stage."""
    stages = StageFolder(tmp_path, Settings(), {})
    for name in EVERY:
        stages.keep(name, (1.0,))
    return tmp_path


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        (Settings(), set()),
        (Settings(sampling=SamplingOptions(max_steps=9)), set()),
        (Settings(drop_model=False), FROM_FIT | {"drops"}),
        (Settings(fit=FitOptions(weight_rounds=1)), FROM_FIT | {"drops"}),
        (Settings(sampling=SamplingOptions(seed=1)), {"sample", "crosscheck", "bands", "predict"}),
    ],
)
def test_stages_that_rest_on_other_settings_are_stale(filled: Path, settings: Settings, expected: set[str]) -> None:
    assert stale(filled, settings) == expected


def test_stages_that_rest_on_a_result_of_other_content_are_stale(filled: Path, monkeypatch) -> None:
    monkeypatch.setitem(stage_folder._CONTENT, "sample", 99)
    assert stale(filled, Settings()) == {"sample", "crosscheck", "bands", "predict"}
    monkeypatch.setitem(stage_folder._CONTENT, "check", 99)
    assert stale(filled, Settings()) == set(EVERY)


@pytest.fixture
def stubbed(tmp_path: Path, monkeypatch):
    """Calibrations of one output folder whose fit is at hand and whose posterior is a normal distribution."""
    fit = small_fit()
    count = len(fit.names)
    monkeypatch.setattr(Stages, "_fit", lambda self: (fit, {}))
    monkeypatch.setattr(Stages, "_state", lambda self: SimpleNamespace(model=None, motion=None, weights=None))
    monkeypatch.setattr(Stages, "_bands", lambda self, posterior: (float(posterior.draws.shape[1]),))

    def sample(self):
        return sample_posterior(
            lambda x: -0.5 * (x**2).sum(axis=1), fit.names, np.zeros(count), np.eye(count), "normal",
            self.settings.sampling, folder=self.output / "chain", resume=self._resume,
        )  # fmt: skip

    monkeypatch.setattr(Stages, "_sample", sample)

    def made(*, resume: bool = False, max_steps: int = 20) -> Calibration:
        options = SamplingOptions(segment_steps=10, min_steps=10, max_steps=max_steps)
        return Calibration(DATA, tmp_path / "out", replace(Settings(), sampling=options), resume=resume)

    return made


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
    assert longer._stages.known("bands") == (float(after.draws.shape[1]),)
    assert after.burn_in + after.draws.shape[1] == 40


def test_advice_for_other_speeds_is_computed_anew(stubbed, monkeypatch) -> None:
    asked = []

    def advise(self, speeds):
        asked.append(tuple(speeds))
        advice = small_advice(small_fit())
        return replace(advice, runs=tuple(replace(advice.runs[0], speed_m_s=v / 3.6) for v in speeds))

    monkeypatch.setattr(Stages, "_advise", advise)
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

    monkeypatch.setattr("sysid.workflow.calibration.profile_parameter", profile)
    names = small_fit().names
    stubbed().profile([names[0]])
    with pytest.raises(KeyboardInterrupt):
        stubbed().profile([names[1], "c_1"])
    assert [p.name for p in stubbed().profile(names[:2])] == list(names[:2])
    assert calls == [names[0], names[1], "c_1"]


def test_other_passes_are_predicted_for_the_campaign_that_was_fitted(stubbed, monkeypatch) -> None:
    """Draws of masses and departures count the load cases of its runs and predictions."""
    given = {}
    monkeypatch.setattr(Stages, "_state", lambda self: SimpleNamespace(campaign=self.campaign))
    monkeypatch.setattr(
        "sysid.workflow.calibration.predict",
        lambda state, draws, requests, **options: given.update(campaign=state.campaign, requests=requests),
    )
    calibration = stubbed()
    calibration.predict_passes([PredictionRequest("unloaded", 5.0)])
    assert given["campaign"] is calibration.campaign
    assert given["requests"] == (PredictionRequest("unloaded", 5.0),)
