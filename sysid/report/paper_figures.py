"""Counterparts of Table 1 and of Figures 5 to 9 of the paper, each as a file of its own."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from sysid import plot
from sysid.csv_cells import escape_cell
from sysid.export.identity import stamped
from sysid.export.result_json import result_identity
from sysid.files import write_text
from sysid.helper_process import shared_with_helper
from sysid.plot.style import styled
from sysid.report.answer import axle_load_table
from sysid.report.drawing import Drawing, Draws, drawn
from sysid.report.figures import representative_drops, representative_run, run_words
from sysid.results import Results
from sysid.results.pass_limits import pass_name

if TYPE_CHECKING:
    from sysid.estimation.residuals.run_history import RunHistory
    from sysid.prediction.predicted_passes import PassPrediction
    from sysid.road.effective import AxleRoad
    from sysid.road.road_profile import ScanAnalysis


def write_paper_figures(
    results: Results, folder: Path, done: Callable[[float], None] = lambda share: None
) -> list[Path]:
    """Write what the finished stages can show of the paper's tables and figures to `folder`, as SVG and CSV.

    Source: Kwasniewski et al., Dynamic interaction between heavy vehicles and speed bumps; the file names carry the
    paper's numbers.  Figures 1 to 4 and 6a, 6b of the paper show parts of its finite element model and have none here.
    `done` is told the share of the figures that are drawn.
    """
    texts: dict[str, str] = {}
    if (table := axle_load_table(results)) is not None:
        stream = io.StringIO()
        rows = [[cell.text.replace(",", "") for cell in row] for row in table.rows]
        csv.writer(stream, lineterminator="\n").writerows([[escape_cell(text) for text in table.head], *rows])
        texts["table_1_axle_loads.csv"] = stream.getvalue()
    figures: dict[str, Draws] = {}
    for name in list(results.scans)[:1]:
        roads = () if results.estimates is None else results.estimates.roads.get(name, ())
        figures["figure_5_bump.svg"] = partial(_bump, results.scans[name], roads)
    if drops := representative_drops(results):
        figures["figure_6c_plank_drops.svg"] = partial(plot.drops, drops, [f"axle {a.axle + 1}" for a in drops])
    if (history := representative_run(results)) is not None:
        axles = sorted({a for a in history.axles if a is not None})
        for number, axle in (("7_first", axles[:1]), ("8_last", axles[-1:])):
            if axle:
                figures[f"figure_{number}_axle.svg"] = partial(_one_axle, history, axle[0])
    if results.predictions is not None and results.predictions.passes:
        passes = results.predictions.passes
        figures["figure_9a_load_ratio.svg"] = partial(_first_axle, passes, "load")
        forces = tuple(p for p in passes if p.suspension_force_N is not None)
        if forces:
            figures["figure_9b_suspension_force.svg"] = partial(_first_axle, forces, "force")
    svgs = shared_with_helper(drawn, [Drawing(draws) for draws in figures.values()], done)
    texts |= dict(zip(figures, svgs, strict=True))
    identity = result_identity(results)
    for name, text in texts.items():
        write_text(folder / name, stamped(name, text, identity))
    return [folder / name for name in texts]


@styled
def _bump(analysis: ScanAnalysis, roads: Sequence[AxleRoad]) -> Axes:
    """Cloud, smooth profile and what the tires feel of it: Figures 5a, 5b and, for the mesh of 5c, its effect."""
    parts = 3 if analysis.scanned else 2
    axes = plot.figure(6.4, 2.8 * parts).subplots(parts, 1)
    if analysis.scanned:
        plot.scan(analysis, axes[0])
    plot.profile(analysis, axes[-2])
    if roads:
        plot.effective_profile(analysis.profile, roads, axes[-1])
    first: Axes = axes[0]
    return first


@styled
def _one_axle(history: RunHistory, axle: int) -> np.ndarray:
    """Deflection and acceleration of one axle, with the run above."""
    grid = plot.suspension_histories(history, (axle,))
    plot.figure_of(grid).suptitle(plot.label(run_words(history), 100), fontsize="medium")
    return grid


@styled
def _first_axle(passes: tuple[PassPrediction, ...], kind: str) -> Axes:
    """Load ratio or suspension force of axle 1, one below the other for all passes."""
    axes = plot.figure(6.4, 2.6 * len(passes)).subplots(len(passes), 1, squeeze=False)[:, 0]
    for p, ax in zip(passes, axes, strict=True):
        if kind == "load":
            plot.load_ratio(p, 0, ax)
        else:
            plot.suspension_force(p, 0, ax)
        ax.set_title(plot.label(f"axle 1, {pass_name(p)}", 60))
        ax.legend(loc="upper right")
    first: Axes = axes[0]
    return first
