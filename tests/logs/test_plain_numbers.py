"""Small texts of plain numbers, which are read without pandas, against pandas and against Python."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.logs import text_numbers
from sysid.logs.text_numbers import WHITE_SPACE, NumberTable, count_rows, read_numbers


def table_of(text: str, columns: int, delimiter: str = ",", blank_rows: bool = True) -> NumberTable:
    names = tuple("abcdef"[:columns])
    return NumberTable(text.encode(), "log", "utf-8", delimiter, ".", 0, names, blank_rows=blank_rows)


def read(table: NumberTable) -> list[list[float]]:
    found = read_numbers(table, dict(enumerate(table.names)), *count_rows(table))
    return np.array([found[name] for name in table.names]).T.tolist()


@pytest.mark.parametrize("digits", [".3f", ".6g", ".15g", ".17g", "e"])
def test_numbers_are_those_that_python_reads(digits: str) -> None:
    rng = np.random.default_rng(3)
    values = rng.standard_normal((400, 3)) * 10.0 ** rng.integers(-9, 9, (400, 3))
    rows = [[f"{v:{digits}}" for v in row] for row in values]
    found = read(table_of("\n".join(map(",".join, rows)) + "\n", 3))
    assert found == [[float(cell) for cell in row] for row in rows]


CASES = {
    "empty cells": ("1,,3\n,5,\n , ,\n7,8,9\n", 3, ",", True),
    "a row cut short": ("1,2,3\n4,5\n7,8,9\n", 3, ",", True),
    "blank rows": ("1,2\n\n3,4\n", 2, ",", True),
    "blank lines that are no rows": ("1,2\n\n3,4\n", 2, ",", False),
    "space around": (" 1, 2 \n+3, -4.5e-3\n", 2, ",", True),
    "beyond all numbers": ("1,2\n1e999,4\n", 2, ",", True),
    "thousands": ("1,2\n1 000,4\n", 2, ",", True),
    "marks of absence": ("1,2\n-,4\nnan,6\n", 2, ",", True),
    "NaN": ("1,2\nNaN,4\n-NaN,6\n", 2, ",", True),
    "semicolons": ("1;2.5\n;4\n", 2, ";", True),
    "tabs": ("1\t2\n\t4\n", 2, "\t", True),
    "white space": ("1 2\n 3   4\n", 2, WHITE_SPACE, True),
    "comments": ("1,2\n# note 3,4\n5,6\n", 2, ",", True),
    "a delimiter at the end": ("1,2,\n3,4,\n", 2, ",", True),
    "returns of a typewriter": ("1,2\r\n3,\r\n", 2, ",", True),
}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_cells_mean_what_they_mean_in_large_files(
    case: tuple[str, int, str, bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    small = read(table_of(*case))
    monkeypatch.setattr(text_numbers, "_SMALL", 0)
    np.testing.assert_array_equal(small, read(table_of(*case)))


def test_cells_without_readings_do_not_move_others() -> None:
    np.testing.assert_array_equal(read(table_of("1,,3\n,5,\n", 3)), [[1.0, np.nan, 3.0], [np.nan, 5.0, np.nan]])
