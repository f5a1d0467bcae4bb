"""Figures of passes over rough roads, each as a file: the load along the road, spectra, range pairs, against speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.axes import Axes

from sysid import plot
from sysid.export import prediction_files
from sysid.files import write_text
from sysid.plot.style import styled
from sysid.report.drawing import Drawing, Draws, drawn
from sysid.results.pass_limits import pass_name

if TYPE_CHECKING:
    from sysid.prediction.predicted_passes import PassPrediction, RoadLoads


def write_road_figures(
    passes: Sequence[PassPrediction],
    axle_x_m: Sequence[float],
    driven_m_s: Mapping[str, Sequence[float]],
    folder: Path,
    name: str,
) -> tuple[Path, ...]:
    """Write the figures of passes over rough roads below the output `folder`, SVG; none without any.

    Parameters
    ----------
    axle_x_m : places of the axles behind axle 1 [m]; driven_m_s : speeds of the runs by load case [m/s].
    name : begins the names of figures that several passes share.
    """
    figures: dict[str, Draws] = {}
    for p, file in zip(passes, prediction_files(passes), strict=True):
        if p.road is not None:
            figures[f"{file.removesuffix('.csv')}_road.svg"] = partial(road_figure, p, p.road, axle_x_m)
    cases = dict.fromkeys(p.load_case for p in passes if p.road is not None)
    for number, case in enumerate(cases):
        over = [p for p in passes if p.road is not None and p.load_case == case]
        if len({p.speed_m_s for p in over}) > 1:
            speeds = driven_m_s[case]
            driven = (min(speeds), max(speeds)) if speeds else None
            file = f"predictions/{name}_against_speed{number + 1 if len(cases) > 1 else ''}.svg"
            figures[file] = partial(_against_speed, over, driven)
    texts = [drawn(Drawing(draws)) for draws in figures.values()]
    for file, text in zip(figures, texts, strict=True):
        write_text(folder / file, text)
    return tuple(folder / file for file in figures)


@styled
def road_figure(p: PassPrediction, road: RoadLoads, axle_x_m: Sequence[float]) -> Axes:
    """Loads of all axles along the road above their spectra and range pairs."""
    count = len(axle_x_m)
    rows = -(-count // 2)
    fig = plot.figure(9.6, 2.1 * rows + 3.4)
    grid = fig.add_gridspec(rows + 1, 2, height_ratios=[2.1] * rows + [3.2])
    first: Axes | None = None
    for i, x in enumerate(axle_x_m):
        # Most roads have no level of the loads that suits all axles: each has its own.
        ax = fig.add_subplot(grid[i // 2, i % 2], sharex=first)
        plot.axle_load_along_road(p, i, x, ax)
        if i < count - 2:
            ax.set_xlabel("")
        if i == 0:
            ax.legend(loc="lower right", ncols=3)
        first = first or ax
    plot.load_spectrum(road, fig.add_subplot(grid[rows, 0]))
    plot.range_pairs(road, fig.add_subplot(grid[rows, 1]))
    fig.suptitle(plot.label(pass_name(p), 100), fontsize="medium")
    assert first is not None
    return first


@styled
def _against_speed(passes: Sequence[PassPrediction], driven: tuple[float, float] | None) -> Axes:
    """Peak loads over the first road, and the stress factor over all of them, against speed."""
    axes = plot.figure(9.6, 3.8).subplots(1, 2)
    road = passes[0].shape
    first = plot.road_load_against_speed([p for p in passes if p.shape == road], driven, axes[0])
    first.set_title(plot.label(f"{passes[0].load_case}, {road}", 56))
    plot.damage_against_speed(passes, driven, axes[1])
    return first
