"""Files of a comparison: table, figure and page."""

from __future__ import annotations

import json
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sysid import plot
from sysid.comparison.page import render_comparison, row_name
from sysid.comparison.pairs import Comparisons
from sysid.comparison.records import Comparison, row
from sysid.csv_cells import csv_text, escape_cell, number_cell
from sysid.files import write_text
from sysid.folder_lock import writing_to

TABLE_FILE, PAGE_FILE = "comparison.csv", "comparison.html"


def comparison_csv(comparisons: Comparisons) -> str:
    """The text of `comparison.csv`: one row per pair and quantity, SI, ratios as fractions.

    The last columns are the runs from which both results are.
    """
    lines: list[list[str | int]] = []
    head: tuple[str, ...] = ()
    for pair in comparisons.pairs:
        runs = {"first_run": pair.first.identity.run, "second_run": pair.second.identity.run}
        for difference in pair.differences:
            cells = row(pair, difference) | runs
            head = tuple(cells)
            lines.append([_cell(value) for value in cells.values()])
    return csv_text(head, lines)


def _cell(value: object) -> str | int:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return number_cell(value)
    if isinstance(value, int):
        return value
    return "" if value is None else escape_cell(str(value))


def comparison_document(comparisons: Comparisons) -> dict[str, Any]:
    """What `compare --json` prints: pairs with campaigns, differences in SI, shared errors, remarks, agreement."""
    return {
        "schema": 1,
        "pairs": [
            {
                "first": asdict(pair.first),
                "second": asdict(pair.second),
                "one_truck": pair.one_truck,
                "shared": list(pair.shared),
                "remarks": list(pair.remarks),
                "undecided": pair.undecided,
                "differences": [row(pair, d) for d in pair.differences],
                "agreement": [asdict(a) for a in pair.agreement],
            }
            for pair in comparisons.pairs
        ],
    }


def comparison_json(comparisons: Comparisons) -> str:
    """The text of :func:`comparison_document`."""
    return json.dumps(comparison_document(comparisons), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def comparison_figure(pair: Comparison) -> str:
    """The figure of one pair as the text of an SVG file."""
    shown = pair.differences
    change = np.array([d.change for d in shown]).reshape(-1, 3).T
    draw = partial(plot.changes, [row_name(d) for d in shown], change, [d.changed for d in shown])
    return plot.svg_file(plot.figure_of(draw()))


def write_comparison(comparisons: Comparisons, folder: Path) -> tuple[Path, ...]:
    """Write page, table and a figure per pair into `folder`, and return their paths, the page first.

    Raises
    ------
    OutputError
        If the folder cannot be written.
    """
    texts = {PAGE_FILE: render_comparison(comparisons), TABLE_FILE: comparison_csv(comparisons)}
    for number, pair in enumerate(comparisons.pairs, start=1):
        name = "comparison.svg" if len(comparisons.pairs) == 1 else f"comparison_{number}.svg"
        texts[name] = comparison_figure(pair)
    with writing_to(folder):
        for name, text in texts.items():
            write_text(folder / name, text)
    return tuple(folder / name for name in texts)
