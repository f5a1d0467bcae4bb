"""The page of a comparison, and the words for its rows that page and terminal share."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from sysid import plot
from sysid.comparison.differences import ERROR_RATE
from sysid.comparison.pairs import Comparisons
from sysid.comparison.records import FAMILIES, Campaign, Comparison, Difference, Family
from sysid.display import shown_unit
from sysid.numbers import MISSING, count, decimals, fixed, interval, listing
from sysid.report.cells import Cell, Table, table
from sysid.report.figures import Gallery, Picture
from sysid.report.skeleton import render_page
from sysid.workflow.versions import versions

HEADINGS: dict[Family, str] = {
    "suspension": "k, c and other values of the suspensions, both sides",
    "static loads": "Axle loads at rest",
    "peak loads": "Largest axle loads of predicted passes",
    "tires": "Tires",
}

#: Table of runs that the trucks of both campaigns drive.
AGREEMENT = "Residual over noise of every run, medians over its channels"
AGREEMENT_COLUMNS = ("run", "by its own truck", "by the other's")


@dataclass(frozen=True)
class PairPart:
    """One pair on the page."""

    title: str
    answer: str
    shared: str
    remarks: tuple[str, ...]
    pictures: list[Picture]
    tables: list[Table]
    agreement: Table | None


def answer(pair: Comparison) -> str:
    """What has changed, in a sentence."""
    tested = [d for d in pair.differences if d.p_adjusted is not None and d.family == "suspension"]
    if not tested and pair.of("suspension"):
        return f"Undecided: {pair.undecided}."
    if not tested:
        return "Nothing of the suspensions could be compared."
    found = [f"{row_name(d)} {change_words(d)}" for d in pair.changed if d.family == "suspension"]
    if found:
        return f"{'Changed' if pair.one_truck else 'Different'}: {listing(found)}."
    seen = sorted(d.least_seen for d in tested if d.least_seen is not None)
    verb = "has changed" if pair.one_truck else "differs"
    return (
        f"Nothing of the suspensions {verb} as far as these campaigns can tell; a change of {100.0 * seen[0]:.2g} % "
        f"({_least_named(tested)}) to {100.0 * seen[-1]:.2g} % would have been seen."
    )


def _least_named(tested: list[Difference]) -> str:
    return min(tested, key=lambda d: d.least_seen or math.inf).name


def row_name(d: Difference) -> str:
    """Name of a row: that of the parameter, with both load cases where they differ."""
    first, second = d.load_cases
    return d.name if first == second or d.family != "suspension" else f"{d.name} / [{second}]"


def change_words(d: Difference) -> str:
    """The change in percent with its 90 % interval."""
    middle, low, high = d.change
    if d.log_sd == 0.0:
        return "the same reading" if d.log_ratio == 0.0 else f"{_signed(middle)} %"
    return f"{_signed(middle)} % ({_signed(low)}, {_signed(high)})"


def _signed(fraction: float) -> str:
    percent = 100.0 * fraction
    places = 1 if abs(percent) < 100.0 else 0
    text = fixed(percent, places)
    return f"+{text}" if percent > 0.0 and float(f"{percent:.{places}f}") != 0.0 else text


def value_words(d: Difference) -> tuple[str, str]:
    """Both values in the unit that people read, each with half of its 90 % interval."""
    factor, _ = shown_unit(d.unit)
    words = []
    for middle, low, high in (d.first, d.second):
        half = 0.5 * (high - low) * factor
        places = decimals(middle * factor, half)
        words.append(f"{fixed(middle * factor, places)} ± {fixed(half, places)}")
    return words[0], words[1]


def higher_words(d: Difference) -> str:
    """The probability that the second value is higher than the first."""
    if d.log_sd == 0.0:
        return MISSING
    percent = 100.0 * d.probability_larger
    if percent < 0.1 or percent > 99.9:
        return "< 0.1 %" if percent < 50.0 else "> 99.9 %"
    return f"{percent:.1f} %" if not 1.0 <= percent <= 99.0 else f"{percent:.0f} %"


def verdict_words(pair: Comparison, d: Difference) -> str:
    """Whether it has changed; where nobody decides, a dash."""
    if d.changed:
        return "changed" if pair.one_truck else "different"
    return MISSING if d.p_adjusted is None else "no"


def campaign_words(c: Campaign) -> str:
    """Title, vehicle, date and place of a campaign."""
    said = [c.title, c.test.get("vehicle_id") or c.vehicle, c.test.get("date"), c.test.get("place")]
    return " · ".join(s for s in said if s)


def shared_words(pair: Comparison) -> str:
    """Which errors cancel."""
    if not pair.shared:
        return "No error is shared, so that none cancels in the differences."
    return f"Errors that both campaigns share cancel in the differences: {listing(list(pair.shared), 10)}."


def render_comparison(comparisons: Comparisons) -> str:
    """The page as text; it loads nothing, and what users typed is escaped."""
    gallery = Gallery()
    pairs = comparisons.pairs
    campaigns = [pairs[0].first, *(pair.second for pair in pairs)]
    content: dict[str, Any] = {
        "title": f"{pairs[0].first.label} and {listing([p.second.label for p in pairs])}",
        "preview": any(c.status == "preview" for c in campaigns),
        "subject": count(len(campaigns), "campaign"),
        "pairs": [_part(pair, gallery) for pair in pairs],
        "campaigns": _campaign_table(campaigns),
        "rate": f"{100.0 * ERROR_RATE:g} %",
        "versions": versions(),
        "figure_numbers": itertools.count(1),
    }
    gallery.draw()
    return render_page("comparison.html", content)


def _part(pair: Comparison, gallery: Gallery) -> PairPart:
    shown = [d for d in pair.differences if d.family != "tires"]
    pictures = []
    if shown:
        change = np.array([d.change for d in shown]).T
        draws = partial(plot.changes, [row_name(d) for d in shown], change, [d.changed for d in shown])
        caption = (
            f"Change from {pair.first.label} to {pair.second.label}, 90 % intervals; what has changed is red and bold."
        )
        pictures.append(gallery.picture(draws, caption))
    return PairPart(
        f"{pair.second.label} against {pair.first.label}",
        answer(pair),
        shared_words(pair),
        pair.remarks,
        pictures,
        [_table(pair, family) for family in FAMILIES if pair.of(family)],
        _agreement_table(pair),
    )


def _table(pair: Comparison, family: Family) -> Table:
    rows = []
    for d in pair.of(family):
        first, second = value_words(d)
        middle, low, high = (100.0 * x for x in d.change)
        places = 1 if abs(middle) < 100.0 else 0
        same = d.log_sd == 0.0 and d.log_ratio == 0.0
        rows.append(
            [
                Cell(row_name(d), note=shown_unit(d.unit)[1]),
                Cell(first),
                Cell(second),
                Cell(
                    "the same reading" if same else fixed(middle, places), "" if same else interval(low, high, places)
                ),
                Cell(higher_words(d)),
                Cell(MISSING if d.least_seen is None else f"{100.0 * d.least_seen:.2g} %"),
                Cell(verdict_words(pair, d)),
            ]
        )
    head = ("quantity", pair.first.label, pair.second.label, "change %", "higher", "least seen", "changed")
    return table(HEADINGS[family], head, rows)


def _agreement_table(pair: Comparison) -> Table | None:
    if not pair.agreement:
        return None
    rows = [[Cell(a.run, note=a.recorded_by), Cell(fixed(a.own, 2)), Cell(fixed(a.other, 2))] for a in pair.agreement]
    return table(AGREEMENT, AGREEMENT_COLUMNS, rows)


def _campaign_table(campaigns: list[Campaign]) -> Table:
    rows = [
        [
            Cell(c.label),
            Cell(campaign_words(c)),
            Cell(c.status.replace("_", " ")),
            Cell((c.trust or MISSING).replace("_", " ")),
            Cell(c.identity.run, note=c.identity.date),
            Cell(c.identity.result_sha256[:16]),
        ]
        for c in campaigns
    ]
    return table("Campaigns", ("folder", "what", "status", "verdict", "run", "sha256 of the result"), rows, 6)
