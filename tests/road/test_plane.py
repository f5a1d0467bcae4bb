"""Road plane: exact planes, the standard error of a regression, planes that carry a bump."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.road.plane import local_noise_m, refine_plane, search_plane
from sysid.road.road_frame import RoadFrame


def road(points: int, noise: float, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-3, 3, points), rng.uniform(-1.5, 1.5, points)
    return np.column_stack([x, y, 0.4 + 0.02 * x - 0.03 * y + noise * rng.standard_normal(points)])


def test_exact_plane_is_found_exactly() -> None:
    points = road(500, 0.0)
    plane = refine_plane(points, 1e-3, search_plane(points, 1e-3, np.random.default_rng(1)))
    assert (plane.level_m, plane.slope_x, plane.slope_y) == pytest.approx((0.4, 0.02, -0.03), abs=1e-12)


def test_covariance_is_that_of_a_regression_for_independent_noise() -> None:
    ratios = []
    # Uniform over a length L: var(slope) = sigma^2 / (n L^2 / 12); the bisquare loses 5 % of the information.
    expected = 2e-3 / np.sqrt(20_000 * np.array([1.0, 36 / 12, 9 / 12]) * 0.95)
    for seed in range(6):
        points = road(20_000, 2e-3, seed)
        plane = refine_plane(points, 2e-3, search_plane(points, 2e-3, np.random.default_rng(1)))
        ratios.append(np.sqrt(np.diag(plane.covariance)) / expected)
        assert plane.height_sd_m(np.zeros(1), 0.0)[0] == pytest.approx(np.sqrt(plane.covariance[0, 0]))
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.06)


def test_covariance_grows_with_waviness() -> None:
    points = road(20_000, 2e-3)
    wavy = points + np.column_stack([np.zeros((20_000, 2)), 2e-3 * np.sin(2 * np.pi * points[:, 0] / 1.7)])
    smooth, rough = (refine_plane(p, 2e-3, search_plane(p, 2e-3, np.random.default_rng(1))) for p in (points, wavy))
    assert rough.covariance[0, 0] > 2 * smooth.covariance[0, 0]


@pytest.mark.parametrize("raised", [0.3, 0.6, 0.75])
def test_flat_top_above_the_road_is_not_the_road(raised: float) -> None:
    points = road(4000, 1e-3)
    points[np.abs(points[:, 0]) < 3 * raised, 2] += 0.08
    plane = search_plane(points, 1e-3, np.random.default_rng(1))
    assert plane.level_m == pytest.approx(0.4, abs=1e-3)


@pytest.mark.parametrize(("share", "low", "high"), [(0.0, 0.9, 1.15), (0.2, 0.9, 2.5)])
def test_local_noise_with_and_without_stray_points(share: float, low: float, high: float) -> None:
    points = road(5000, 2e-3)
    points[:, 2] += 0.08 * np.cos(np.clip(points[:, 0], -0.45, 0.45) * np.pi / 0.9)
    stray = np.random.default_rng(2).random(5000) < share
    points[stray, 2] += np.random.default_rng(3).uniform(0.05, 0.4, int(stray.sum()))
    assert low < local_noise_m(points) / 2e-3 < high


def test_road_coordinates_are_a_rigid_turn() -> None:
    points = road(50, 0.1)
    plane = search_plane(road(500, 0.0), 1e-3, np.random.default_rng(1))
    frame = RoadFrame(np.array([1.0, 2.0, 3.0]), 0.7, plane)
    turned = np.column_stack(frame.road_coordinates(points))
    np.testing.assert_allclose(
        np.linalg.norm(turned[1:] - turned[0], axis=1), np.linalg.norm(points[1:] - points[0], axis=1), rtol=1e-12
    )
    # A step along the heading in the plan view raises a point on the plane by the grade and leaves its height.
    ahead = np.array([np.cos(0.7), np.sin(0.7), 0.02 * np.cos(0.7) - 0.03 * np.sin(0.7)])
    step = np.column_stack(frame.road_coordinates(np.stack([points[0], points[0] + ahead])))
    np.testing.assert_allclose(step[1] - step[0], [np.linalg.norm(ahead), 0.0, 0.0], atol=1e-12)
