"""Roads of several parts, and with a bump or a hole: heights by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sysid.campaign.records import BumpShape
from sysid.campaign.roads import RoadCourse, with_obstacle
from sysid.errors import CampaignError
from sysid.road.driven_road import course_heights

RAMP = RoadCourse(10.0, step_m=0.05, height_m=0.01 * np.linspace(0.0, 1.0, 201)[None], source="ramp")
SIDES = RoadCourse(4.0, step_m=0.1, height_m=np.stack([np.full(41, 0.5), np.linspace(0.5, 0.6, 41)]), source="sides")


def test_parts_follow_each_other_without_a_step():
    station, height = course_heights(RoadCourse(14.0, parts=(RAMP, SIDES)), 0)
    assert station[-1] == pytest.approx(14.0)
    assert height.shape == (2, station.size)
    np.testing.assert_allclose(height[0], np.where(station < 10.0, 1e-3 * station, 0.01), atol=1e-12)
    np.testing.assert_allclose(
        height[1], np.where(station < 10.0, 1e-3 * station, 0.01 + (station - 10) / 40), atol=1e-9
    )


@pytest.mark.parametrize("sunken", [False, True])
def test_a_trapezoid_lies_on_the_road_or_is_cut_into_it(sunken):
    shape = BumpShape("trapezoid", 0.05, 2.0, 1.0)
    station, height = course_heights(with_obstacle(RAMP, shape, 3.0, sunken, "here"), 0)
    exact = np.interp(station, [3.0, 3.5, 4.5, 5.0], [0.0, 0.05, 0.05, 0.0]) * (-1.0 if sunken else 1.0)
    np.testing.assert_allclose(height[0], 1e-3 * station + exact, atol=3e-4)
    assert np.abs(height[0] - 1e-3 * station).max() > 0.049


def test_an_obstacle_beyond_the_end_is_refused():
    with pytest.raises(CampaignError, match="does not lie on a road of 10 m"):
        with_obstacle(RAMP, BumpShape("watts", 0.05, 2.0), 8.5, False, "here")


def test_realisations_of_parts_differ_where_they_are_of_a_class():
    road = RoadCourse(24.0, parts=(RoadCourse(10.0, "B", 3), replace(RAMP)), realisations=2)
    first, second = (course_heights(road, k)[1] for k in (0, 1))
    alone = course_heights(RoadCourse(10.0, "B", 4), 0)[1]
    np.testing.assert_allclose(second[:, :300] - second[:, :1], alone[:, :300] - alone[:, :1], atol=1e-12)
    assert np.abs(first - second).max() > 1e-3
