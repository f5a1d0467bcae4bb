"""The vehicle from the side, drawn to scale, with numbers below every axle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyBboxPatch, Polygon, Rectangle

from sysid.plot.style import INK, MUTED, axle_color, figure, label, styled

if TYPE_CHECKING:
    from sysid.campaign.vehicle_records import Vehicle

#: Outlines say where a body is, not what it looks like: overhangs, heights above the road, length of a cab [m].
_FRONT, _REAR, _DECK, _FRAME, _CAB, _ROOF, _LOAD = 1.3, 1.1, 1.25, 0.24, 1.9, 2.9, 2.4
_PALE, _STEEL = "#eef2f6", "#9aa5b1"
#: Width of the figure, of the heads of the rows, and height of a row [in].
_WIDTH, _HEADS, _ROW = 11.4, 1.15, 0.2
#: Between the road and the rows [in].
_GAP = 0.3


@styled
def truck(
    vehicle: Vehicle,
    rows: Sequence[tuple[str, Sequence[str]]],
    highlight: tuple[int, int] | None = None,
    ax: Axes | None = None,
    hubs: Sequence[str] | None = None,
) -> Axes:
    """The vehicle travelling to the left, its axles at their distances, and below each axle its column of `rows`.

    Parameters
    ----------
    vehicle : positions, wheel radii [m], bodies and hitches; the outlines of bodies are nominal.
    rows : pairs of a head and one text per axle, front to rear; a text may have two lines.
    highlight : row and axle of the text that stands in bold on a shade, None for none.
    ax : axes of a width of their own, as high as :func:`truck_height` says for it.
    hubs : colours of the axles' hubs; None for white.

    Raises
    ------
    ValueError
        If a row has not one text per axle.
    """
    axles = vehicle.axles
    if any(len(texts) != len(axles) for _, texts in rows):
        raise ValueError(f"every row needs one text for each of {len(axles)} axles")
    if ax is None:
        fig = figure(_WIDTH, truck_height(vehicle, rows), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        ax = fig.add_axes((0.0, 0.0, 1.0, 1.0))
    whole = ax.get_figure(root=True)
    assert whole is not None
    width = float(ax.get_position().width * whole.get_size_inches()[0])
    scale = _Scale.of(vehicle, rows, width)
    ax.set_axis_off()
    # Inches from the lower left corner everywhere: the truck is placed by its scale, the text by its lines.
    ax.set_xlim(0.0, width)
    ax.set_ylim(0.0, scale.height)
    per_metre, text_in = scale.per_metre, scale.text_in
    free = width - _HEADS - (scale.right - scale.left) * per_metre

    def x_in(x_m: float) -> float:
        return _HEADS + free / 2.0 + (x_m - scale.left) * per_metre

    def y_in(z_m: float) -> float:
        return text_in + _GAP + z_m * per_metre

    for body, (front, rear) in enumerate(_spans(vehicle)):
        _draw_body(ax, vehicle, body, [x_in(front), x_in(rear)], y_in, per_metre)
    ax.plot([_HEADS, width - 0.05], [y_in(0.0)] * 2, color=INK, lw=1.2)
    for i, axle in enumerate(axles):
        centre = (x_in(axle.x_m), y_in(axle.tire_radius_m))
        _draw_axle(ax, i, *centre, axle.tire_radius_m * per_metre, "white" if hubs is None else hubs[i])
    for a, b in pairwise(axles):
        middle = (x_in(a.x_m) + x_in(b.x_m)) / 2.0
        ax.text(middle, y_in(0.0) - 0.12, f"{b.x_m - a.x_m:.3g} m", ha="center", fontsize=6.5, color=MUTED)
    columns = _HEADS + (width - _HEADS) * (np.arange(len(axles)) + 0.5) / len(axles)
    for i, (axle, column) in enumerate(zip(axles, columns, strict=True)):
        ends = [y_in(0.0) - 0.16, text_in + 0.02]
        ax.plot([x_in(axle.x_m), column], ends, color=axle_color(i), lw=0.9)
    _write_rows(ax, rows, scale.lines, columns, text_in, highlight, width)
    return ax


def truck_height(vehicle: Vehicle, rows: Sequence[tuple[str, Sequence[str]]], width_in: float = _WIDTH) -> float:
    """Height of the drawing with its rows at a given width, [in] both."""
    return _Scale.of(vehicle, rows, width_in).height


@dataclass(frozen=True)
class _Scale:
    """Ends of the vehicle [m], inches per metre, lines of each row, and heights of the text and of all [in]."""

    left: float
    right: float
    per_metre: float
    lines: tuple[int, ...]
    text_in: float
    height: float

    @classmethod
    def of(cls, vehicle: Vehicle, rows: Sequence[tuple[str, Sequence[str]]], width: float) -> _Scale:
        lines = tuple(1 + max((t.count("\n") for t in texts), default=0) for _, texts in rows)
        spans = _spans(vehicle)
        left, right = min(a for a, _ in spans) - 0.1, max(b for _, b in spans) + 0.1
        per_metre = min((width - _HEADS - 0.1) / (right - left), 0.95 * width / _WIDTH)
        text_in = _ROW * sum(lines) + 0.1
        return cls(left, right, per_metre, lines, text_in, (_ROOF + 0.25) * per_metre + _GAP + text_in)


def _spans(vehicle: Vehicle) -> list[tuple[float, float]]:
    """Front and rear end of every body [m]."""
    spans = []
    for index, body in enumerate(vehicle.bodies):
        places = [a.x_m for a in vehicle.axles if a.body == index]
        hitches = [b.hitch_x_m for b in vehicle.bodies[index + 1 : index + 2] if b.hitch_x_m is not None]
        front = min(places, default=0.0) - _FRONT if body.hitch_x_m is None else body.hitch_x_m - 0.5
        rear = max([*places, *([] if not hitches else [hitches[0] - 0.6]), front + 1.0]) + _REAR
        spans.append((front, rear))
    return spans


def _draw_body(
    ax: Axes, vehicle: Vehicle, body: int, ends: list[float], y_in: Callable[[float], float], per_metre: float
) -> None:
    front, rear = ends
    first, last = body == 0, body == len(vehicle.bodies) - 1
    deck = y_in(_DECK)
    cab = _CAB * per_metre if first else 0.0
    if last:
        # What it carries: on a single vehicle behind the cab, on a trailer over its whole length.
        begin = front + cab + 0.15 * per_metre
        ax.add_patch(Rectangle((begin, deck), rear - begin, y_in(_LOAD) - deck, fc=_PALE, ec=_STEEL, lw=0.8, zorder=1))
    ax.add_patch(
        Rectangle((front, deck - _FRAME * per_metre), rear - front, _FRAME * per_metre, fc=_STEEL, ec="none", zorder=2)
    )
    if first:
        roof, slope = y_in(_ROOF), 0.3 * per_metre
        low = y_in(0.55)
        corners = [(front, low), (front, y_in(1.7)), (front + slope, roof), (front + cab, roof), (front + cab, low)]
        ax.add_patch(Polygon(corners, fc="#dfe7f0", ec=INK, lw=0.9, zorder=2))
        window = [
            (front + 0.12 * per_metre, y_in(1.8)),
            (front + 0.12 * per_metre + 0.7 * slope, y_in(2.6)),
            (front + 0.62 * cab, y_in(2.6)),
            (front + 0.62 * cab, y_in(1.8)),
        ]
        ax.add_patch(Polygon(window, fc="white", ec=_STEEL, lw=0.7, zorder=3))


def _draw_axle(ax: Axes, index: int, x: float, centre: float, radius: float, hub: str) -> None:
    color = axle_color(index) if hub == "white" else INK
    ax.add_patch(Circle((x, centre), radius, fc="#3e4c59", ec=INK, lw=0.8, zorder=4))
    ax.add_patch(Circle((x, centre), 0.55 * radius, fc=hub, ec="none", zorder=5))
    ax.text(
        x, centre, str(index + 1), ha="center", va="center_baseline", fontsize=8, weight="bold", color=color, zorder=6
    )


def _write_rows(
    ax: Axes,
    rows: Sequence[tuple[str, Sequence[str]]],
    lines: Sequence[int],
    columns: np.ndarray,
    top: float,
    highlight: tuple[int, int] | None,
    whole: float,
) -> None:
    place = top
    width = (whole - _HEADS) / len(columns)
    if highlight is not None:
        row, axle = highlight
        corner = (columns[axle] - width / 2.0 + 0.04, top - _ROW * sum(lines[: row + 1]))
        ax.add_patch(FancyBboxPatch(corner, width - 0.08, _ROW * lines[row], boxstyle="round,pad=0,rounding_size=0.05",
                                    fc="#fdf3e1", ec="none", zorder=0))  # fmt: skip
    # Letters of 8.5 points take some 13.5 of an inch; smaller ones than 6 points are shortened.
    of_largest = 13.5 * width
    written = [line for _, texts in rows for text in texts for line in text.split("\n")]
    size = float(np.clip(8.5 * of_largest / max(map(len, written), default=1), 6.0, 8.5))
    longest = max(int(of_largest * 8.5 / size), 6)
    for k, ((head, texts), count) in enumerate(zip(rows, lines, strict=True)):
        place -= _ROW * count
        middle = place + _ROW * count / 2.0
        ax.text(0.02, middle, head, va="center", fontsize=8, color=MUTED)
        for i, (text, column) in enumerate(zip(texts, columns, strict=True)):
            words = "\n".join(label(line, longest) for line in text.split("\n"))
            weight = "bold" if (k, i) == highlight else "normal"
            ax.text(column, middle, words, ha="center", va="center", fontsize=size, color=INK, weight=weight)
