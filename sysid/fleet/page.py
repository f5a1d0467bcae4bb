"""The report of a fleet: one page of what is known of all trucks together, with links to the campaigns' own reports."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any
from urllib.parse import quote

import numpy as np

from sysid import plot
from sysid.display import shown_unit
from sysid.files import write_text
from sysid.fleet.instruments import InstrumentProblem, instrument_problems
from sysid.fleet.loads import PopulationLoad, pass_words
from sysid.fleet.outcome import FINISHED
from sysid.fleet.population import Quantiles, TypePopulation
from sysid.fleet.results import FleetResults
from sysid.fleet.running import CAMPAIGNS, Row, campaign_output
from sysid.fleet.status import state_counts, write_status
from sysid.fleet.tables import verdict_of
from sysid.fleet.weights import MOST_K
from sysid.folder_lock import writing_to
from sysid.numbers import decimals, fixed, interval, listing, number, percent
from sysid.report.cells import Cell, Table, table
from sysid.report.figures import Gallery, Picture
from sysid.report.skeleton import render_page
from sysid.results.contents import FORBIDDING
from sysid.workflow.versions import versions

PAGE = "fleet.html"
#: Campaigns that the page lists one by one; all of them stand in fleet_status.csv.
MOST_LISTED = 10_000


@dataclass(frozen=True)
class TypePart:
    """One type on the page."""

    name: str
    words: str
    answer: Table
    outliers: tuple[str, ...]
    maps: list[Picture]
    shrinkage: list[Picture]
    trucks: Table
    loads: list[Picture]
    load_table: Table | None
    remarks: tuple[str, ...]


def render_fleet(
    results: FleetResults,
    rows: Sequence[Row],
    problems_of: Sequence[InstrumentProblem] = (),
    verdicts: Mapping[str, tuple[str, str]] = MappingProxyType({}),
) -> str:
    """The page as text; it loads nothing, and what users typed is escaped.

    Parameters
    ----------
    verdicts : of finished campaigns by name, and the first reason of each (:func:`sysid.fleet.tables.verdict_of`).
    """
    gallery = Gallery()
    states = state_counts(rows)
    problems = [row for row in rows if row.state != "done"]
    doubtful = [row for row in rows if verdicts.get(row.campaign, ("", ""))[0] in FORBIDDING]
    careful = [row for row in rows if verdicts.get(row.campaign, ("", ""))[0] == "use_within"]
    preview = any(row.outcome is not None and row.outcome.status == "preview" for row in rows)
    content = {
        "title": results.fleet.title,
        "preview": preview,
        "trucks": len(results.fleet.trucks),
        "campaigns": len(rows),
        "counts": states,
        "types": [_type_part(p, results, gallery) for p in results.populations],
        "said": results.remarks,
        "groups": [
            (caption, _grouped(some, verdicts))
            for caption, some in (
                ("Campaigns that are not done", problems),
                ("Campaigns on whose numbers nobody should bet", doubtful),
                ("Campaigns to use within limits", careful),
            )
            if some
        ],
        "listed": [_listed(row, verdicts) for row in rows[:MOST_LISTED]],
        "unlisted": max(0, len(rows) - MOST_LISTED),
        "pareto": _pareto_table(results.populations),
        "instruments": _instrument_table(problems_of, len(rows)),
        "versions": versions(),
        "figure_numbers": itertools.count(1),
    }
    gallery.draw()
    return render_page("fleet.html", content)


def write_fleet_page(results: FleetResults, rows: Sequence[Row], output: Path) -> Path:
    """Write the page into the folder of the fleet, with the tables of all campaigns that it names.

    Raises
    ------
    OutputError
        If the folder cannot be written.
    """
    verdicts = {row.campaign: verdict_of(row, campaign_output(output, row.campaign)) for row in rows}
    text = render_fleet(results, rows, instrument_problems(rows, output), verdicts)
    write_status(rows, output)
    with writing_to(output):
        write_text(output / PAGE, text)
    return output / PAGE


def _listed(row: Row, verdicts: Mapping[str, tuple[str, str]]) -> dict[str, str]:
    outcome = row.outcome
    trust, reason = verdicts.get(row.campaign, ("", ""))
    link = f"{CAMPAIGNS}/{quote(row.campaign)}/report.html" if row.state in FINISHED else ""
    return {
        "campaign": row.campaign,
        "truck": row.truck,
        "date": row.date,
        "state": row.state,
        "status": "" if outcome is None else outcome.status.replace("_", " "),
        "verdict": trust.replace("_", " "),
        "sentence": reason if outcome is None else outcome.sentence or reason,
        "link": link,
    }


def _grouped(rows: Sequence[Row], verdicts: Mapping[str, tuple[str, str]]) -> list[dict[str, str]]:
    """One line for all campaigns of which the same is said, the largest group first."""
    groups: dict[tuple[str, str, str], list[str]] = {}
    for row in rows:
        line = _listed(row, verdicts)
        groups.setdefault((line["state"], line["verdict"], line["sentence"]), []).append(row.campaign)
    largest = sorted(groups.items(), key=lambda group: -len(group[1]))
    return [
        {"number": str(len(names)), "campaigns": listing(names), "state": state, "verdict": verdict, "sentence": why}
        for (state, verdict, why), names in largest[:MOST_LISTED]
    ]


def _type_part(p: TypePopulation, results: FleetResults, gallery: Gallery) -> TypePart:
    loads = [load for load in results.loads if load.type == p.type]
    out = {(p.truck_names.index(o.truck), p.names.index(o.parameter)) for o in p.outliers}
    return TypePart(
        p.type,
        f"{len(p.truck_names)} trucks, {len(p.campaigns)} campaigns",
        _answer(p),
        tuple(
            f"{o.truck}: {o.parameter} is {o.factor:.2f} times that of the other trucks; by chance a truck is that far "
            f"off with probability {number(o.probability, 2)}."
            for o in p.outliers
        ),
        _maps(p, out, gallery),
        _shrinkage(p, out, gallery),
        _truck_table(p, out, {m.truck for m in results.doubtful}),
        _load_pictures(loads, gallery),
        _load_table(loads),
        (p.message, *p.remarks),
    )


def _cell(q: Quantiles, index: Any, unit: str) -> Cell:
    factor, _ = shown_unit(unit)
    low, middle, high = (float(getattr(q, name)[index]) * factor for name in ("q05", "q50", "q95"))
    if not math.isfinite(middle):
        return Cell("\u2014")
    places = decimals(middle, 0.5 * (high - low))
    return Cell(fixed(middle, places), interval(low, high, places))


def _answer(p: TypePopulation) -> Table:
    rows = []
    for i, name in enumerate(p.names):
        scatter = float(p.scatter.q50[i])
        further = float(p.further[i])
        new = _cell(p.new, i, p.units[i])
        low, high = (percent(float(q[i])) for q in (p.spread.q05, p.spread.q95))
        rows.append(
            [
                Cell(name, note=shown_unit(p.units[i])[1]),
                _cell(p.mean, i, p.units[i]),
                Cell(percent(float(p.spread.q50[i])), f"[{low}, {high}]"),
                Cell(percent(scatter) if math.isfinite(scatter) else "\u2014"),
                Cell(new.interval.strip("[]").replace(", ", " to ")),
                Cell(f"{further:.0f}" if math.isfinite(further) else "none suffices"),
            ]
        )
    head = (
        "parameter", "mean of the type", "between trucks", "repeats of one truck", "90 % of new trucks",
        "further trucks that halve the interval of the mean",
    )  # fmt: skip
    return table("Population; brackets are 90 % intervals", head, rows)


def _pairs(p: TypePopulation) -> list[tuple[int, int]]:
    """Stiffness and damping of one suspension: names k_2[laden] and c_2."""
    pairs = []
    for i, name in enumerate(p.names):
        if p.quantities[i] == "stiffness":
            partner = "c" + name[1:].split("[")[0]
            if partner in p.names:
                pairs.append((i, p.names.index(partner)))
    return pairs


def _maps(p: TypePopulation, out: set[tuple[int, int]], gallery: Gallery) -> list[Picture]:
    pictures = []
    all_trucks = np.stack([p.trucks.q05, p.trucks.q50, p.trucks.q95])
    for i, j in _pairs(p):
        standing = {t for t, parameter in out if parameter in (i, j)}
        axle = int("".join(c for c in p.names[j] if c.isdigit()) or 1) - 1
        new = (np.array([p.new.q05[i], p.new.q95[i]]), np.array([p.new.q05[j], p.new.q95[j]]))
        draws = partial(plot.truck_map, all_trucks[:, :, i], all_trucks[:, :, j], p.truck_names, standing, new, axle)
        caption = f"{p.names[i]} and {p.names[j]} of every truck with 90 % intervals; the box holds 90 % of new trucks"
        caption += ", trucks that stand out are red." if standing else "."
        pictures.append(gallery.picture(draws, caption, width="half"))
    return pictures


def _shrinkage(p: TypePopulation, out: set[tuple[int, int]], gallery: Gallery) -> list[Picture]:
    alone, drawn = (np.stack([q.q05, q.q50, q.q95]) for q in (p.alone, p.trucks))
    draws = partial(plot.shrinkage, alone, drawn, p.mean.q50, p.truck_names, p.names, out)
    caption = "Every truck from its own campaigns (grey) and with what all trucks say (coloured): 90 % intervals."
    if len(p.truck_names) > plot.FLEET_ROWS:
        caption += f" The {plot.FLEET_ROWS} trucks furthest from the mean."
    return [gallery.picture(draws, caption)]


def _truck_table(p: TypePopulation, out: set[tuple[int, int]], doubtful: Collection[str]) -> Table:
    head = ["truck", *(f"{n} [{shown_unit(u)[1]}]" for n, u in zip(p.names, p.units, strict=True))]
    rows = []
    for t, truck in enumerate(p.truck_names[:MOST_LISTED]):
        cells = [_cell(p.trucks, (t, i), p.units[i]) for i in range(len(p.names))]
        marked = [Cell(c.text, c.interval, "stands out") if (t, i) in out else c for i, c in enumerate(cells)]
        rows.append([Cell(truck, note="do not bet" if truck in doubtful else ""), *marked])
    return table("k and c of every truck, drawn towards the population; brackets are 90 % intervals", head, rows)


def _load_pictures(loads: Sequence[PopulationLoad], gallery: Gallery) -> list[Picture]:
    if not loads:
        return []
    ratios = np.array([[x.q05, x.q50, x.q95] for x in loads]).T
    draws = partial(plot.population_loads, pass_words(loads), [x.axle - 1 for x in loads], ratios)
    caption = "Peak dynamic load ratio of trucks that nobody has measured: median and 90 % of them."
    return [gallery.picture(draws, caption)]


def _load_table(loads: Sequence[PopulationLoad]) -> Table | None:
    if not loads:
        return None
    rows = [
        [
            Cell(words),
            Cell(str(x.trucks)),
            Cell(fixed(x.q50, 2), interval(x.q05, x.q95, 2)),
            Cell(percent(x.spread)),
        ]
        for words, x in zip(pass_words(loads), loads, strict=True)
    ]
    head = ("pass", "trucks", "peak dynamic load ratio [-]", "between trucks")
    return table("Axle loads of a new truck; brackets hold 90 % of trucks", head, rows)


def _instrument_table(problems: Sequence[InstrumentProblem], campaigns: int) -> Table | None:
    rows = [
        [
            Cell(p.channel),
            Cell(p.kind.replace("_", " ")),
            Cell(p.message),
            Cell(f"{len(p.campaigns)} of {campaigns}", note=", ".join(p.campaigns[:3])),
            Cell(str(p.records)),
            Cell(str(p.rejected)),
        ]
        for p in problems[:MOST_LISTED]
    ]
    head = ("channel", "sensor", "for example", "campaigns", "records", "rejected")
    return table("Channels that are not good, by instrument", head, rows, 3) if rows else None


def _pareto_table(populations: Sequence[TypePopulation]) -> Table | None:
    rows = [
        [Cell(name), Cell(p.type), Cell(fixed(float(k), 2))]
        for p in populations
        for name, k in zip(p.campaigns, p.pareto_k, strict=True)
        if k > MOST_K
    ]
    return table(f"Campaigns with a Pareto k above {MOST_K}", ("campaign", "type", "k"), rows, 2) if rows else None
