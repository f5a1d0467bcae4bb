"""Bumps by name: their own formulas at a quarter of the length, and sizes that make none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sysid.campaign.records import BumpShape
from sysid.errors import CampaignError
from sysid.road import named_shape

RADIUS = (3.6**2 / 4 + 0.1**2) / 0.2


@pytest.mark.parametrize(
    ("name", "quarter"),
    [
        ("watts", math.sqrt(RADIUS**2 - 0.9**2) - (RADIUS - 0.1)),
        ("sinusoidal", 0.05),
        ("half_sine", 0.1 * math.sin(math.pi / 4)),
        ("parabolic", 0.075),
        ("trapezoid", 0.1 * 0.9 / 1.2),
    ],
)
def test_height_at_a_quarter_of_the_length(name, quarter):
    profile = named_shape(BumpShape(name, 0.1, 3.6))
    middle = profile.start_m + 0.5 * profile.length_m
    assert np.interp(middle, profile.station_m, profile.height_m) == pytest.approx(0.1, abs=1e-5)
    assert np.interp(middle - 0.9, profile.station_m, profile.height_m) == pytest.approx(quarter, abs=2e-4)


def test_flat_top_and_points():
    flat = named_shape(BumpShape("trapezoid", 0.1, 3.6, 2.4))
    points = named_shape(BumpShape("points", station_m=(0.0, 0.6, 3.0, 3.6), heights_m=(0.0, 0.1, 0.1, 0.0)))
    np.testing.assert_allclose(points.height_m, flat.height_m, atol=1e-12)


def test_labels_name_the_size():
    assert BumpShape("watts", 0.1, 3.7).label == "watts 100 mm x 3.7 m"
    assert BumpShape("trapezoid", 0.075, 6.0, 2.0).label == "trapezoid 75 mm x 6 m, top 2 m"
    assert BumpShape("points", station_m=(0.0, 1.0, 2.0)).label == "points, 3 stations"


@pytest.mark.parametrize(
    "shape", [BumpShape("watts"), BumpShape("watts", 3.0, 4.0), BumpShape("trapezoid", 0.1, 1.0, 2.0)]
)
def test_sizes_that_make_no_bump_are_a_sentence(shape):
    with pytest.raises(CampaignError):
        named_shape(shape)
