"""The road plane under a bump: local noise, robust search, refinement with an honest covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import gammaincinv

from sysid.arrays import PointsByXyz

# Lasers and asphalt together are never better than this; it keeps perfect synthetic clouds away from a zero scale.
NOISE_FLOOR_M = 5e-5
#: Waviness of a road about its plane (an assumption).
_ROAD_TOLERANCE_M = 0.003
#: Planes that are tried, each through three points.
_DRAWS = 1200
#: Side of the cells whose points share the waviness of the road.
_CELL_M = 0.25
#: Tukey's bisquare with 95 % efficiency for normal errors (P. W. Holland and R. E. Welsch, Communications in Statistics
#: A6 (1977) 813-827, doi:10.1080/03610927708827533).
_BISQUARE = 4.685
#: Neighbours of a point that tell the noise, and the quantile of their scatter that is read; edges raise higher ones.
_NEIGHBOURS = 6
_LOWER_FIFTH = 0.2


@dataclass(frozen=True)
class RoadPlane:
    """Plane z = `level_m` + `slope_x` x + `slope_y` y, with the covariance (3, 3) of (level, slope_x, slope_y).

    The covariance counts cells of the road rather than points, so waviness of the road widens it.
    """

    level_m: float
    slope_x: float
    slope_y: float
    covariance: np.ndarray

    def height_m(self, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
        """Return the plane's z [m] at x, y [m] (any equal shapes)."""
        return self.level_m + self.slope_x * x_m + self.slope_y * y_m

    def height_sd_m(self, x_m: np.ndarray, y_m: np.ndarray | float) -> np.ndarray:
        """Return the standard error [m] of the plane's z at x, y [m]."""
        design = np.stack(np.broadcast_arrays(np.ones_like(x_m), x_m, y_m), axis=-1)
        return np.asarray(np.sqrt(np.maximum(np.einsum("...i,ij,...j->...", design, self.covariance, design), 0.0)))


