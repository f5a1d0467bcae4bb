"""Clouds made from a known profile: the oracle is the closed form that the points were drawn from."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize_scalar

from sysid.campaign.records import Scan


def cosine_bump(station: np.ndarray, height: float = 0.08, length: float = 0.9) -> np.ndarray:
    inside = np.abs(station) < length / 2
    return np.where(inside, height * 0.5 * (1 + np.cos(2 * np.pi * station / length)), 0.0)


def parabola(station: np.ndarray, height: float = 0.08, length: float = 0.9) -> np.ndarray:
    return np.maximum(height * (1 - (2 * station / length) ** 2), 0.0)


def table_top(station: np.ndarray, height: float = 0.075, length: float = 4.0, ramp: float = 0.9) -> np.ndarray:
    return height * np.clip((length / 2 - np.abs(station)) / ramp, 0.0, 1.0)


def cloud(
    profile: Callable[..., np.ndarray],
    *,
    points: int = 20_000,
    length: float = 5.0,
    width: float = 3.5,
    centre: float = 0.0,
    noise: float = 0.0015,
    grade: float = 0.02,
    camber: float = -0.025,
    heading_deg: float = 30.0,
    skew_deg: float = 0.0,
    outliers: float = 0.005,
    offset: tuple[float, float, float] = (12.0, -7.0, 1.5),
    seed: int = 1,
) -> np.ndarray:
    """Points (n, 3) of a road with a bump about along = 0; the bump may use (station) or (station, across)."""
    rng = np.random.default_rng(seed)
    along = rng.uniform(-length / 2, length / 2, points) + centre
    across = rng.uniform(-width / 2, width / 2, points)
    station = along * np.cos(np.radians(skew_deg)) + across * np.sin(np.radians(skew_deg))
    two = profile.__code__.co_argcount == 2 and "across" in profile.__code__.co_varnames
    height = profile(station, across) if two else profile(station)
    height = height + noise * rng.standard_normal(points)
    stray = rng.random(points) < outliers
    height[stray] += rng.uniform(-0.15, 0.4, int(stray.sum()))
    # A rigid turn of the flat road: forward and normal are unit vectors of the tilted plane.
    cosine, sine = np.cos(np.radians(heading_deg)), np.sin(np.radians(heading_deg))
    forward = np.array([cosine, sine, grade]) / np.sqrt(1 + grade**2)
    normal = np.array([-grade * cosine + camber * sine, -grade * sine - camber * cosine, 1.0])
    normal /= np.linalg.norm(normal)
    road = np.outer(along, forward) + np.outer(across, np.cross(normal, forward)) + np.outer(height, normal)
    return road + np.asarray(offset)


def scan_of(points: np.ndarray, heading_deg: float = 30.0) -> Scan:
    return Scan(name="bump", file="cloud.csv", heading_rad=float(np.radians(heading_deg)), points_m=points)


def misfit(
    station: np.ndarray, height: np.ndarray, truth: Callable[[np.ndarray], np.ndarray]
) -> tuple[float, np.ndarray]:
    """RMS difference [m] over the bump at the best shift along the road, and the truth at the stations there."""

    def rms(shift: float) -> float:
        curve = truth(station - shift)
        return float(np.sqrt(np.mean((height - curve)[(height > 0) | (curve > 0)] ** 2)))

    axis = np.arange(-3.0, 3.0, 0.001)
    centre = float(np.sum(station * height) / np.sum(height) - np.sum(axis * truth(axis)) / np.sum(truth(axis)))
    coarse = centre + np.arange(-0.06, 0.06, 0.002)
    start = coarse[int(np.argmin([rms(shift) for shift in coarse]))]
    best = minimize_scalar(rms, bounds=(start - 0.002, start + 0.002), method="bounded", options={"xatol": 1e-6}).x
    return rms(best), truth(station - best)
