"""Look-up of the effective road: analytic bump, SciPy's spline, and positions that fall exactly on the stations."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from sysid.vehicle_model.contact import RoadInput, effective_road, road_input

STEP_M = 0.01
STATION_M = np.arange(-200, 301) * STEP_M
HEIGHT_M, WIDTH_M = 0.08, 0.25


def bump(s: np.ndarray, order: int = 0) -> np.ndarray:
    """A Gaussian bump at 0.4 m and its first four derivatives (Hermite polynomials)."""
    t = (s - 0.4) / WIDTH_M
    polynomial = [1 + 0 * t, -2 * t, 4 * t**2 - 2, -8 * t**3 + 12 * t, 16 * t**4 - 48 * t**2 + 12][order]
    return HEIGHT_M * polynomial * np.exp(-(t**2)) / WIDTH_M**order


@jax.jit
def look_up(position_m: jax.Array) -> RoadInput:
    """Road input at positions (n,) of one axle of one run."""
    road = effective_road(STATION_M, bump(STATION_M)[None, None])
    found = road_input(road, position_m[:, None, None, None])
    return RoadInput(*(v[:, 0, 0, 0] for v in found[:5]))


def relative_error(values: jax.Array, exact: np.ndarray) -> float:
    return float(np.abs(np.asarray(values) - exact).max() / np.abs(exact).max())


def test_rise_and_derivatives_of_an_analytic_bump():
    s = np.random.default_rng(0).uniform(-1.0, 2.0, 4000)
    found = look_up(s)
    # Interpolation by quintics of step h: h^6 / width^6 for the value, two orders less per two derivatives.
    for order, limit in enumerate((1e-8, 1e-7, 2e-6, 5e-5, 2e-3)):
        assert relative_error(found[order], bump(s, order)) < limit


def test_equals_the_interpolating_quintic_spline():
    s = np.random.default_rng(1).uniform(-1.5, 2.5, 2000)
    spline = make_interp_spline(STATION_M, bump(STATION_M), k=5)
    for order, values in enumerate(look_up(s)[:5]):
        exact = spline.derivative(order)(s) if order else spline(s)
        assert relative_error(values, exact) < 1e-9 * 100**order / 10


@pytest.mark.parametrize("offset_m", [0.0, 1e-12, -1e-12, 1e-15])
def test_exactly_on_the_stations(offset_m: float):
    """8 m/s and steps of 1.25 ms put a wheel on every station; rounding must not matter for any derivative."""
    times = np.arange(0, 401) * 0.00125
    position = jnp.asarray(8.0 * (times - 0.125) + offset_m)
    assert np.abs(np.asarray(position) / STEP_M - np.rint(np.asarray(position) / STEP_M)).max() < 1e-9
    spline = make_interp_spline(STATION_M, bump(STATION_M), k=5)
    found = look_up(position)
    np.testing.assert_allclose(found.rise, bump(np.asarray(position)), rtol=0, atol=1e-11)
    for order, values in enumerate(found[:5]):
        # The fourth derivative is the last continuous one.
        exact = spline.derivative(order)(position) if order else spline(position)
        assert relative_error(values, np.asarray(exact)) < 1e-9 * 100**order / 10


def test_derivative_of_the_look_up_is_the_next_derivative():
    s = np.concatenate([np.random.default_rng(2).uniform(-0.5, 1.5, 50), np.arange(0, 50) * STEP_M])
    _, tangent = jax.jvp(look_up, (jnp.asarray(s),), (jnp.ones(s.size),))
    exact = look_up(s)
    for order in range(4):
        np.testing.assert_allclose(tangent[order], exact[order + 1], rtol=1e-9, atol=1e-9 * 100**order)


def test_flat_far_away_and_finite_derivatives():
    s = jnp.array([-1e3, -3.0, 4.0, 1e3])
    value, tangent = jax.jvp(look_up, (s,), (jnp.ones(4),))
    for v, t in zip(value[:5], tangent[:5], strict=True):
        np.testing.assert_allclose(v, 0.0, atol=1e-10)
        np.testing.assert_array_equal(t, 0.0)


def test_a_shifted_road_is_the_road_further_on_to_first_order():
    s, ahead = jnp.linspace(-0.5, 1.5, 201), 1e-4
    shifted, exact = look_up(s).shifted(ahead), look_up(s + ahead)
    for order in range(3):
        size = float(np.abs(np.asarray(exact[order])).max())
        assert np.abs(np.asarray(shifted[order] - exact[order])).max() < 40 * (ahead / WIDTH_M) ** 2 * size


def test_each_run_and_axle_has_its_own_road():
    rises = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])[..., None] * bump(STATION_M)
    position = np.random.default_rng(3).uniform(-0.5, 1.5, (7, 2, 3, 4))
    found = road_input(effective_road(STATION_M, rises), jnp.asarray(position))
    scale = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])[..., None]
    np.testing.assert_allclose(found.rise, scale * bump(position), atol=1e-9)
    np.testing.assert_allclose(found.slope, scale * bump(position, 1), atol=1e-7)
