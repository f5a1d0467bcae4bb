"""Figures of axle loads over a road: what they draw of values made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from sysid import plot
from sysid.plot.svg import svg_file
from sysid.prediction.predicted_passes import PassPrediction, RoadLoads
from sysid.prediction.quantiles import Quantiles


def around(middle) -> Quantiles:
    middle = np.asarray(middle, float)
    return Quantiles(0.9 * middle, middle, 1.1 * middle)


def over_road(
    speed_m_s: float = 20.0, stress: float = 1.2, shape: str = "road class B, 100 m, seed 0"
) -> PassPrediction:
    time = 0.004 * np.arange(1500)
    force = 1e4 * np.array([5.0 + np.sin(10.0 * time), 8.0 + 2.0 * np.cos(8.0 * time)])
    frequency = np.linspace(0.0, 30.0, 241)
    road = RoadLoads(
        load_95_N=around([6e4, 9e4]),
        load_99_N=around([6.2e4, 9.5e4]),
        road_stress=around([1.1, 1.2]),
        vehicle_stress=around([stress]),
        aggregate_95=around([1.5]),
        exponent=4.0,
        length_m=100.0,
        realisations=1,
        roughness_index_mm_m=4.4,
        density_m3=64e-6,
        road_class="B",
        frequency_hz=frequency,
        spectrum_N2_Hz=around(1e6 / (1.0 + frequency**2) * np.array([[1.0], [2.0]])),
        range_levels=np.array([0.1, 0.5, 1.0]),
        tire_ranges_per_km=around([[100.0, 10.0, 0.0], [200.0, 20.0, 1.0]]),
        suspension_ranges_per_km=around([[50.0, 5.0, 0.0], [100.0, 10.0, 1.0]]),
        station_m=np.arange(0.0, 100.0, 0.25),
        aggregate_N=np.ones((400, 3)),
    )
    ratio = np.array([1.2, 1.25])
    return PassPrediction("laden", speed_m_s, time, 0.9 * force, force, 1.1 * force, np.array([5e4, 8e4]), ratio, ratio,
                          ratio, np.zeros(2, bool), shape=shape, road=road)  # fmt: skip


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
