"""What advice, profiles and the fit print: words and numbers of small results."""

from __future__ import annotations

import io
from dataclasses import replace

from rich.console import Console
from small_results import small_fit, small_profile, small_results

from sysid.cli.tables import render
from sysid.estimation.uncertainty.identifiability import UndeterminedGroup
from sysid.workflow.stages.fit import show_profile, shown_fit
from sysid.workflow.stages.loads import show_advise


def shown(show, *results) -> str:
    console = Console(width=200, record=True, file=io.StringIO())
    render(console, show(*results))
    return console.export_text()


def open_fit():
    fit = small_fit()
    group = UndeterminedGroup(("k_1", "c_1"), 1, "combination", float("nan"))
    found = replace(fit.identifiability, groups=(group,), statements=("Of k_1 and c_1 only one combination.",))
    parameters = tuple(replace(p, identified=p.name != "k_1") for p in fit.parameters)
    return replace(fit, parameters=parameters, identifiability=found)


def test_a_parameter_that_is_not_determined_is_no_number():
    text = shown(shown_fit, open_fit())
    (line,) = [line for line in text.splitlines() if line.startswith("k_1")]
    assert "not determined" in line
    assert "420" not in line
    assert "504 ± 40 %" in line
    assert "Of k_1 and c_1 only one combination." in text
    assert "calibrate.py advise" in text
    assert "calibrate.py advise" not in shown(shown_fit, small_fit())


def test_advice_is_a_row_per_run_and_sentences():
    results = small_results()
    text = shown(show_advise, results.advice, results)
    assert "20 km/h, laden, with LVDT at axle 2" in text
    assert "2.5 % (c_2)" in text
    assert "one remark" in text


def test_a_profile_shows_both_intervals():
    text = shown(show_profile, {"k_1": small_profile()}, None)
    # 400 exp(+-0.1 x 1.645) kN/m.
    assert text.count("339.33 to 471.51 kN/m") == 2
    assert "is a parabola" in text
