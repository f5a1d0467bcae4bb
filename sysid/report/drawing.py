"""Figures that are drawn later, some of them by a helper process: what to draw, from what, and as what."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import numpy as np
from matplotlib.axes import Axes

from sysid import plot

#: Draws new axes from results: a function of a module, and what it takes.
Draws: TypeAlias = "partial[Axes] | partial[np.ndarray]"


@dataclass(frozen=True)
class Drawing:
    """A figure as an SVG element whose identifiers begin with `prefix`, `description` for those who cannot see it.

    Without a prefix it is an SVG file of its own.
    """

    draws: Draws
    prefix: str = ""
    description: str = ""


def drawn(drawing: Drawing) -> str:
    """The SVG of a drawing."""
    figure = plot.figure_of(drawing.draws())
    return plot.svg_element(figure, drawing.prefix, drawing.description) if drawing.prefix else plot.svg_file(figure)