def local_noise_m(points_m: PointsByXyz) -> float:
    """Return the noise of the heights [m]: the scatter about small planes through neighbouring points.

    `points_m` (n, 3) [m].  The lower fifth of all neighbourhoods decides, so that curved and stray ones do not enter:
    where every fifth point is a stray one the result is twice the noise, not a hundred times.
    """
    count = points_m.shape[0]
    k = _NEIGHBOURS
    tree = cKDTree(points_m[:, :2])
    seeds = points_m[:: max(1, count // 800)]
    _, index = tree.query(seeds[:, :2], k=k)
    group = points_m[index]
    offset = group - group.mean(axis=1, keepdims=True)
    # The ridge only matters where all neighbours lie on one line.
    xy = offset[:, :, :2]
    normal = np.einsum("gki,gkj->gij", xy, xy)
    normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(2) + 1e-300 * np.eye(2)
    slope = np.linalg.solve(normal, np.einsum("gki,gk->gi", xy, offset[:, :, 2])[..., None])[..., 0]
    residual = offset[:, :, 2] - np.einsum("gki,gi->gk", xy, slope)
    squares = np.quantile(np.sum(residual**2, axis=1), _LOWER_FIFTH)
    # Quantile of chi^2 with k - 3 degrees of freedom.
    of_chi2 = 2.0 * gammaincinv(0.5 * (k - 3), _LOWER_FIFTH)
    return max(float(np.sqrt(squares / of_chi2)), NOISE_FLOOR_M)


def search_plane(points_m: PointsByXyz, noise_m: float, rng: np.random.Generator) -> RoadPlane:
    """Find the plane that carries most points and has hardly any below it (RANSAC with a one-sided score).

    A bump lies above its road: a plane through the flat top of a hump, or through one of its ramps, has road points
    below it and is marked down for them.  `points_m` (n, 3) [m], `noise_m` from :func:`local_noise_m`.  The covariance
    of the result is zero; :func:`refine_plane` gives the real one.
    Source: M. A. Fischler and R. C. Bolles, Communications of the ACM 24 (1981) 381-395, doi:10.1145/358669.358692.
    """
    x, y, z = points_m.T
    tolerance = max(3 * noise_m, _ROAD_TOLERANCE_M)
    triple = points_m[rng.integers(0, points_m.shape[0], size=(_DRAWS, 3))]
    design = np.concatenate([np.ones((_DRAWS, 3, 1)), triple[:, :, :2]], axis=2)
    spread = np.abs(np.linalg.det(design))
    usable = spread > np.quantile(spread, 0.3)
    parameters = np.linalg.solve(design[usable & (spread > 0)], triple[usable & (spread > 0)][:, :, 2:])[..., 0]
    best, best_score = np.array([np.median(z), 0.0, 0.0]), -float("inf")
    for candidate in parameters:
        residual = z - (candidate[0] + candidate[1] * x + candidate[2] * y)
        score = float(np.sum(np.abs(residual) < tolerance) - 3 * np.sum(residual < -2 * tolerance))
        if score > best_score:
            best, best_score = candidate, score
    plane = _plane_of(best, np.zeros((3, 3)))
    for _ in range(3):
        near = np.abs(z - plane.height_m(x, y)) < tolerance
        if np.count_nonzero(near) < 4:
            break
        solution = np.linalg.lstsq(np.column_stack([np.ones(near.sum()), x[near], y[near]]), z[near], rcond=None)[0]
        plane = _plane_of(solution, np.zeros((3, 3)))
    return plane


def refine_plane(points_m: PointsByXyz, noise_m: float, start: RoadPlane) -> RoadPlane:
    """Fit the plane to the points of the flat road by Tukey's bisquare, starting from `start`.

    `points_m` (n, 3) [m] must not hold the bump.  The covariance is the cluster-robust one over square cells of
    `_CELL_M`: neighbouring points share the waviness of the road and do not count as independent.
    """
    x, y, z = points_m.T
    design = np.column_stack([np.ones_like(x), x, y])
    solution = np.array([start.level_m, start.slope_x, start.slope_y])
    residual = z - design @ solution
    # The first plane can be off by more than the noise at the ends of the road, so the net is narrowed step by step.
    scale = max(3 * noise_m, _ROAD_TOLERANCE_M)
    weight = np.ones_like(z)
    for _ in range(12):
        weight = np.clip(1 - (residual / (_BISQUARE * scale)) ** 2, 0.0, None) ** 2
        if np.count_nonzero(weight) < 4:
            return start
        weighted = design * weight[:, None]
        try:
            update = np.linalg.solve(weighted.T @ design, weighted.T @ z)
        except np.linalg.LinAlgError:  # what is left of the road lies on one line
            return start
        change = float(np.max(np.abs(design[[0, -1]] @ (update - solution))))
        solution, residual = update, z - design @ update
        scale = max(1.4826 * float(np.median(np.abs(residual[weight > 0]))), NOISE_FLOOR_M)
        if change < 1e-8:
            break
    # Sandwich of an M-estimator: scores outside, the derivative of the score inside.
    ratio = (residual / (_BISQUARE * scale)) ** 2
    slope = np.where(ratio < 1, (1 - ratio) * (1 - 5 * ratio), 0.0)
    return _plane_of(solution, _cell_covariance(design, weight * residual, slope))


def _plane_of(parameters: np.ndarray, covariance: np.ndarray) -> RoadPlane:
    level, slope_x, slope_y = (float(value) for value in parameters)
    return RoadPlane(level, slope_x, slope_y, covariance)


def _cell_covariance(design: np.ndarray, influence: np.ndarray, slope: np.ndarray) -> np.ndarray:
    cell = np.floor(design[:, 1:] / _CELL_M).astype(np.int64)
    cell -= cell.min(axis=0)
    label = np.unique(cell[:, 0] * (cell[:, 1].max() + 1) + cell[:, 1], return_inverse=True)[1]
    score = np.column_stack([np.bincount(label, weights=influence * column) for column in design.T])
    # Where points on one line leave a slope open the pseudo-inverse gives the covariance of what is determined.
    information = (design * slope[:, None]).T @ design
    try:
        bread = np.linalg.inv(information)
    except np.linalg.LinAlgError:
        bread = np.linalg.pinv(information)
    cells = score.shape[0]
    return np.asarray(bread @ (score.T @ score) @ bread * cells / max(cells - 3, 1))
