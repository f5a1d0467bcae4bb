"""The parts that all tables of the report are made of: strings with their rounding done, no HTML."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from sysid.results import Results


@dataclass(frozen=True)
class Cell:
    """One table cell: the value, its 90 % interval in brackets, and a word of caution."""

    text: str
    interval: str = ""
    note: str = ""


@dataclass(frozen=True)
class Table:
    """A table: `head` per column, `rows` of a row heading followed by cells; `numeric` marks right-aligned columns."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    numeric: tuple[bool, ...]
    classes: str = ""


def table(
    caption: str, head: Iterable[str], rows: Iterable[Iterable[Any]], text_columns: int = 1, classes: str = ""
) -> Table:
    """A `Table` from plain values; the first `text_columns` columns are left-aligned."""
    columns = tuple(re.sub(r"\[[^]]*\]", lambda unit: unit[0].replace(" ", "\u00a0"), text) for text in head)
    cells = tuple(tuple(c if isinstance(c, Cell) else Cell(str(c)) for c in row) for row in rows)
    return Table(caption, columns, cells, tuple(i >= text_columns for i in range(len(columns))), classes)


def axle_name(results: Results, axle: int, load_case: str | None = None) -> Cell:
    """Heading of a row: the axle's number, and below it its name and load case."""
    name = results.campaign.vehicle.axles[axle].name
    return Cell(f"axle {axle + 1}", note=name + (f", {load_case}" if load_case else ""))
