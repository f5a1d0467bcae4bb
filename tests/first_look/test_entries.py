"""Drops and runs told apart by which way things move first, and by which axles move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

from sysid.first_look.entries import kind_of_test
from sysid.first_look.features import Look
from sysid.first_look.file_words import path_says
from sysid.first_look.kinds import KindGuess
from sysid.first_look.records import SeenLog

Q, A, B = "suspension_deflection", "axle_acceleration", "body_acceleration"


def log(columns: Sequence[tuple[str, float, float, float]], file: str = "rec_1.csv") -> tuple[SeenLog, dict]:
    """A log of columns (kind, size, arrival [s], lift) and their kinds."""
    looks = tuple(
        Look(f"c{i}", None, 200.0, 900, 4.5, 0.0, 0.01, size, 0.5, at, lift, True)
        for i, (_, size, at, lift) in enumerate(columns)
    )
    kinds = {f"c{i}": KindGuess(f"c{i}", c[0], "g", 1, True, ()) for i, c in enumerate(columns)}
    return SeenLog(file, "a text table", looks, None, (), path_says(file)), kinds


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        # Off a plank the axle falls, the frame follows, and they move apart first.
        ([(Q, 40.0, 1.0, 0.9), (A, 2.0, 1.0, -0.9), (B, 0.5, 1.0, -0.9)], "plank_drop"),
        # Onto a bump all is turned round.
        ([(Q, 40.0, 1.0, -0.9), (A, 2.0, 1.0, 0.9), (B, 0.5, 1.0, 0.9)], "bump_run"),
        # The axle's first motion may be missed by a cycle of wheel hop: the two others say it.
        ([(Q, 40.0, 1.0, 0.9), (A, 2.0, 1.1, 0.4), (B, 0.5, 1.0, -0.9)], "plank_drop"),
        # Axles one after the other are a run, whatever moves first.
        ([(A, 2.0, 1.0, -0.9), (A, 2.2, 1.9, -0.9)], "bump_run"),
        # Of all axles with sensors only one fell.
        ([(A, 2.0, 1.0, -0.9), (A, 0.2, 1.9, 0.5)], "plank_drop"),
    ],
)
def test_motion_says_drop_or_run(columns, expected: str) -> None:
    found = kind_of_test(*log(columns))
    assert (found.kind, found.sure) == (expected, False)


def test_a_name_against_the_motion_is_marked() -> None:
    columns = [(Q, 40.0, 1.0, 0.9), (A, 2.0, 1.0, -0.9), (B, 0.5, 1.0, -0.9)]
    agreeing, opposed = (kind_of_test(*log(columns, name)) for name in ("plank/1.csv", "run_10kmh.csv"))
    assert (agreeing.kind, agreeing.sure) == ("plank_drop", True)
    assert (opposed.kind, opposed.sure) == ("bump_run", False)
    assert opposed.why == "its name says a run, its axles move as in a drop"


def test_neither_name_nor_motion() -> None:
    found = kind_of_test(*log([(Q, 40.0, 1.0, 0.1), (A, 2.0, 1.0, 0.1)]))
    assert (found.kind, found.sure) == ("bump_run", False)
    assert found.why == "neither name nor behaviour say what it is"


def test_axles_that_move_all_the_time_are_driven_over_a_road() -> None:
    columns = [(Q, 40.0, 1.0, -0.9), (A, 2.0, 1.0, 0.9), (A, 2.0, 1.9, 0.9)]
    for steady, expected in ((0.6, "road_drive"), (0.14, "bump_run")):
        seen, kinds = log(columns, "run_60kmh.csv")
        seen = replace(seen, looks=tuple(replace(x, steady=steady) for x in seen.looks))
        found = kind_of_test(seen, kinds)
        assert (found.kind, found.sure) == (expected, True)
