"""Step integrals of a clipped quadratic against adaptive quadrature, and their derivatives against closed forms."""

from __future__ import annotations

from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from sysid.vehicle_model.kink import clipped_integrals


def quadratic(start: float, middle: float, end: float, s: np.ndarray | float):
    """Lagrange form through (0, start), (1/2, middle), (1, end)."""
    return start * (2 * s - 1) * (s - 1) + middle * 4 * s * (1 - s) + end * s * (2 * s - 1)


def cases() -> np.ndarray:
    random = np.random.default_rng(3).normal(size=(120, 3))
    special = [
        (1.0, 1.0, 1.0),
        (-1.0, -2.0, -1.0),
        (0.0, 0.0, 0.0),
        (1.0, 0.0, -1.0),  # straight through zero: no quadratic term
        (-1.0, 0.0, 1.0),
        (1.0, -1.0, 1.0),  # leaves the ground and lands in one step
        (-1.0, 1.0, -1.0),
        (1.0, 0.0, 1.0),  # touches zero twice over
        (0.0, 1.0, 0.0),  # roots at both ends
        (0.0, -1.0, 0.0),
        (0.0, 1.0, 2.0),
        (2.0, 1.0, 0.0),
        (1e5, 3.0, -1e5),
        (1e-9, -1e-9, 1e5),
    ]
    return np.concatenate([random, np.array(special)])


def test_integrals_equal_adaptive_quadrature():
    points = cases()
    impulse, moment = clipped_integrals(*jnp.asarray(points.T))
    for (a, b, c), first, second in zip(points, np.asarray(impulse), np.asarray(moment), strict=True):
        curvature, slope = 2 * (a - 2 * b + c), -3 * a + 4 * b - c
        roots = np.roots([curvature, slope, a]) if curvature or slope else np.zeros(0)
        breaks = [r.real for r in roots if abs(r.imag) < 1e-12 and 0 < r.real < 1]
        size = max(abs(a), abs(b), abs(c), 1e-30)

        def clipped(s: float, q=(a, b, c)) -> float:
            return max(0.0, quadratic(*q, s))

        exact = quad(clipped, 0, 1, points=breaks or None, epsabs=1e-13 * size, epsrel=1e-13)[0]
        weighted = quad(lambda s, q=clipped: (1 - s) * q(s), 0, 1, points=breaks or None, epsabs=1e-13 * size)[0]
        assert first == pytest.approx(exact, abs=1e-12 * size)
        assert second == pytest.approx(weighted, abs=1e-12 * size)


def test_without_an_event_nothing_is_corrected():
    """Simpson's rule is exact for a quadratic, so the correction to a Runge-Kutta step vanishes."""
    points = np.abs(np.random.default_rng(4).normal(size=(3, 200))) + np.array([[0.0], [1.0], [0.0]])
    impulse, moment = clipped_integrals(*jnp.asarray(points))
    simpson = (points[0] + 4 * points[1] + points[2]) / 6
    np.testing.assert_allclose(impulse, simpson, rtol=1e-14)
    np.testing.assert_allclose(moment, (points[0] + 2 * points[1]) / 6, rtol=1e-13)
    np.testing.assert_array_equal(clipped_integrals(*jnp.asarray(-points)), 0.0)


def test_derivatives_are_integrals_of_the_basis_over_the_contact():
    """d/d(value) of the integral of max(0, q) is the integral of that value's basis polynomial where q > 0."""
    for point in cases()[:40]:
        slopes = np.array(jax.jacfwd(lambda p: jnp.stack(clipped_integrals(*p)))(jnp.asarray(point)))
        grid = np.sort(np.concatenate([np.linspace(0, 1, 3), _roots(point)]))
        exact = np.zeros((2, 3))
        for low, high in pairwise(grid):
            if quadratic(*point, (low + high) / 2) <= 0:
                continue
            for k, basis in enumerate(np.eye(3)):
                for row, power in enumerate((0, 1)):
                    exact[row, k] += quad(lambda s, b=basis, n=power: (1 - s) ** n * quadratic(*b, s), low, high)[0]
        np.testing.assert_allclose(slopes, exact, atol=1e-11)


def _roots(point: np.ndarray) -> np.ndarray:
    a, b, c = point
    found = np.roots([2 * (a - 2 * b + c), -3 * a + 4 * b - c, a])
    return np.array([r.real for r in found if abs(r.imag) < 1e-12 and 0 < r.real < 1])


def test_derivatives_are_finite_at_degenerate_values():
    for point in cases()[120:]:
        assert np.isfinite(jax.jacfwd(lambda p: jnp.stack(clipped_integrals(*p)))(jnp.asarray(point))).all()
        assert np.isfinite(jax.jacrev(lambda p: jnp.stack(clipped_integrals(*p)))(jnp.asarray(point))).all()
