"""Tables of the plank drops, and of frequency and damping as an indicator of worn dampers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from sysid.display import Z90
from sysid.estimates.suspension_values import Quantity
from sysid.numbers import MISSING, decimals, fixed, number, percent
from sysid.plot import SOURCE_LABELS, SOURCES
from sysid.report.cells import Cell, Table, axle_name, table
from sysid.results import Results
from sysid.sdof.drop_results import NOT_ALONE, DropAnalysis, DropEstimate, DropSummary


def pooled_drops_table(results: Results, drops: DropSummary) -> Table:
    """Pooled drop estimates, one row per axle and load case, one column per quantity and method."""
    groups: dict[tuple[int, str], dict[str, DropEstimate]] = {}
    for e in drops.pooled:
        groups.setdefault((e.axle, e.load_case), {})[e.method] = e
    methods = [s for s in SOURCES if any(s in by_method for by_method in groups.values())]
    rubbing = [m for m in methods if any(np.isfinite(e.friction_force) for e in drops.pooled if e.method == m)]
    rows = []
    for (axle, load_case), by_method in sorted(groups.items()):
        cells: list[Any] = [axle_name(results, axle, load_case)]
        reading = by_method.get("paper") or next(iter(by_method.values()))
        cells += [number(reading.damped_period), number(reading.log_decrement)] if reading.usable else [MISSING] * 2
        cells += [_pooled_cell(by_method.get(m), "stiffness") for m in methods]
        cells += [_pooled_cell(by_method.get(m), "damping") for m in methods]
        if rubbing:
            cells += [_friction_cell(by_method.get(m)) for m in rubbing]
        cells.append(reading.damping_kind)
        rows.append(cells)
    head = ["axle", "period τ_d [s]", "decrement δ [-]"]
    head += [f"k {SOURCE_LABELS[m]} [kN/m]" for m in methods] + [f"c {SOURCE_LABELS[m]} [kN s/m]" for m in methods]
    head += [f"F {SOURCE_LABELS[m]} [kN]" for m in rubbing] + ["damping"]
    return table("Plank drops, mean ± standard deviation pooled over the repeats", head, rows)


def pooled_notes(drops: DropSummary) -> list[str]:
    """Notes on the pooled estimates, each once, with the axle it belongs to."""
    notes: dict[tuple[int, str], dict[str, None]] = {}
    for e in drops.pooled:
        for part in filter(None, e.note.split("; ")):
            notes.setdefault((e.axle, e.load_case), {})[part] = None
    return [f"axle {axle + 1}, {case}: {'; '.join(parts)}" for (axle, case), parts in sorted(notes.items())]


def _pooled_cell(e: DropEstimate | None, quantity: Quantity) -> str | Cell:
    if e is None or not e.usable:
        return MISSING
    value, sd = (e.stiffness, e.stiffness_sd) if quantity == "stiffness" else (e.damping, e.damping_sd)
    shown = _plus_minus(value / 1e3, sd / 1e3)
    return Cell(shown, note=NOT_ALONE) if e.caution else shown


def _friction_cell(e: DropEstimate | None) -> str:
    return MISSING if e is None or not e.usable else _plus_minus(e.friction_force / 1e3, e.friction_force_sd / 1e3)


def _plus_minus(value: float, sd: float) -> str:
    if not math.isfinite(value):
        return MISSING
    places = decimals(value, Z90 * sd)
    return fixed(value, places) + (f" ± {number(sd, 2)}" if math.isfinite(sd) else "")


def files_table(drops: DropSummary) -> Table:
    """What peak-picking read off every single drop."""
    rows = []
    for a in drops.files:
        r = a.reading
        rows.append(
            [
                Cell(a.file, note=f"axle {a.axle + 1}, {a.load_case}"),
                f"{int(np.sum(r.used))} of {len(r.used)}",
                _plus_minus(r.damped_period, r.damped_period_se),
                _plus_minus(r.log_decrement, r.log_decrement_se),
                Cell(a.damping_kind, note=_shares(a)),
                Cell("yes" if r.usable else "no", note=r.note),
            ]
        )
    head = ("file", "peaks used", "period ± se [s]", "decrement ± se [-]", "damping looks", "usable")
    return table("Readings of every drop", head, rows)


def _shares(a: DropAnalysis) -> str:
    """Which elements beyond the linear quarter car the record shows, with their probabilities."""
    if a.fit is None:
        return ""
    return ", ".join(f"{name} {percent(p, 2)}" for name, p in a.fit.probability.items() if p > 0.1)


def without_dampers(results: Results) -> frozenset[str]:
    """Files of the drops that were made with the dampers removed."""
    return frozenset(d.log.file for d in results.campaign.plank_drops if not d.dampers)


def indicator_table(results: Results, drops: DropSummary) -> Table:
    """Frequency and damping of the EU 96/53/EC Annex II / VSB 11 test, mean over the usable drops of an axle."""
    rows = []
    groups: dict[tuple[int, str, bool], list[DropAnalysis]] = {}
    bare = without_dampers(results)
    for a in drops.files:
        groups.setdefault((a.axle, a.load_case, a.file in bare), []).append(a)
    for (axle, load_case, removed), files in sorted(groups.items()):
        usable = [a for a in files if a.reading.usable]
        frequency = _mean([a.frequency_hz for a in usable])
        damping = _mean([a.damping_ratio_directive for a in usable])
        rows.append(
            [
                axle_name(results, axle, load_case + (", dampers removed" if removed else "")),
                number(frequency),
                _against(frequency, frequency <= 2.0),
                percent(damping, 3),
                _against(damping, damping > 0.2),
            ]
        )
    head = ("axle", "frequency f [Hz]", "f ≤ 2.0 Hz", "damping D [%]", "D > 20 %")
    return table("Indicator only, not compliance: EU 96/53/EC Annex II and VSB 11", head, rows)


def _mean(values: list[float]) -> float:
    finite = [v for v in values if math.isfinite(v)]
    return sum(finite) / len(finite) if finite else math.nan


def _against(value: float, holds: bool) -> str:
    return MISSING if not math.isfinite(value) else ("yes" if holds else "no")
