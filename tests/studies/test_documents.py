"""Figures of a study between the marks of a page: what stands around them stays."""

from __future__ import annotations

import pytest

from studies.documents import write_between_marks


def test_only_what_stands_between_the_marks_is_replaced(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- one: begin -->\nold\nlines\n<!-- one: end -->\nafter\n<!-- two: begin -->x", "utf-8")
    # A backslash is no command of a pattern.
    write_between_marks(page, "one", r"new \1")
    expected = "before\n<!-- one: begin -->\nnew \\1\n<!-- one: end -->\nafter\n<!-- two: begin -->x"
    assert page.read_text("utf-8") == expected
    with pytest.raises(SystemExit, match=r"page.md has no place for the figures; put the lines <!-- two: begin -->"):
        write_between_marks(page, "two", "lost")
    assert page.read_text("utf-8") == expected
