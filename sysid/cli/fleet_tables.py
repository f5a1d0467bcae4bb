"""The tables and sentences that the commands of `fleet` show."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from sysid.display import TextTable, shown_unit

#: Rows of a table on a terminal; the files have all of them.
MOST_ROWS = 60


def status_blocks(rows: Sequence[Any]) -> list[TextTable | str]:
    """The final table, and a sentence for every campaign without results."""
    from sysid.fleet.status import state_counts

    table = TextTable("Fleet", ("campaign", "truck", "state", "result", "time [s]", "processor [s]", "memory [MB]"))
    for row in rows[:MOST_ROWS]:
        o = row.outcome
        cost = (
            ("-", "-", "-")
            if o is None
            else (f"{o.seconds:.0f}", f"{o.processor_seconds:.0f}", f"{o.peak_bytes / 1e6:.0f}")
        )
        table.add_row(row.campaign, row.truck, row.state, "-" if o is None else o.status or "-", *cost)
    blocks: list[TextTable | str] = [table]
    if len(rows) > MOST_ROWS:
        blocks.append(f"... and {len(rows) - MOST_ROWS} more; all of them are in the files.")
    # Every campaign without results is named, however many there are.
    for row in rows:
        if row.outcome is not None and row.outcome.sentence:
            blocks.append(f"{row.campaign}: {row.state}: {row.outcome.sentence}")
    blocks.append("Campaigns: " + ", ".join(f"{n} {state}" for state, n in state_counts(rows).items()) + ".")
    return blocks


def recalibration_blocks(rows: Sequence[Any], before: Sequence[Any], after: Sequence[Any]) -> list[TextTable | str]:
    """Pareto k of the campaigns that were sampled once more, before and after."""
    old, new = (
        {c: k for p in kinds for c, k in zip(p.campaigns, p.pareto_k, strict=True)} for kinds in (before, after)
    )
    table = TextTable("Sampled once more", ("campaign", "truck", "state", "Pareto k before", "after"))
    for row in rows:
        now = new.get(row.campaign, math.nan)
        table.add_row(row.campaign, row.truck, row.state, f"{old[row.campaign]:.2f}", f"{now:.2f}")
    said = [f"{row.campaign}: {row.state}: {row.outcome.sentence}" for row in rows if row.outcome.sentence]
    return [table, *said]


def population_blocks(
    populations: Sequence[Any], loads: Sequence[Any], remarks: Sequence[str]
) -> list[TextTable | str]:
    """Tables of every type, outliers and loads."""
    from sysid.fleet.loads import pass_words

    blocks: list[TextTable | str] = []
    for p in populations:
        blocks += [_type_table(p), *(_outlier_words(o) for o in p.outliers)]
        if not p.outliers:
            blocks.append("No truck stands out.")
        blocks += [p.message, *p.remarks]
    if loads:
        columns = ("pass", "trucks", "peak load ratio", "90 % of trucks", "between trucks")
        table = TextTable("Axle loads of a truck that nobody has measured", columns)
        for words, x in zip(pass_words(loads)[:MOST_ROWS], loads[:MOST_ROWS], strict=True):
            table.add_row(
                f"{x.type}, {words}",
                str(x.trucks),
                f"{x.q50:.3g}",
                f"{x.q05:.3g} to {x.q95:.3g}",
                f"{100 * x.spread:.2g} %",
            )
        blocks.append(table)
    return [*blocks, *remarks]


def _type_table(p: Any) -> TextTable:
    columns = (
        "parameter",
        "mean",
        "90 % interval",
        "unit",
        "between trucks",
        "repeats",
        "a new truck",
        "more to halve",
    )
    table = TextTable(f"{p.type}: {len(p.truck_names)} trucks, {len(p.campaigns)} campaigns", columns)
    for i, name in enumerate(p.names):
        factor, unit = shown_unit(p.units[i])
        table.add_row(
            name,
            f"{p.mean.q50[i] * factor:.4g}",
            f"{p.mean.q05[i] * factor:.4g} to {p.mean.q95[i] * factor:.4g}",
            unit,
            f"{100.0 * p.spread.q50[i]:.2g} %",
            f"{100.0 * p.scatter.q50[i]:.2g} %" if math.isfinite(p.scatter.q50[i]) else "-",
            f"{p.new.q05[i] * factor:.4g} to {p.new.q95[i] * factor:.4g}",
            f"{p.further[i]:.0f}" if math.isfinite(p.further[i]) else "none",
        )
    return table


def _outlier_words(o: Any) -> str:
    return (
        f"{o.truck}: {o.parameter} is {o.factor:.2f} times that of the other trucks (by chance {o.probability:.1e}); "
        "look at its damper, spring or sensor there."
    )
