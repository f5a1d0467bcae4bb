"""The moving average of a footprint: against radial springs that are summed one by one over a gentle wave."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from sysid.road.footprint_filter import footprint_filter

RADIUS_M, SUNK_M, EXPONENT = 0.5, 0.02, 0.7
PHI = np.linspace(-np.pi / 3, np.pi / 3, 20001)


def spokes(height: float, road) -> tuple[float, float]:
    """Vertical and forward force of unit spokes under a wheel centre at station 0, by fixed-point iteration."""
    rho = height / np.cos(PHI)
    for _ in range(6):
        rho = (height - road(rho * np.sin(PHI))) / np.cos(PHI)
    force = np.maximum(RADIUS_M - rho, 0.0) ** EXPONENT
    return np.trapezoid(force * np.cos(PHI), PHI), -np.trapezoid(force * np.sin(PHI), PHI)


def flat(sunk: float) -> float:
    return spokes(RADIUS_M - sunk, np.zeros_like)[0]


@pytest.mark.parametrize("wave_m", [0.2, 0.35, 1.0, 5.0])
@pytest.mark.parametrize("phase", [0.0, 0.25])
def test_rise_and_drag_over_a_wave(wave_m: float, phase: float):
    """A wave of 0.2 mm: the height that keeps the load, and the forward force there, by the springs themselves."""
    amplitude, load = 2e-4, flat(SUNK_M)
    stiffness = (flat(SUNK_M + 1e-5) - flat(SUNK_M - 1e-5)) / 2e-5
    weights = footprint_filter(RADIUS_M, SUNK_M, load, stiffness, EXPONENT, 0.01)

    def road(x):
        return amplitude * np.sin(2 * np.pi * (x / wave_m + phase))

    height = brentq(lambda h: spokes(h, road)[0] - load, RADIUS_M - 2 * SUNK_M, RADIUS_M)
    forward = spokes(height, road)[1] / load
    station = np.arange(-100, 101) * 0.01
    rise, drag = (v[100] for v in weights.applied(road(station)))
    assert rise == pytest.approx(height - (RADIUS_M - SUNK_M), abs=0.02 * amplitude)
    assert drag == pytest.approx(forward, abs=0.03 * 2 * np.pi * amplitude / max(wave_m, 0.35))


def test_a_long_slope_is_followed():
    """Weights sum to one, are symmetric, and forward over vertical force is minus the slope."""
    weights = footprint_filter(RADIUS_M, SUNK_M, flat(SUNK_M), (flat(0.0201) - flat(0.0199)) / 2e-4, EXPONENT, 0.025)
    assert weights.rise.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(weights.rise, weights.rise[::-1], atol=1e-12)
    rise, drag = weights.applied(0.01 * np.arange(100) * 0.025)
    np.testing.assert_allclose(rise[30:70], 0.01 * np.arange(30, 70) * 0.025, atol=1e-12)
    np.testing.assert_allclose(drag[30:70], -0.01, rtol=0.03)
