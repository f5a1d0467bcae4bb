"""Figures of passes over bridges, each as a file of its own: worst places and histories, amplification over speed."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.axes import Axes

from sysid import plot
from sysid.export import prediction_files
from sysid.files import write_text
from sysid.numbers import speed
from sysid.plot.style import styled
from sysid.report.drawing import Drawing, Draws, drawn
from sysid.report.figures import Gallery, Picture
from sysid.results import Results
from sysid.results.pass_limits import pass_name
from sysid.results.worst_effects import worst_effects

if TYPE_CHECKING:
    from sysid.prediction.bridge_effects import LoadEffect
    from sysid.prediction.predicted_passes import PassPrediction

#: Load effects of one figure at most.
_SHOWN = 6


def write_bridge_figures(
    passes: Sequence[PassPrediction], axle_x_m: Sequence[float], folder: Path, name: str
) -> tuple[Path, ...]:
    """Write the figures of passes over bridges below the output `folder`, SVG, and return the paths; none without any.

    Parameters
    ----------
    axle_x_m : places of the axles behind axle 1 [m].
    name : begins the names of figures that several passes share.
    """
    figures: dict[str, Draws] = {}
    files = dict(zip(map(id, passes), prediction_files(passes), strict=True))
    courses = dict.fromkeys((p.load_case, p.shape) for p in passes if p.bridge is not None)
    for number, (case, shape) in enumerate(courses):
        over = [p for p in passes if p.bridge is not None and (p.load_case, p.shape) == (case, shape)]
        worst = partial(bridge_figure, over, axle_x_m)
        if len({p.speed_m_s for p in over}) == 1:
            figures[f"{files[id(over[0])].removesuffix('.csv')}_effects.svg"] = worst
            continue
        ending = number + 1 if len(courses) > 1 else ""
        figures[f"predictions/{name}_worst{ending}.svg"] = worst
        figures[f"predictions/{name}_amplification{ending}.svg"] = partial(_amplification, over)
    texts = [drawn(Drawing(draws)) for draws in figures.values()]
    for file, text in zip(figures, texts, strict=True):
        write_text(folder / file, text)
    return tuple(folder / file for file in figures)


def shown_effects(passes: Sequence[PassPrediction]) -> tuple[tuple[PassPrediction, LoadEffect], ...]:
    """Load effects for a figure, each in the pass in which it is at its extreme.

    The strongest of every kind and sense come first, then the others in their order.
    """
    worst = worst_effects(passes)
    strongest: dict[tuple[str, str], LoadEffect] = {}
    for _, e in worst.values():
        known = strongest.get((e.kind, e.sense))
        if known is None or e.size > known.size:
            strongest[e.kind, e.sense] = e
    first = [e.title for e in strongest.values()]
    return tuple(worst[title] for title in dict.fromkeys((*first, *worst)))[:_SHOWN]


def effect_pictures(results: Results, gallery: Gallery) -> list[Picture | None]:
    """Load effects of every predicted pass over a bridge; None for a pass over none."""
    passes = () if results.predictions is None else results.predictions.passes
    x = [axle.x_m for axle in results.campaign.vehicle.axles]
    pictures: list[Picture | None] = []
    for p in passes:
        if p.bridge is None or not p.bridge.effects:
            pictures.append(None)
            continue
        caption = (
            f"{pass_name(p)}: influence lines with the truck where the load effect is at its extreme, and load effects "
            "against time, static and dynamic."
        )
        extremes = "; ".join(f"{e.sense} {e.name}: {e.dynamic.q50[0]:.4g} {e.unit}" for e in p.bridge.effects)
        drawing = partial(bridge_figure, (p,), x)
        pictures.append(gallery.picture(drawing, caption, f"{caption} {plot.label(extremes, 1000)}."))
    return pictures


@styled
def bridge_figure(passes: Sequence[PassPrediction], axle_x_m: Sequence[float]) -> Axes:
    """Influence lines with the vehicle at its worst places beside the histories of these load effects.

    Of several passes over one bridge each load effect is shown at the speed at which it is at its extreme.
    """
    shown = shown_effects(passes)
    axes = plot.figure(9.6, 2.7 * len(shown)).subplots(len(shown), 2, squeeze=False)
    for row, (p, effect) in zip(axes, shown, strict=True):
        assert p.bridge is not None
        plot.influence_line(p.bridge, effect, axle_x_m, row[0])
        plot.effect_history(p.bridge, effect, row[1])
        if len(passes) > 1:
            row[0].set_title(f"{plot.label(effect.name, 36)}, at {speed(p.speed_m_s)}\u00a0km/h")
    one = passes[0]
    title = pass_name(one) if len(passes) == 1 else f"{one.load_case}, {one.shape}: each at its worst speed"
    plot.figure_of(axes).suptitle(plot.label(title, 100), fontsize="medium")
    first: Axes = axes[0, 0]
    return first


@styled
def _amplification(passes: Sequence[PassPrediction]) -> Axes:
    # Of all load effects nobody could tell the curves apart, and a small one is amplified without meaning.
    shown = {e.title for _, e in shown_effects(passes)}
    ax = plot.amplification_against_speed(passes, plot.figure(7.2, 4.2).add_subplot(), shown)
    ax.set_title(plot.label(f"{passes[0].load_case}, {passes[0].shape}", 90))
    return ax
