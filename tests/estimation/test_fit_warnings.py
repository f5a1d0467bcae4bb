"""Warnings of a fit come from the figures that the documentation and the report name, and from no others."""

import re
from pathlib import Path

import numpy as np
import pytest
from small_results import small_fit

from sysid.estimation.fit.evaluation import fit_warnings, numerical_doubts
from sysid.estimation.fit.minimiser import Minimum
from sysid.report import tables

DOCS = Path(__file__).parents[2] / "docs"
DONE = Minimum(np.zeros(1), 1.0, True, 3, "the cost no longer changes")


def warned(
    misfit: float = 1.0,
    halving: float = 1e-5,
    apart: float = 0.01,
    minimum: Minimum = DONE,
    instruments: float = 0.0,
) -> tuple[str, ...]:
    determined = small_fit().identifiability
    assert determined is not None
    return fit_warnings(minimum, (misfit, instruments or misfit), halving, apart, determined)


def documented(page: str, pattern: str) -> float:
    """The number that a page names."""
    (found,) = re.findall(pattern, (DOCS / page).read_text(encoding="utf-8"))
    return float(found)


def test_a_fit_without_reason_for_a_warning_has_none():
    assert warned() == warned(apart=float("nan")) == ()


def test_a_rough_road_is_no_fault_of_the_model():
    """Residuals as large as what the sensors show before the bump call for no warning, larger ones name both ratios."""
    assert warned(misfit=1.0, instruments=1.6) == ()
    (said,) = warned(misfit=1.5, instruments=2.4)
    assert "1.5 times what the sensors show before the bump, 2.4 times the instrument noise" in said


@pytest.mark.parametrize(
    ("name", "page", "pattern", "scale", "sentence"),
    [
        ("halving", "search.md", r"half the time step\. More than (\S+) is a warning", 1.0, "Halving"),
        ("halving", "results.md", r"it comes above (\S+) %", 1e-2, "Halving"),
        ("apart", "search.md", r"in standard deviations\. More than (\S+) is a warning", 1.0, "independent solver"),
        ("misfit", "results.md", r"warning starts at (\S+) times", 1.0, "widened"),
        ("misfit", "search.md", r"leave residuals of (\S+) times", 1.0, "widened"),
        ("misfit", "tutorial.md", r"From (\S+) on \(▲\)", 1.0, "widened"),
    ],
)
def test_a_warning_starts_where_the_documentation_says(name: str, page: str, pattern: str, scale: float, sentence: str):
    limit = scale * documented(page, re.sub(" ", r"\\s+", pattern))
    assert warned(**{name: 0.999 * limit}) == ()
    (found,) = warned(**{name: 1.001 * limit})
    assert sentence in found


def test_doubts_are_the_warnings_about_the_numerical_solution():
    """Neither an unfinished search nor a misfit is among them: the verdict has sentences of its own for these."""
    stopped = Minimum(np.zeros(1), 1.0, False, 40, "40 iterations")
    said = numerical_doubts(0.01, 3.0)
    assert warned(misfit=2.0, halving=0.01, apart=3.0, minimum=stopped)[2:] == tuple(said)
    assert ["Halving" in said[0], "independent solver" in said[1]] == [True, True]
    assert numerical_doubts(1e-5, float("nan")) == []


def test_the_report_names_the_same_step_halving_error():
    (row,) = [r for r in tables.fit_table(small_fit()).rows if "step" in r[0].text]
    limit = float(re.fullmatch(r"below (\S+)\s%", row[2].text)[1]) / 100.0
    assert warned(halving=0.999 * limit) == ()
    assert len(warned(halving=1.001 * limit)) == 1


def test_a_search_without_end_is_said_first():
    stopped = Minimum(np.zeros(1), 1.0, False, 40, "40 iterations")
    assert "not final" in warned(misfit=2.0, minimum=stopped)[0]
