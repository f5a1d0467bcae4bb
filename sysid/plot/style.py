"""One look for all figures: settings applied only while a figure of ours is drawn, colours, labels, line thinning."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from functools import cache, wraps
from typing import Any, ParamSpec, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib import font_manager
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec

from sysid.display import shown_unit
from sysid.wording import plain_line

P = ParamSpec("P")
R = TypeVar("R")

# Left, right, bottom, top, between columns, between rows [in].
Margins = tuple[float, float, float, float, float, float]

INK = "#1f2933"
MUTED = "#616e7c"
FAINT = "#cbd2d9"
MEASURED = "#9aa5b1"
WARNING = "#b03a00"

# Okabe and Ito's palette, the yellow left out (too pale for lines on white), then dark colours of Paul Tol's.
_AXLE_COLORS = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#cc79a7",
    "#56b4e9",
    "#e69f00",
    "#000000",
    "#332288",
    "#882255",
    "#999933",
)

# Any: matplotlib's stubs want the literal type of every key.
SETTINGS: Any = {
    "font.family": ["sans-serif"],
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    # Titles stand over their axes, where no labels are: to look for such labels, matplotlib would measure all again.
    "axes.titley": 1.0,
    "axes.labelsize": 9.0,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "axes.unicode_minus": True,
    "grid.color": "#e4e7eb",
    "grid.linewidth": 0.6,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "legend.frameon": True,
    "legend.framealpha": 0.85,
    "legend.edgecolor": "none",
    "legend.borderpad": 0.2,
    "lines.linewidth": 1.1,
    "figure.facecolor": "white",
    "figure.dpi": 100.0,
    "savefig.dpi": 110.0,
    # User text (file, column, axle names) must never be read as mathematics: "$" stays a dollar sign.
    "text.parse_math": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "sysid",
}


def styled(function: Callable[P, R]) -> Callable[P, R]:
    """Run `function` with our settings and leave matplotlib's own as they were."""

    @wraps(function)
    def inside(*args: P.args, **kwargs: P.kwargs) -> R:
        with mpl.rc_context(SETTINGS):
            return function(*args, **kwargs)

    return inside


class ShownFigure(Figure):
    """A figure that a notebook shows where it ends a cell; pyplot does not know of it."""

    def _repr_png_(self) -> bytes:
        stream = io.BytesIO()
        with mpl.rc_context(SETTINGS):
            self.savefig(stream, format="png")
        return stream.getvalue()


@styled
def figure(width_in: float = 6.4, height_in: float = 3.2, margins_in: Margins | None = None) -> Figure:
    """An empty figure on an Agg canvas that no global state knows of; sizes in inches.

    `margins_in` (left, right, bottom, top, between columns, between rows) places the axes without measuring labels:
    on a grid of many axes the automatic layout takes longer than the drawing.
    """
    result = ShownFigure(figsize=(width_in, height_in), layout="constrained" if margins_in is None else None)
    if margins_in is not None:
        left, right, bottom, top, _, _ = margins_in
        result.subplots_adjust(left / width_in, bottom / height_in, 1.0 - right / width_in, 1.0 - top / height_in)
    FigureCanvasAgg(result)
    return result


@styled
def axes_grid(rows: int, columns: int, cell_in: tuple[float, float], margins_in: Margins, **kwargs: Any) -> np.ndarray:
    """A grid (rows, columns) of axes of `cell_in` = (width, height) each, with fixed margins and gaps [in]."""
    _, places = empty_grid(rows, columns, cell_in, margins_in)
    return np.asarray(places.subplots(squeeze=False, **kwargs))


@styled
def empty_grid(rows: int, columns: int, cell_in: tuple[float, float], margins_in: Margins) -> tuple[Figure, GridSpec]:
    """A new figure and the places on it of :func:`axes_grid`, without axes."""
    left, right, bottom, top, gap_x, gap_y = margins_in
    width = left + right + columns * cell_in[0] + (columns - 1) * gap_x
    height = bottom + top + rows * cell_in[1] + (rows - 1) * gap_y
    fig = figure(width, height, margins_in)
    return fig, fig.add_gridspec(rows, columns, wspace=gap_x / cell_in[0], hspace=gap_y / cell_in[1])


