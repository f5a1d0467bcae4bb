"""What somebody sees and types in a notebook: one screen, short lists of names, values by name, passes by speed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from small_results import small_results

import sysid
from sysid.errors import CampaignError
from sysid.workflow import Calibration, make_settings, stages
from sysid.workflow.description import described

ROOT = Path(__file__).parents[2]


@pytest.fixture
def calibration(tmp_path) -> Calibration:
    return Calibration(ROOT / "examples" / "linear_truck", tmp_path / "out")


def test_a_calibration_shows_k_and_c_in_the_units_of_the_trade_on_one_screen() -> None:
    results = small_results()
    text = described(results.campaign, "out", ("check", "fit"), results.drops, results.fit, results.posterior)
    assert len(text.splitlines()) <= 24
    assert max(map(len, text.splitlines())) <= 80
    s = results.posterior["k_1"]
    (line,) = [line for line in text.splitlines() if line.startswith("1 ")]
    shown = re.search(r"([\d.]+) ± ([\d.]+)", line)
    assert shown is not None
    assert float(shown[1]) == pytest.approx(s.q50 / 1e3, rel=2e-3)
    assert float(shown[2]) == pytest.approx((s.q95 - s.q05) / 2e3, rel=0.1)
    assert "Finished: check and fit" in text
    assert "posterior, ±" in text
    # Of the drops alone it says so.
    assert "plank drops, ±" in described(results.campaign, "out", ("drops",), results.drops, None, None)


def test_before_anything_has_run_it_says_what_can_be_called(calibration: Calibration) -> None:
    text = repr(calibration)
    assert "Nothing has run yet" in text
    assert "6 axles, 18 plank drops, 10 bump runs" in text
    for name in re.findall(r"(\w+)\(\)", text):
        assert callable(getattr(calibration, name))


def test_the_names_of_a_calibration_are_those_that_a_user_calls(calibration: Calibration) -> None:
    names = dir(calibration)
    assert len(names) < 30
    assert {"check", "drops", "fit", "sample", "predict", "report", "run", "results"} <= set(names)
    assert not [name for name in names if name.startswith("_")]
    assert all(hasattr(calibration, name) for name in names)


def test_quick_is_the_preview_of_the_command_line(tmp_path) -> None:
    folder = ROOT / "examples" / "linear_truck"
    assert Calibration(folder, tmp_path, quick=True).settings == make_settings(quick=True)
    with pytest.raises(ValueError, match="either settings or quick"):
        Calibration(folder, tmp_path, make_settings(), quick=True)


def test_values_are_found_by_name_and_a_slip_names_the_nearest() -> None:
    results = small_results()
    assert results.fit["c_1"] is next(p for p in results.fit.parameters if p.name == "c_1")
    table = results.fit.parameters.to_pandas().set_index("name")
    assert table.loc["c_1", "value"] == results.fit["c_1"].value
    assert "c_1" in repr(results.fit.parameters)
    assert results.posterior["c_1"] is next(s for s in results.posterior.summaries if s.name == "c_1")
    for result in (results.fit, results.posterior):
        with pytest.raises(KeyError, match="did you mean 'c_1'"):
            result["C_1"]


def test_a_speed_predicts_a_pass_aside_and_none_those_of_the_campaign(calibration: Calibration, monkeypatch) -> None:
    seen = []
    monkeypatch.setattr(Calibration, "aside", lambda self, stage, options: seen.append((stage, options)))
    monkeypatch.setattr(Calibration, "result", lambda self, stage: seen.append(stage))
    calibration.predict(60, load_case="loaded")
    calibration.predict([40, 50.5], road="B", length_m=200.0)
    calibration.predict()
    assert seen[0] == (stages.PREDICT, {"speeds": (60,), "seed": 0, "load_case": "loaded"})
    assert seen[1][1] == {"speeds": (40, 50.5), "seed": 0, "road": "B", "length": 200.0}
    assert seen[2] is stages.PREDICT
    # Every name is one that the options of the command have.
    known = {option.name for option in stages.PREDICT.command.options} | {"seed"}
    assert all(set(options) <= known for _, options in seen[:2])
    with pytest.raises(CampaignError, match="needs a speed"):
        calibration.predict(road="B")


def test_the_snippet_of_the_readme_uses_names_that_there_are() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    snippet = re.search(r"```python\n(import sysid\n.*?)```", text, re.DOTALL)[1]
    compile(snippet, "README.md", "exec")
    for name in re.findall(r"calibration\.(\w+)\(", snippet):
        assert hasattr(sysid.Calibration, name), name
    results = small_results()
    for owner, key, field in re.findall(r"(fit|posterior)\[\"(\w+)\"\]\.(\w+)", snippet):
        assert hasattr(getattr(results, owner)[key], field)
