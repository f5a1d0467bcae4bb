"""ISO/TS 18571: scores of another implementation, closed forms, and pairs that cannot be rated."""

from __future__ import annotations

import importlib
import json
from pathlib import Path

import numpy as np
import pytest
from rating_curves import INTERVAL_S, rating_curves

from sysid.validation import objective_ratings

REFERENCE = json.loads(
    (Path(__file__).resolve().parents[1] / "data" / "objective_rating" / "ratings.json").read_text(encoding="utf-8")
)
SCORES = ("corridor", "phase", "magnitude", "slope", "overall")
CURVES = rating_curves()


@pytest.mark.parametrize("name", CURVES)
def test_scores_are_those_of_another_implementation(name):
    found = objective_ratings(*(curve[None] for curve in CURVES[name]))[0]
    assert {score: getattr(found, score) for score in SCORES} == pytest.approx(REFERENCE[name], abs=1e-9)


@pytest.mark.parametrize(("module", "home"), [("iso18571", "iso18571"), ("objective_rating_metrics", ".rating")])
def test_scores_are_those_of_an_installed_library(module, home):
    """The libraries exist for some versions of Python only; where one is installed it is asked directly."""
    pytest.importorskip(module)
    library = importlib.import_module(home, module).ISO18571
    for measured, simulated in CURVES.values():
        time = INTERVAL_S * np.arange(measured.size)
        theirs = library(np.column_stack([time, measured]), np.column_stack([time, simulated]))
        ours = objective_ratings(measured[None], simulated[None])[0]
        assert ours.overall == pytest.approx(theirs.overall_rating(ndigits=-1), abs=1e-6)


def test_curves_cover_good_and_poor_ratings_and_every_score():
    overall = [r["overall"] for r in REFERENCE.values()]
    assert min(overall) < 0.4
    assert max(overall) > 0.9
    for score in SCORES[:-1]:
        assert np.ptp([r[score] for r in REFERENCE.values()]) > 0.5


def test_a_shift_costs_its_share_of_a_fifth_of_the_record():
    """A pulse inside quiet ends, 12 of 200 samples late: phase 1 - 12 / 40, and nothing else once shifted back."""
    measured = np.zeros(200)
    measured[60:110] = np.sin(np.linspace(0.0, np.pi, 50)) ** 2
    found = objective_ratings(measured[None], np.roll(measured, 12)[None])[0]
    assert found.phase == pytest.approx(1.0 - 12 / 40)
    assert (found.magnitude, found.slope) == pytest.approx((1.0, 1.0))


def test_a_scaled_copy_costs_corridor_and_magnitude_by_the_formula():
    """A constant 1 with one step: no warping helps against 1.2 times it; error 0.2, corridor ((0.5 - 0.2) / 0.45)^2."""
    measured = np.ones(100)
    measured[0] = 0.999
    found = objective_ratings(measured[None], 1.2 * measured[None])[0]
    assert found.corridor == pytest.approx((0.3 / 0.45) ** 2, abs=1e-3)
    assert found.magnitude == pytest.approx(1.0 - 0.2 / 0.5, abs=1e-3)


def test_pairs_of_a_record_are_rated_one_by_one():
    """Several pairs at once, each with a shift and so a length of its own, give what each gives alone."""
    rows = [CURVES[name] for name in ("half amplitude", "early", "late", "wider and higher", "offset")]
    measured, simulated = (np.array([row[k] for row in rows]) for k in (0, 1))
    for together, (m, s) in zip(objective_ratings(measured, simulated), rows, strict=True):
        assert together == objective_ratings(m[None], s[None])[0]


def test_what_cannot_be_rated_is_none():
    good = np.sin(np.arange(50) / 5.0)
    hole = good.copy()
    hole[3] = np.nan
    found = objective_ratings(np.array([good, hole, good, np.ones(50)]), np.array([good, good, hole, good]))
    assert [r is None for r in found] == [False, True, True, True]
    assert found[0].overall == pytest.approx(1.0)
    assert objective_ratings(good[None, :10], good[None, :10]) == (None,)
    assert objective_ratings(np.zeros((0, 50)), np.zeros((0, 50))) == ()
