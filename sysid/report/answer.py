"""The two tables that answer first: k and c of every axle, and whether the model stands on the scales as the truck."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sysid.display import NOT_DETERMINED
from sysid.estimates.suspension_values import AxleEstimates, Estimate
from sysid.numbers import MISSING, decimals, fixed, interval, listing
from sysid.report.cells import Cell, Table, axle_name, table
from sysid.results import Results

if TYPE_CHECKING:
    from sysid.campaign.vehicle_records import LoadCase


def answer_table(results: Results) -> Table | None:
    """k and c of every axle, the most informed value of each with its 90 % interval; None before any estimate."""
    stiffness = results.suspension("stiffness")
    damping = results.suspension("damping")
    if not any(row.best for row in (*stiffness, *damping)):
        return None
    several = {row.axle for row in stiffness if sum(r.axle == row.axle for r in stiffness) > 1}
    several |= {row.axle for row in damping if sum(r.axle == row.axle for r in damping) > 1}
    rows: list[list[Cell]] = []
    kinds: dict[str, None] = {}
    for axle in sorted({row.axle for row in (*stiffness, *damping)}):
        of_axle = [r for r in (*stiffness, *damping) if r.axle == axle]
        cases = dict.fromkeys(r.load_case or r.drop_load_case for r in of_axle) if axle in several else {}
        # A value that all load cases share has a row of its own only where there is no other.
        for case in [c for c in cases if c is not None] or (None,):
            pair = [_best(quantity, axle, case) for quantity in (stiffness, damping)]
            if not any(pair):
                continue
            kinds |= dict.fromkeys(e.kind for e in pair if e)
            rows.append([axle_name(results, axle, case), *(_cell(e) for e in pair)])
    caption = f"Per axle, both sides together; brackets: {listing(list(kinds))}"
    return table(caption, ("axle", "k [kN/m]", "c [kN s/m]"), rows, classes="answer-table")


def _best(rows: tuple[AxleEstimates, ...], axle: int, case: str | None) -> Estimate | None:
    """The best estimate of an axle in a load case; one that is shared by all load cases counts in each."""
    of_axle = [r for r in rows if r.axle == axle]
    of_case = [r for r in of_axle if case is not None and case == (r.load_case or r.drop_load_case)]
    shared = [r for r in of_axle if r.load_case is None]
    for row in (*of_case, *shared, *(of_axle if case is None else ())):
        best: Estimate | None = row.best
        if best is not None:
            return best
    return None


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