@styled
def channel_axes(
    names: Sequence[str],
    draw: Callable[[str, Axes], object],
    x_label: str,
    per_row: int,
    cell_in: tuple[float, float],
    ticks: int,
) -> np.ndarray:
    """A grid (rows, per_row) of axes on one abscissa with one legend; `draw` fills the axes of each name."""
    rows = max(1, -(-len(names) // per_row))
    grid = axes_grid(rows, per_row, cell_in, (0.6, 0.1, 0.45, 0.55, 0.55, 0.34), sharex=True)
    for ax in grid.flat[len(names) :]:
        ax.set_axis_off()
    for ax, name in zip(grid.flat, names, strict=False):
        draw(name, ax)
        ax.set_xlabel("")
        ax.locator_params(nbins=ticks)
    for ax in grid[-1]:
        ax.set_xlabel(x_label)
    shared_legend(grid[0, 0].figure)
    return grid


def outer_labels(grid: np.ndarray, count: int) -> None:
    """Labels of the first `count` axes of a grid only in the first column and below the lowest axes."""
    per_row = grid.shape[1]
    for i, ax in enumerate(grid.flat[:count]):
        if i % per_row:
            ax.set_ylabel("")
        if i < count - per_row:
            ax.set_xlabel("")


def figure_of(ax: Axes | np.ndarray) -> Figure:
    """The figure that `ax`, or an array of axes, belongs to; ValueError if it was removed from its figure."""
    first = ax.flat[0] if isinstance(ax, np.ndarray) else ax
    root = first.get_figure(root=True)
    if root is None:
        raise ValueError("these axes belong to no figure any more; draw into new ones")
    return root


def axes_or_new(ax: Axes | None, width_in: float = 6.4, height_in: float = 3.2) -> Axes:
    """`ax`, or the axes of a new figure where it is None."""
    return figure(width_in, height_in).add_subplot() if ax is None else ax


@styled
def shared_legend(fig: Figure) -> None:
    """One legend above all axes of a figure, every label once, drawn as on the first axes that has it."""
    handles: dict[str, Any] = {}
    for ax in fig.axes:
        for handle, text in zip(*ax.get_legend_handles_labels(), strict=True):
            handles.setdefault(text, handle)
    if handles:
        place: Any = "upper center" if fig.get_layout_engine() is None else "outside upper center"
        fig.legend(list(handles.values()), list(handles), loc=place, ncols=min(len(handles), 8))


def axle_color(axle: int | None) -> str:
    """Colour of an axle (index 0 = axle 1), the same in every figure; grey for None."""
    return MUTED if axle is None else _AXLE_COLORS[axle % len(_AXLE_COLORS)]


def label(text: str, longest: int = 48) -> str:
    """User text for a figure: one line, at most `longest` characters, characters that our font lacks as a box."""
    line = " ".join("".join(c if ord(c) in _glyphs() else "\u25af" for c in plain_line(text)).split())
    return line if len(line) <= longest else line[: longest - 1] + "\u2026"


@cache
def _glyphs() -> frozenset[int]:
    font = font_manager.get_font(font_manager.findfont("DejaVu Sans"))
    return frozenset(font.get_charmap())


def thin(x: np.ndarray, *ys: np.ndarray, most: int = 1500) -> tuple[np.ndarray, ...]:
    """Samples of the curves y(x) to draw, at most about `most`: of every stretch the extremes of the first curve.

    Keeping the extremes keeps the peaks, which plain decimation loses.  Shapes (n,) each; returned with a common index.
    """
    n = len(x)
    if n <= most:
        return (x, *ys)
    stretches = max(most // 2, 1)
    edges = np.linspace(0, n, stretches + 1).astype(int)
    lead = ys[0] if ys else x
    begin = edges[:-1]
    of_stretch = np.repeat(np.arange(stretches), np.diff(edges))
    keep = [np.array([0, n - 1])]
    for extreme in (np.fmin, np.fmax):
        values = extreme.reduceat(lead, begin)
        places = np.flatnonzero(lead == values[of_stretch])
        _, first = np.unique(of_stretch[places], return_index=True)
        # A stretch without any value keeps its first sample.
        keep += [places[first], begin[np.isnan(values)]]
    index = np.unique(np.concatenate(keep))
    return (x[index], *(y[index] for y in ys))


def display(values: np.ndarray, si_unit: str) -> tuple[np.ndarray, str]:
    """Values and unit as people read them: metres as mm, m/s^2 in SI, N as kN, others unchanged."""
    factor, unit = shown_unit(si_unit)
    return np.asarray(values) * factor, unit
