"""The two tables that answer first: k and c of every axle, and whether the model stands on the scales as the truck."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sysid.display import NOT_DETERMINED
from sysid.estimates.suspension_values import Estimate
from sysid.numbers import MISSING, decimals, fixed, interval, listing
from sysid.report.cells import Cell, Table, axle_name, table
from sysid.results import Results
from sysid.results.headline import PeakLoad, largest_at_any_speed, largest_loads, suspension_rows

if TYPE_CHECKING:
    from sysid.campaign.vehicle_records import LoadCase


def answer_table(results: Results) -> Table | None:
    """k and c of every axle, the most informed value of each with its 90 % interval; None before any estimate."""
    of_axles = suspension_rows(results)
    if not of_axles:
        return None
    pairs = [(row.stiffness, row.damping) for row in of_axles]
    kinds = dict.fromkeys(e.kind for pair in pairs for e in pair if e)
    driven = [load for load in largest_at_any_speed(results, as_driven=True) if load is not None]
    shown = driven or largest_loads(results)
    loads = {load.axle: load for load in shown}
    rows = []
    for row, pair in zip(of_axles, pairs, strict=True):
        # The load of an axle stands in the row of its load case, or in the first.
        load = loads.get(row.axle)
        others = {r.load_case for r in of_axles if r.axle == row.axle}
        if load and load.load_case in others - {row.load_case}:
            load = None
        elif load:
            del loads[row.axle]
        peak = [] if results.predictions is None else [Cell("") if load is None else _peak(load)]
        rows.append([axle_name(results, row.axle, row.load_case), *(_cell(e) for e in pair), *peak])
    caption = f"Per axle, both sides together; brackets: {listing(list(kinds))}"
    if any(load.beyond for load in shown):
        caption += "; * an extrapolation beyond the driven runs"
    if driven:
        caption += ". Peak as driven: the largest at any speed at which nothing goes beyond the driven runs"
    what = "peak as driven [kN]" if driven else "peak load [kN]"
    head = ("axle", "k [kN/m]", "c [kN s/m]", *(() if results.predictions is None else (what,)))
    return table(caption, head, rows, classes="answer-table")


def _peak(load: PeakLoad) -> Cell:
    places = decimals(load.peak_N / 1e3)
    low, high = (None if end is None else end / 1e3 for end in (load.low_N, load.high_N))
    text = fixed(load.peak_N / 1e3, places) + ("*" if load.beyond else "")
    # A row may be of another load case than the pass.
    return Cell(text, interval(low, high, places), f"{load.pass_name}, {load.static_N / 1e3:.1f} static")


def _cell(e: Estimate | None) -> Cell:
    if e is None or not math.isfinite(e.value):
        return Cell(MISSING)
    value, low, high = e.value / 1e3, e.low / 1e3, e.high / 1e3
    places = decimals(value, (high - low) / 2.0)
    if not e.identified:
        return Cell(NOT_DETERMINED, interval(low, high, places), "prior only")
    return Cell(fixed(value, places), interval(low, high, places))


def axle_load_table(results: Results) -> Table | None:
    """Axle loads from the scales and of the simulated truck at rest, as in Table 1 of the paper; None before a pass.

    The simulated load is the vertical tire force at the first instant of a predicted pass, over gravity.
    """
    if results.predictions is None or not results.predictions.passes:
        return None
    at_rest = {p.load_case: p.tire_force_q50_N[:, 0] for p in results.predictions.passes}
    cases = [case for name, case in results.campaign.load_cases.items() if name in at_rest]
    if not cases:
        return None
    gravity = results.campaign.vehicle.gravity_m_s2
    columns: list[np.ndarray] = []
    head = ["axle"]
    for case in cases:
        columns += [_scale_readings(case), at_rest[case.name] / gravity]
        head += [f"{case.name}: scales [kg]", f"{case.name}: model at rest [kg]"]
    rows: list[list[Cell]] = [
        [axle_name(results, i), *(Cell(f"{c[i]:,.0f}") for c in columns)]
        for i in range(len(results.campaign.vehicle.axles))
    ]
    rows.append([Cell("total"), *(Cell(f"{float(np.sum(c)):,.0f}") for c in columns)])
    return table("Axle loads on the scales and of the model at rest", head, rows)


def _scale_readings(case: LoadCase) -> np.ndarray:
    return np.asarray(case.axle_loads_kg, dtype=float)
