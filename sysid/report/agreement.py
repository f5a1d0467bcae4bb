"""Tables of the agreement between simulated and measured histories."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable
from typing import TYPE_CHECKING

from sysid.numbers import MISSING, fixed, percent
from sysid.report.cells import Cell, Table, table
from sysid.results.judgement import is_misfit
from sysid.validation.channel_agreement import channel_median

if TYPE_CHECKING:
    from sysid.validation.channel_agreement import ChannelAgreement, LeftOut, Validation

_KINDS = {
    "suspension_deflection": "deflection",
    "axle_acceleration": "axle acceleration",
    "body_acceleration": "body acceleration",
    "pitch_rate": "pitch rate",
    "bellows_extension": "extension of bellows",
}


def summary_table(validation: Validation, run_names: dict[str, str]) -> Table:
    """One row per run; per kind of channel the median (worst) NRMSE and the median residual over noise."""
    kinds = list(dict.fromkeys(row.kind for row in validation.channels))
    rows = []
    for run in dict.fromkeys(row.run for row in validation.channels):
        cells: list[Cell] = [Cell(run_names.get(run, run))]
        for kind in kinds:
            members = [m for m in validation.channels if (m.run, m.kind) == (run, kind)]
            errors = [m.nrmse for m in members if math.isfinite(m.nrmse)]
            worst = f" ({percent(max(errors))})" if errors else ""
            cells.append(Cell(percent(channel_median(members, "nrmse")) + worst))
            cells.append(Cell(_ratio(channel_median(members, "residual_over_noise"))))
        rows.append(cells)
    head = ["run"]
    for kind in kinds:
        head += [f"{_KINDS.get(kind, kind)}: NRMSE median (worst)", "residual / noise [-]"]
    return table("Agreement per run and kind of channel", head, rows)


def ratings_table(validation: Validation) -> Table:
    """One row per kind of channel over all runs: medians, and the worst of what has a limit."""
    limits = validation.limits
    rows: list[list[Cell]] = []
    for kind in dict.fromkeys(row.kind for row in validation.channels):
        members = [m for m in validation.channels if m.kind == kind]
        frequency = [abs(m.simulated_frequency_hz - m.measured_frequency_hz) for m in members]
        outside = sum(bool(limits.exceeded(m)) for m in members)
        rows.append(
            [
                Cell(_KINDS.get(kind, kind)),
                _spread([m.iso18571 for m in members], min, lambda v: fixed(v, 2)),
                _spread([abs(m.sprague_geers_magnitude) for m in members], max, percent),
                _spread([m.sprague_geers_phase for m in members], max, percent),
                _spread([abs(m.peak_error) for m in members], max, percent),
                _spread([1e3 * abs(m.peak_time_error_s) for m in members], max, lambda v: fixed(v, 0)),
                _spread([m.fit_percent for m in members], min, lambda v: fixed(v, 1)),
                _spread(frequency, max, lambda v: fixed(v, 2)),
                Cell(f"{outside} of {len(members)}"),
            ]
        )
    head = (
        "channels",
        f"ISO/TS 18571 rating R (limit {limits.iso18571:g})",
        f"Sprague-Geers magnitude (limit {percent(limits.sprague_geers_magnitude)})",
        f"Sprague-Geers phase (limit {percent(limits.sprague_geers_phase)})",
        f"peak error (limit {percent(limits.peak_error)})",
        "instant of the peak [ms]",
        "fit [%]",
        "dominant frequency off by [Hz]",
        "outside a limit",
    )
    return table("Ratings over all runs: median (worst)", head, rows)


def left_out_table(left_out: LeftOut, run_names: dict[str, str]) -> Table:
    """One row per run that was predicted by a fit without it: medians over its channels, in and out of sample."""
    rows: list[list[Cell]] = []
    for left in left_out.runs:
        fitted = [c for c in left_out.in_sample if c.run == left.run]
        cells = [Cell(run_names.get(left.run, left.run))]
        for name, text in (("residual_over_noise", _ratio), ("nrmse", percent), ("iso18571", lambda v: fixed(v, 2))):
            for members in (fitted, left.channels):
                cells.append(Cell(text(channel_median(members, name))))
        most = max(range(len(left_out.names)), key=lambda i: abs(left.shift_sd[i]))
        cells.append(Cell(f"{left_out.names[most]} by {left.shift_sd[most]:+.1f} sd"))
        rows.append(cells)
    head = ["run"]
    for name in ("residual / noise [-]", "NRMSE", "ISO/TS 18571 rating R"):
        head += [f"{name}: fitted", f"{name}: out of sample"]
    return table("Runs predicted by a fit of all others, medians over channels", [*head, "parameter moved most"], rows)


def _spread(values: list[float], worst: Callable[[list[float]], float], text: Callable[[float], str]) -> Cell:
    finite = [v for v in values if math.isfinite(v)]
    return Cell(f"{text(statistics.median(finite))} ({text(worst(finite))})" if finite else MISSING)


def matrix_table(
    validation: Validation, run_names: dict[str, str], caption: str, cell: Callable[[ChannelAgreement], str]
) -> Table:
    """One row per channel, one column per run."""
    runs = list(dict.fromkeys(row.run for row in validation.channels))
    columns = list(dict.fromkeys(row.column for row in validation.channels))
    by_channel = {(row.run, row.column): row for row in validation.channels}
    rows = []
    for column in columns:
        cells = [cell(by_channel[run, column]) if (run, column) in by_channel else "\u2014" for run in runs]
        rows.append([Cell(column), *cells])
    return table(caption, ("channel", *(run_names.get(r, r) for r in runs)), rows, classes="matrix")


def nrmse_cell(row: ChannelAgreement) -> str:
    """NRMSE in percent."""
    return percent(row.nrmse)


def rating_cell(row: ChannelAgreement) -> str:
    """Objective rating of ISO/TS 18571."""
    return fixed(row.iso18571, 3)


def noise_cell(row: ChannelAgreement) -> str:
    """Residual over noise, marked where it shows a misfit."""
    return _ratio(row.residual_over_noise)


def _ratio(value: float) -> str:
    mark = "\u25b2\u00a0" if is_misfit(value) else ""
    return mark + fixed(value, 2)
