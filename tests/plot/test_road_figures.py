"""Figures of axle loads over a road: what they draw of values made by hand."""

from __future__ import annotations

import numpy as np
import pytest
from road_results import over_road

from sysid import plot
from sysid.plot.svg import svg_file


def test_the_load_along_the_road_lies_where_the_axle_is():
    ax = plot.axle_load_along_road(over_road(), 1, 6.0)
    drawn = next(line for line in ax.lines if line.get_label() == "median")
    place, load = drawn.get_xdata(), drawn.get_ydata()
    assert place.min() >= 0.0
    assert place.max() <= 100.0
    np.testing.assert_allclose(load, 80.0 + 20.0 * np.cos(8.0 * (place + 6.0) / 20.0), atol=1e-6)
    assert next(line for line in ax.lines if line.get_label() == "at rest").get_ydata()[0] == 80.0


def test_logarithmic_axes_have_plain_numbers():
    """Mathematics is not set in our figures."""
    for draw in (plot.load_spectrum, plot.range_pairs):
        ax = draw(over_road().road)
        assert "mathdefault" not in svg_file(plot.figure_of(ax))
        assert "kN\u00b2/Hz" in ax.get_ylabel() or "per km" in ax.get_ylabel()
    spectrum = plot.load_spectrum(over_road().road)
    assert spectrum.lines[1].get_ydata()[0] == pytest.approx(2.0 / (1.0 + 0.125**2))


def test_against_speed_every_road_has_a_curve_and_driven_speeds_are_shaded():
    passes = [
        over_road(v, s, name) for v, s, name in ((20.0, 1.3, "B"), (10.0, 1.1, "B"), (10.0, 1.4, "C"), (20.0, 1.9, "C"))
    ]
    ax = plot.damage_against_speed(passes, (5.0, 12.0))
    curves = {line.get_label(): line for line in ax.lines}
    np.testing.assert_allclose(curves["B"].get_xdata(), [36.0, 72.0])
    np.testing.assert_allclose(curves["B"].get_ydata(), [1.1, 1.3])
    np.testing.assert_allclose(curves["C"].get_ydata(), [1.4, 1.9])
    loads = plot.road_load_against_speed(passes[:2], (5.0, 12.0))
    np.testing.assert_allclose(loads.lines[0].get_ydata(), [60.0, 60.0])
    assert "driven" in [text.get_text() for text in loads.get_legend().get_texts()]
