"""The table of changes of the code: scores of what was tried now, and lines of the page for other rooms."""

from __future__ import annotations

from studies.mutations.__main__ import behaviour, table

PAGE = """
| `files` | 1 | 1 | 1 | 100 % |
<!-- mutations: begin -->
| room | changes | tried | seen by a test | score |
|---|---:|---:|---:|---:|
| `files` | 327 | 13 | 7 | 54 % |
| `campaign/units` | 9 | 9 | 9 | 100 % |
<!-- mutations: end -->
"""


def test_rooms_that_were_not_tried_keep_their_lines() -> None:
    records = [{"room": "campaign/units", "of": 1200, "survives": n == 0} for n in range(4)]
    files, units = table(records, PAGE).splitlines()[2:]
    assert files == "| `files` | 327 | 13 | 7 | 54 % |"
    assert units == "| `campaign/units` | 1,200 | 4 | 3 | 75 % |"
    assert table(records).splitlines()[2:] == [units]


def test_annotations_are_no_behaviour() -> None:
    assert behaviour("def f(a: int) -> int:\n    return a\n") == behaviour("def f(a: str | None):\n    return a\n")
    assert behaviour("x = 1\n") != behaviour("x = 2\n")
