"""Tire contact over an effective profile: unilateral, stiffening, with the horizontal force of the slope.

The wheel centre feels the effective road W(s) of its static load (:mod:`sysid.road.enveloping`).  With the deflection
u = u_0 + W(s) - z (u_0 at rest, z the rise of the wheel centre) the vertical and the forward force are

    V = max(0, A u + B u^2 + c (W' ds/dt - dz/dt)),   H = -V W'(s)

with the quadratic deflection law of tire handbooks (B = kappa A, kappa the stiffening; H. B. Pacejka, Tire and Vehicle
Dynamics, the load characteristic of the Magic Formula tire).  A is fixed by the declared tangent stiffness at the
first load case's static load; damping scales with the contact length, the square root of the static deflection.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.interpolate import BSpline
from scipy.ndimage import spline_filter1d

#: Flat stations added at both ends: the filter's response has died out over them.
_PADDING = 24


class TireLaw(NamedTuple):
    """Coefficients of the contact force per axle and lane, arrays (R, na, S).

    `static_deflection` u_0 [m], `linear` A [N/m], `quadratic` B [N/m2], `damping` c [N s/m]; `horizontal` is 1 where
    the slope of the road pushes the wheel back and 0 for a purely vertical contact force.
    """

    static_deflection: jax.Array
    linear: jax.Array
    quadratic: jax.Array
    damping: jax.Array
    horizontal: float = 1.0


class RoadInput(NamedTuple):
    """Effective road under each wheel: rise [m] and its first four derivatives along the road, (..., R, na, S)."""

    rise: jax.Array
    slope: jax.Array
    second: jax.Array
    third: jax.Array
    fourth: jax.Array

    def shifted(self, ahead: jax.Array) -> RoadInput:
        """The road looked up `ahead` [m] further on, to first order: exact as a derivative with respect to it."""
        moved = [value + derivative * ahead for value, derivative in pairwise(self)]
        return RoadInput(moved[0], moved[1], moved[2], moved[3], self.fourth)


def tire_law(
    stiffness: jax.Array,
    damping: jax.Array,
    stiffening: jax.Array,
    static_load: jax.Array,
    reference_load: jax.Array,
) -> TireLaw:
    """Coefficients of the contact law from the tangent stiffness at the reference load.

    With r = F_ref / k_t the reference deflection is u = 2 r / (1 - 2 kappa r + sqrt(1 + 4 kappa^2 r^2)) and
    A = k_t / (1 + 2 kappa u); any other static load F gives u_0 = 2 F / (A (1 + sqrt(1 + 4 kappa F / A))).

    Parameters
    ----------
    stiffness : (R, na, S) tangent stiffness k_t at the reference load [N/m].
    damping : (R, na, S) damping at the reference load [N s/m].
    stiffening : (..., S) kappa [1/m].
    static_load, reference_load : (R, na, 1) static load of this lane and of the first load case [N].
    """
    r = reference_load / stiffness
    reference = 2.0 * r / (1.0 - 2.0 * stiffening * r + jnp.sqrt(1.0 + (2.0 * stiffening * r) ** 2))
    linear = stiffness / (1.0 + 2.0 * stiffening * reference)
    static = 2.0 * (static_load / linear) / (1.0 + jnp.sqrt(1.0 + 4.0 * stiffening * static_load / linear))
    return TireLaw(static, linear, stiffening * linear, damping * jnp.sqrt(static / reference))


def contact_force(
    law: TireLaw, road: RoadInput, advance: jax.Array, speed: jax.Array, rise: jax.Array, rise_rate: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Unclipped vertical contact force [N] and local road slope [-], both (R, na, S).

    Below zero deflection the law continues with its initial tangent, so that the unclipped force is smooth through
    lift-off; the contact force is its positive part and the forward force minus slope times that.

    Parameters
    ----------
    law, road : coefficients and road input at this instant.
    advance : (R, na, S) fore-aft motion of the wheel, how far it is ahead of the position at which `road` was looked
        up [m]; the road there follows from its Taylor series.
    speed : (R, na, S) forward speed of the wheel centre [m/s].
    rise, rise_rate : (R, na, S) wheel-centre rise above static equilibrium [m] and its rate [m/s].
    """
    slope = road.slope + advance * (road.second + 0.5 * advance * road.third)
    height = road.rise + advance * (road.slope + advance * (0.5 * road.second + advance / 6.0 * road.third))
    deflection = law.static_deflection + height - rise
    elastic = deflection * (law.linear + law.quadratic * jnp.maximum(deflection, 0.0))
    return elastic + law.damping * (slope * speed - rise_rate), slope


