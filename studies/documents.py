"""Figures of a study on a page of the docs: what stands between two marks is replaced."""

from __future__ import annotations

import re
from pathlib import Path


def write_between_marks(document: Path, name: str, text: str) -> None:
    """Replace what stands between the lines ``<!-- NAME: begin -->`` and ``<!-- NAME: end -->`` of a page by `text`.

    Raises
    ------
    SystemExit
        If the page has no such lines, with a sentence that names them.
    """
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    page = document.read_text(encoding="utf-8")
    if begin not in page or end not in page:
        raise SystemExit(f"{document} has no place for the figures; put the lines {begin} and {end} there.")
    body = f"{begin}\n{text}\n{end}"
    document.write_text(re.sub(f"{begin}.*{end}", lambda _: body, page, flags=re.S), encoding="utf-8")
