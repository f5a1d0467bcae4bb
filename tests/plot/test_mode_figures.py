"""Figures of mode shapes show the motion of the mode they are given."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.patches import Circle
from vehicles import example_vehicle

from sysid import plot
from sysid.vehicle_model.vibration_modes import natural_modes


@pytest.fixture(scope="module")
def modes():
    v = example_vehicle("veqmon2d")
    return natural_modes(v.vehicle, v.load_cases["only"], v.behind.stiffness["only"])


def test_every_mode_has_axes_of_its_own(modes):
    grid = plot.mode_shapes(modes, columns=5)
    assert grid.shape == (3, 5)
    assert [ax.has_data() for ax in grid.flat] == [True] * 12 + [False] * 3
    assert "1.4 Hz" in grid[0, 0].get_title(loc="left")


def test_wheels_move_as_in_the_mode(modes):
    """Grey wheels stand on the road; the coloured ones are displaced in proportion to the wheel rise."""
    ax = plot.mode_shape(modes, 10)
    circles = [p for p in ax.patches if isinstance(p, Circle)]
    rest, moved = (np.array([c.center for c in circles[k::2]]) for k in (0, 1))
    np.testing.assert_allclose(rest[:, 1], 0.5)
    np.testing.assert_array_equal(rest[:, 0], moved[:, 0])
    rise = moved[:, 1] - rest[:, 1]
    assert rise[3] == pytest.approx(-rise[5])
    assert np.abs(rise).max() == pytest.approx(0.05 * (22.5 + 2 * 1.4))
    np.testing.assert_allclose(rise / rise[3], modes.wheel_rise[:, 10] / modes.wheel_rise[3, 10], atol=1e-9)
    # The beam of the three axles ends at its outer wheels.
    beam = next(line for line in ax.get_lines()[1::2] if len(line.get_xdata()) == 3)
    np.testing.assert_allclose(beam.get_ydata(), moved[3:6, 1])


def test_bodies_meet_at_the_hinge(modes):
    ax = plot.mode_shape(modes, 1)
    first, second = (line.get_data() for line in ax.get_lines()[1:4:2])
    assert np.interp(3.0, *first) == pytest.approx(np.interp(3.0, *second))
    assert second[0][0] == 3.0
