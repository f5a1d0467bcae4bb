"""Point follower, tandem cams and the end of a plank: closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.road import contact_laws
from sysid.road.contact_laws import cam_map, point_map
from sysid.road.enveloping import footprint_map
from sysid.road.plank_road import lifted_onto_plank, plank_end, plank_table
from sysid.road.road_profile import RoadProfile

R = 0.5
LOAD_N, STIFFNESS = 30e3, 2.5e6


def cosine_bump(height: float = 0.08, length: float = 2.0) -> RoadProfile:
    station = np.arange(0.0, length + 0.001, 0.002)
    rise = 0.5 * height * (1.0 - np.cos(2.0 * np.pi * station / length))
    return RoadProfile("bump", station, rise, np.zeros_like(rise), 0.0, length)


def test_a_point_follows_the_profile_and_pushes_against_its_slope():
    found = point_map(cosine_bump())
    inside = (found.station_m > 0.05) & (found.station_m < 1.95)
    s = found.station_m[inside]
    assert found.rise_m[inside] == pytest.approx(0.04 * (1.0 - np.cos(np.pi * s)), abs=1e-6)
    assert found.drag[0, inside] == pytest.approx(-0.04 * np.pi * np.sin(np.pi * s), abs=2e-4)
    assert not found.stretch.any()


def test_maps_of_radial_springs_alone_follow_the_estimated_tires():
    """The other laws are geometry: of them the map is given, and nothing has to be tabulated for other tires."""
    follow = {name: kind.follows_tires for name, kind in contact_laws.CONTACT_LAWS.items()}
    assert follow == {"footprint": True, "cams": False, "point": False}


def test_round_cams_over_an_edge(monkeypatch):
    """A circle of radius R at the distance d before an edge of height h stands h - R + sqrt(R^2 - d^2) high."""
    monkeypatch.setattr(contact_laws, "CAM_EXPONENT", 2.0)
    u, h = 0.012, 0.05
    found = cam_map(plank_end(h), R, u)
    spacing = 0.8 * 2.0 * np.sqrt(2 * R * u - u * u)

    def cam(d):
        # The plank lies behind the edge at s = 0; its corner is felt until the circle rests on the road.
        beyond = np.maximum(h - R + np.sqrt(np.maximum(R**2 - d**2, 0.0)), 0.0)
        return np.where(d < 0.0, h, beyond)

    near = np.abs(found.station_m) < 0.4
    front, rear = cam(found.station_m + spacing / 2), cam(found.station_m - spacing / 2)
    assert found.rise_m[near] == pytest.approx((0.5 * (front + rear))[near], abs=2e-3)
    away = near & (np.abs(np.abs(found.station_m) - spacing / 2) > 0.03)
    assert -found.drag[0, away] == pytest.approx(((front - rear) / spacing)[away], abs=0.03)


def test_long_bumps_feel_alike_to_all_contact_laws():
    """Wavelengths far above the footprint are not filtered: 4 m long, all within 1.5 mm."""
    profile = cosine_bump(0.08, 4.0)
    every = [point_map(profile), cam_map(profile, R, LOAD_N / STIFFNESS)]
    station = np.arange(0.2, 3.8, 0.05)
    rises = [np.interp(station, m.station_m, m.rise_m) for m in every]
    assert rises[0] == pytest.approx(rises[1], abs=1.5e-3)


def test_wheel_is_lifted_smoothly_rests_and_rolls_off():
    end = footprint_map(plank_table(0.06, R), LOAD_N, LOAD_N, STIFFNESS)
    lifted = lifted_onto_plank(end, (-9.0, -4.0))
    s, rise = lifted.station_m, lifted.rise_m
    assert rise[0] == 0.0
    assert np.interp(-6.5, s, rise) == pytest.approx(0.03, abs=1e-9)
    assert rise[(s > -4.0) & (s < -0.4)] == pytest.approx(0.06, abs=1e-9)
    assert rise[s > 0.5] == pytest.approx(0.0, abs=1e-9)
    assert np.abs(np.diff(rise[s < -0.5], 3)).max() < 1e-7
    # On the level plank the tire is as flat as on the road.
    assert not lifted.stretch[:, s < -0.5].any()
    assert not lifted.drag[:, s < -0.5].any()
    # Rolling off, the edge pushes the wheel forward.
    assert lifted.drag[0, (s > -0.1) & (s < 0.2)].min() > 0.0


@pytest.mark.parametrize("speed_m_s", [0.5, 0.3, 0.2, 0.1])
def test_a_slow_wheel_is_lifted_as_smoothly(speed_m_s):
    """The ramp of s^4 (35 - 84 s + 70 s^2 - 20 s^3) is at most 35/16 of its mean slope steep, however short it is.

    The wheel is raised for 1.65 s and rests for 2.2 s before the end is felt at 0.15 m.
    """
    end = footprint_map(plank_table(0.06, R), LOAD_N, LOAD_N, STIFFNESS)
    raised = (-speed_m_s * 3.85 - 0.15, -speed_m_s * 2.2 - 0.15)
    lifted = lifted_onto_plank(end, raised)
    s, rise = lifted.station_m, lifted.rise_m
    assert s[0] <= min(end.station_m[0], raised[0])
    assert rise[0] == 0.0
    steps = np.diff(rise[s < -0.16])
    steepest = 35.0 / 16.0 * 0.06 * 0.01 / (raised[1] - raised[0])
    assert steps.min() >= -1e-9
    assert steepest == pytest.approx(steps.max(), rel=0.01)
    assert np.interp(np.mean(raised), s, rise) == pytest.approx(0.03, abs=3e-4)
    # From the rest on the plank on nothing has changed.
    rest = end.station_m > raised[1]
    np.testing.assert_allclose(rise[-end.rise_m.size :][rest], end.rise_m[rest], atol=1e-12)


def test_a_plank_needs_a_height():
    with pytest.raises(ValueError, match="positive height"):
        plank_end(0.0)
