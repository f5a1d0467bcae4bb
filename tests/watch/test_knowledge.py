"""What is known of axles, when it is enough, and what is said otherwise; documents are written by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from sysid.watch import KnownAxle, KnownValue, PlannedTest, StopRule
from sysid.watch.knowledge import known_axles, missing, next_tests, of_document, of_drops

RUNS = tuple(
    PlannedTest("bump_run", (f"{case}{n}.csv",), case, 16.0, "", f"run, {case}, 16 km/h, repeat {n}", n == 1)
    for case in ("empty", "full")
    for n in (1, 2)
)


def fitted(name: str, axle: int, quantity: str, value: float, sd: float, **more: Any) -> dict[str, Any]:
    entry = {"name": name, "axle": axle, "quantity": quantity, "load_case": None, "run": None, "identified": True}
    return {**entry, "least_squares": {"value": value, "sd": sd}, **more}


def balanced(axle: int, quantity: str, low: float, value: float, high: float) -> dict[str, Any]:
    of = {"axle": axle, "quantity": quantity, "load_case": None, "determined": True}
    return {**of, "q05": low, "value": value, "q95": high}


def of_drop(axle: int, stiffness: tuple[float, float], damping: tuple[float, float], **more: Any) -> dict[str, Any]:
    entry = {"axle": axle, "load_case": "empty", "file": "drop.csv", "method": "free_decay", "usable": True}
    entry |= {"stiffness": stiffness[0], "stiffness_sd": stiffness[1], "damping": damping[0], "damping_sd": damping[1]}
    return {"drops": [{**entry, **more}]}


FIT = {
    "parameters": [fitted("k_1", 1, "stiffness", 4e5, 4e3), fitted("c_1", 1, "damping", 1e4, 2e2)],
    "verdict": {"kinds": ["preview", "not_sampled"], "reasons": ["This is a preview.", "Not sampled."]},
}


def test_half_of_a_90_percent_interval() -> None:
    known = of_document(FIT)
    assert known[1, None, "stiffness"].half_width == pytest.approx(norm.ppf(0.95) * 0.01, rel=1e-12)
    assert known[1, None, "damping"].half_width == pytest.approx(norm.ppf(0.95) * 0.02, rel=1e-12)


def test_the_fit_goes_before_the_balance_and_the_balance_before_drops() -> None:
    rows = [balanced(1, "stiffness", 3.6e5, 4e5, 4.4e5), balanced(2, "stiffness", 0.9e6, 1e6, 1.2e6)]
    document = {**FIT, "balance": {"estimates": rows}}
    drops = of_drops([of_drop(2, (2e6, 2e4), (5e3, 1e2)), of_drop(3, (3e6, 3e4), (6e3, 1e2))])
    first, second, third = known_axles(("a", "b", "c"), of_document(document), drops)
    assert first.stiffness == KnownValue(4e5, pytest.approx(norm.ppf(0.95) * 0.01), "fit")
    assert second.stiffness == KnownValue(1e6, pytest.approx(0.15), "balance")
    before = known_axles(("a", "b", "c"), of_document(document, older=True), drops)
    assert [row.stiffness and row.stiffness.older for row in before] == [True, True, False]
    assert second.damping is not None
    assert third.stiffness is not None
    assert (second.damping.source, third.stiffness.source) == ("drops", "drops")
    assert (first.load_case, third.load_case) == (None, "empty")


def test_values_of_load_cases_stand_beside_one_that_all_share() -> None:
    of_cases = [fitted(f"k_1[{c}]", 1, "stiffness", v, 1e3, load_case=c) for c, v in (("empty", 2e5), ("full", 8e5))]
    document = {"parameters": [*of_cases, FIT["parameters"][1]]}
    rows = known_axles(("a",), of_document(document))
    assert [(r.load_case, r.stiffness and r.stiffness.value, r.damping and r.damping.value) for r in rows] == [
        ("empty", 2e5, 1e4),
        ("full", 8e5, 1e4),
    ]


def test_what_is_not_determined_or_not_usable_is_not_known() -> None:
    assert of_document({"parameters": [fitted("k_1", 1, "stiffness", 4e5, 4e3, identified=False)]}) == {}
    assert of_document({"parameters": [fitted("k_1", 1, "stiffness", 4e5, 4e3, run="x")]}) == {}
    assert of_document({"balance": {"estimates": [{**balanced(1, "stiffness", 1, 2, 3), "determined": False}]}}) == {}
    assert of_drops([of_drop(1, (1e6, 1e4), (1e3, 1e1), usable=False)]) == {}
    assert of_drops([of_drop(1, (1e6, 1e4), (1e3, 1e1), method="paper")]) == {}


def test_repeats_of_a_drop_do_not_average_below_what_they_share() -> None:
    values = 4e5 + 1e4 * np.random.default_rng(1).standard_normal(9)
    known = of_drops([of_drop(1, (v, 1e4), (1e4, 1e2)) for v in values])[1, "empty", "stiffness"]
    assert known.value == pytest.approx(values.mean(), rel=0.01)
    assert known.half_width >= 0.999 * norm.ppf(0.95) * 1e4 / known.value


def rows(half: float) -> tuple[KnownAxle, ...]:
    value = KnownValue(1.0, half, "fit")
    return (KnownAxle(1, "a", None, value, value),)


def test_enough_is_enough() -> None:
    assert missing(rows(0.019), StopRule(), FIT, RUNS, ("empty", "full"), ()) == ()
    assert next_tests(RUNS, FIT, True, StopRule()) == ("Enough: stop. What was asked for is known.",)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"known": rows(0.03)}, "k of axle 1 is known within ± 3 %; asked: 2 %."),
        ({"known": rows(float("nan"))}, "k of axle 1 is known within no bounds; asked: 2 %."),
        ({"known": (KnownAxle(1, "a", None, None, None),)}, "Not known: k of axle 1, c of axle 1."),
        ({"document": {}}, "No fit of all that is there has ended yet."),
        ({"planned": RUNS[:2]}, "No run in load case 'full'."),
        ({"waits": ("the bump, is not there yet.",)}, "the bump, is not there yet."),
        (
            {"document": {**FIT, "verdict": {"kinds": ["preview", "parts_disagree"], "reasons": ["p", "Disagree."]}}},
            "Disagree.",
        ),
    ],
)
def test_what_is_missing(change: dict[str, Any], sentence: str) -> None:
    given = {"known": rows(0.01), "rule": StopRule(), "document": FIT, "planned": RUNS, "waits": ()}
    assert sentence in missing(**{**given, **change, "load_cases": ("empty", "full")})


def test_the_worst_is_named_first() -> None:
    said = missing((*rows(0.03), *rows(0.08)), StopRule(), FIT, RUNS, ("empty", "full"), ())
    assert next(s for s in said if s.startswith("k of axle 1")) == "k of axle 1 is known within ± 8 %; asked: 2 %."


def test_what_comes_next() -> None:
    advice = {"advice": {"statements": ["16 km/h, full would bring most."]}}
    assert next_tests(RUNS, advice, False, StopRule()) == (
        "Next in the list: run, empty, 16 km/h, repeat 2 (2 to come).",
        "16 km/h, full would bring most.",
    )


def prospect(k: float, c: float, speed: float | None = None) -> dict[str, Any]:
    """What the advice says of one run: k_1 and c_1 would be known with these standard deviations."""
    return {"load_case": speed and "full", "speed_km_h": speed, "relative_sd": {"k_1": k, "c_1": c}}


def said_of(now: dict[str, Any], *runs: dict[str, Any], **asked: float) -> tuple[str, ...]:
    parameters = [{"name": "k_1", "quantity": "stiffness"}, {"name": "c_1", "quantity": "damping"}]
    document = {"parameters": parameters, "advice": {"now": now, "runs": list(runs), "statements": []}}
    return next_tests(RUNS, document, False, StopRule(**asked))[1:]


def test_the_run_that_helps_most_is_judged_by_what_is_asked() -> None:
    """c is known least well, but well enough: the run that is good for k comes first."""
    now, for_c, for_k = prospect(0.02, 0.03), prospect(0.02, 0.01, 32.0), prospect(0.011, 0.03, 16.0)
    assert said_of(now, for_c, for_k) == (
        "The run that would bring most of what is asked: 16 km/h, full (k_1 from ± 3.3 % to ± 1.8 %; asked: 2 %).",
    )
    (other,) = said_of(now, for_c, for_k, stiffness=0.05, damping=0.02)
    assert "32 km/h, full (c_1 from ± 4.9 % to ± 1.6 %; asked: 2 %)" in other


def test_no_run_is_named_that_brings_nothing() -> None:
    assert said_of(prospect(0.02, 0.03), prospect(0.0199, 0.02, 32.0)) == ()
    assert said_of(prospect(0.01, 0.02), prospect(0.005, 0.01, 32.0)) == ()