class EffectiveRoad(NamedTuple):
    """Quintic B-spline coefficients of the effective profiles, (R, na, n), on uniform stations."""

    coefficients: np.ndarray
    first_station_m: float
    step_m: float


def spline_coefficients(rise_m: np.ndarray) -> np.ndarray:
    """Coefficients of the interpolating quintic B-spline along the last axis, zero-padded at both ends."""
    padding = [(0, 0)] * (rise_m.ndim - 1) + [(_PADDING, _PADDING)]
    padded = np.pad(rise_m, padding)
    return spline_filter1d(padded, order=5, axis=-1, mode="mirror", output=np.float64)


def effective_road(station_m: np.ndarray, rise_m: np.ndarray) -> EffectiveRoad:
    """Spline of effective profiles (R, na, n) given on uniform stations [m] from the start of the bump."""
    step = float(station_m[1] - station_m[0])
    return EffectiveRoad(spline_coefficients(rise_m), float(station_m[0]) - _PADDING * step, step)


def road_input(road: EffectiveRoad, position_m: jax.Array) -> RoadInput:
    """Rise of the effective road and its derivatives at wheel positions.

    The quintic B-spline basis is continuous over its knots up to the fourth derivative, so the result does not depend
    on which cell rounding chooses for a position that falls on a knot.

    Parameters
    ----------
    position_m : (..., R, na, S) wheel-centre positions from the start of the bump [m].
    """
    count = road.coefficients.shape[-1]
    moved = jnp.moveaxis(position_m, (-3, -2), (0, 1))
    flat = moved.reshape(*moved.shape[:2], -1)
    # Outside the tabulated stations the road is flat: all coefficients are zero there.
    scaled = jnp.clip((flat - road.first_station_m) / road.step_m, 2.0, count - 4.0)
    cell = jax.lax.stop_gradient(jnp.floor(scaled)).astype(jnp.int32)
    t = scaled - cell
    table = jnp.asarray(road.coefficients)
    # Six B-spline coefficients become the six coefficients of the polynomial in t on this cell.
    weights = jnp.stack([jnp.take_along_axis(table, cell + k, axis=2) for k in range(-2, 4)])
    terms = jnp.tensordot(jnp.asarray(_CELL_POLYNOMIAL), weights, axes=1)
    derivatives = []
    for order in range(5):
        factors = [math.perm(power, order) for power in range(order, 6)]
        value = factors[-1] * terms[5]
        for power in range(4, order - 1, -1):
            value = value * t + factors[power - order] * terms[power]
        derivatives.append(jnp.moveaxis(value.reshape(moved.shape), (0, 1), (-3, -2)) / road.step_m**order)
    return RoadInput(*derivatives)


def _cell_polynomial() -> np.ndarray:
    """Matrix (6, 6) from the B-spline coefficients around a cell to the powers of the position in it."""
    basis = BSpline.basis_element(np.arange(-3.0, 4.0), extrapolate=False)
    matrix = np.zeros((6, 6))
    for column, offset in enumerate(range(-2, 4)):
        for power in range(6):
            # Derivatives in the middle of the cell, where the basis is smooth, give the polynomial by Taylor's theorem.
            matrix[power, column] = basis.derivative(power)(0.5 - offset) / math.factorial(power)
    shift = np.array([[math.comb(j, i) * (-0.5) ** (j - i) if j >= i else 0.0 for j in range(6)] for i in range(6)])
    return shift @ matrix


_CELL_POLYNOMIAL = _cell_polynomial()
