"""The table of what was driven: a test that is to be confirmed hides no hole."""

from __future__ import annotations

from sysid.first_look.coverage import coverage_table
from sysid.first_look.load_cases import LoadCaseGuess
from sysid.first_look.records import EntryGuess, FirstLook


def drop(axle: int | None, case: str | None, sure: bool = True) -> EntryGuess:
    return EntryGuess("a.csv", "plank_drop", case, axle, None, sure, ())


def run(speed_km_h: float | None, case: str | None, sure: bool = True) -> EntryGuess:
    return EntryGuess("a.csv", "bump_run", case, None, speed_km_h, sure, ())


def rows(*tests: EntryGuess) -> dict[str, tuple[str, ...]]:
    cases = {"empty": LoadCaseGuess("empty"), "laden": LoadCaseGuess("laden")}
    look = FirstLook((), (), (), (), tests, None, False, 2, None, None, cases, (), {}, ())
    return {row[0]: row[1:] for row in coverage_table(look).rows}


def test_what_is_known_is_counted_and_a_hole_is_none() -> None:
    found = rows(drop(0, "empty"), drop(0, "empty"), drop(1, "laden"), run(16.0, "empty"), run(16.4, "laden"))
    assert found == {
        "drops, axle 1": ("2", "none"),
        "drops, axle 2": ("none", "1"),
        "runs, 16.2 km/h": ("1", "1"),
    }


def test_a_guess_stands_in_its_cell_with_a_question_mark() -> None:
    found = rows(
        drop(0, "empty"), drop(0, "empty", sure=False), drop(1, "laden", sure=False), run(24.0, "empty", False)
    )
    assert found["drops, axle 1"] == ("1 + 1?", "none")
    assert found["drops, axle 2"] == ("none", "1?")
    assert found["runs, 24 km/h"] == ("1?", "none")


def test_what_is_not_known_has_a_row_and_a_column_of_its_own() -> None:
    found = rows(drop(None, "empty", False), drop(0, None, False), run(None, None, False))
    assert found["drops, axle ?"] == ("1?", "none", "none")
    assert found["drops, axle 1"] == ("none", "none", "1?")
    assert found["runs, ? km/h"] == ("none", "none", "1?")
