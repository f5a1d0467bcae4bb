"""Tire contact over a bump: a footprint of radial springs, unilateral, with vertical and forward force.

The wheel centre follows the effective road W(s) of its static load, and around it the footprint map of
:mod:`sysid.road.enveloping`. With v = W(s) - z (z the rise of the wheel centre above its static position) the tire acts
like a flat road at the equivalent deflection

    e = u_0 + v + alpha_1(s) w + alpha_2(s) w^2 + alpha_3(s) w^3,   w = max(v, lift(s) - u_0)

and gives the vertical and the forward force

    V = max(0, F_ref |e / u_ref|^n sign(e) + c g(e / u_ref) de/dt),   g(r) = r ((1 + s) / (r + s))^(1/2),
    H = V (beta_0(s) + beta_1(s) w + beta_2(s) w^2).

Below v = lift - u_0 the undeformed wheel is clear of the road. The exponent n is the same for all tires and is
estimated with the other parameters. With u_ref = n F_ref / k_t, k_t is the tangent stiffness at the static load F_ref
of the first load case. So tires are stiffer in heavier load cases without a further parameter. The damping grows with
the contact length, the square root of the deflection, but falls in proportion to the deflection far below s u_ref
(:data:`SOFT_DAMPING`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.interpolate import BSpline
from scipy.ndimage import spline_filter1d

from sysid.vehicle_model.device_arrays import HostOrDevice, RunsByAxlesBySets
from sysid.vehicle_model.stacked_matrices import runs_side_by_side

#: Flat stations added at both ends: over this length the filter's response decays to zero.
_PADDING = 24


#: Value and first three derivatives along the road of the rows of a map.
MapOrders = tuple[jax.Array, jax.Array, jax.Array, jax.Array]


class TireLaw(NamedTuple):
    """Coefficients of the contact force per axle, pass and set, arrays (R, na, S).

    `static_deflection` u_0 [m]; `reference_deflection` u_ref [m]; `reference_load` F_ref [N]; `exponent` n (S,) or
    broadcastable [-]; `damping` c [N s/m] at the reference deflection.  `growth` (R, na, 1) or broadcastable is 1 where
    damping grows with the contact length, 0 where it is constant.
    """

    static_deflection: RunsByAxlesBySets
    reference_deflection: RunsByAxlesBySets
    reference_load: HostOrDevice
    exponent: jax.Array
    damping: RunsByAxlesBySets
    growth: HostOrDevice | float = 1.0


class RoadInput(NamedTuple):
    """Road under each wheel at one instant or many, (..., R, na, S).

    - `rise`: W [m] and its first four derivatives along the road;
    - `stretch` (alpha_1, alpha_2, alpha_3 and the lift of first contact) and `drag` (beta_0, beta_1, beta_2) of the
      footprint map, with their first three derivatives: tuples of four (..., 4 or 3, R, na, S) arrays. They are None
      for a point follower, whose force is purely vertical.
    """

    rise: jax.Array
    slope: jax.Array
    second: jax.Array
    third: jax.Array
    fourth: jax.Array
    stretch: MapOrders | None = None
    drag: MapOrders | None = None

    def shifted(self, ahead: jax.Array) -> RoadInput:
        """The road looked up `ahead` [m] further on, to first order: exact as a derivative with respect to it."""

        def moved(orders: tuple[jax.Array, ...]) -> list[jax.Array]:
            return [*(value + derivative * ahead for value, derivative in pairwise(orders)), orders[-1]]

        rise, slope, second, third, fourth = moved((self.rise, self.slope, self.second, self.third, self.fourth))
        stretch = None if self.stretch is None else _orders(moved(self.stretch))
        drag = None if self.drag is None else _orders(moved(self.drag))
        return RoadInput(rise, slope, second, third, fourth, stretch, drag)


def _orders(values: list[jax.Array]) -> MapOrders:
    value, first, second, third = values
    return value, first, second, third


def tire_law(
    stiffness: RunsByAxlesBySets,
    damping: RunsByAxlesBySets,
    exponent: jax.Array,
    static_load: HostOrDevice,
    reference_load: HostOrDevice,
) -> TireLaw:
    """Coefficients of the contact law from the tangent stiffness at the reference load.

    F = F_ref (u / u_ref)^n has the tangent k_t = n F_ref / u_ref at F_ref; a static load F rests at
    u_0 = u_ref (F / F_ref)^(1/n).

    Parameters
    ----------
    stiffness : (R, na, S) tangent stiffness k_t at the reference load [N/m].
    damping : (R, na, S) damping at the reference load [N s/m].
    exponent : (..., S) n.
    static_load, reference_load : (R, na, 1) static load of this pass and of the first load case [N].
    """
    reference = exponent * reference_load / stiffness
    static = reference * (static_load / reference_load) ** (1.0 / exponent)
    return TireLaw(static, reference, reference_load, exponent, damping)


#: Deflection, as a fraction of the reference, below which the damping decreases linearly instead of as a square root: a
#: vertical tangent at lift-off would need much smaller time steps.
SOFT_DAMPING = 0.1
#: Relative deflection below which the elastic force counts as zero, with a zero derivative.
NO_DEFLECTION = 1e-12


def tangents(
    stiffness: np.ndarray,
    damping: np.ndarray,
    exponent: np.ndarray | float,
    deflection: np.ndarray,
    growth: np.ndarray | float,
) -> tuple[np.ndarray, np.ndarray]:
    """Tangent stiffness [N/m] and damping [N s/m] of tires (axles,) away from the reference load, at rest.

    They are k_t x^(n - 1) and c (1 + g (l - 1)) with l = x sqrt((1 + s) / (x + s)) the length of contact over that at
    the reference load, and s = :data:`SOFT_DAMPING`.

    Parameters
    ----------
    stiffness, damping : (axles,) k_t [N/m] and c [N s/m] at the reference load.
    exponent : n.
    deflection : (axles,) x, static deflection over that at the reference load.
    growth : g (axles,) or one for all, 1 where damping grows with the length of contact, 0 where it does not.
    """
    return np.asarray(stiffness * deflection ** (exponent - 1.0)), contact_damping(damping, deflection, growth)


def contact_damping(damping: np.ndarray | float, deflection: np.ndarray, growth: np.ndarray | float) -> np.ndarray:
    """Damping of tires away from the reference load, as for :func:`tangents`."""
    length = deflection * np.sqrt((1.0 + SOFT_DAMPING) / (deflection + SOFT_DAMPING))
    return np.asarray(damping * (1.0 + growth * (length - 1.0)))


def contact_force(
    law: TireLaw,
    road: RoadInput,
    advance: RunsByAxlesBySets,
    speed: RunsByAxlesBySets,
    rise: RunsByAxlesBySets,
    rise_rate: RunsByAxlesBySets,
) -> tuple[jax.Array, jax.Array]:
    """Unclipped vertical contact force [N] and ratio of forward to vertical force [-], both (R, na, S).

    Below zero deflection, where the wheel is off the ground, both parts continue negatively, so that the unclipped
    force crosses zero smoothly; the contact force is its positive part.

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
    below = height - rise
    below_rate = slope * speed - rise_rate
    if road.stretch is None or road.drag is None:
        deflection = law.static_deflection + below
        rate, drag = below_rate, jnp.zeros_like(slope)
    else:
        (a, b, c, lift), (da, db, dc, lift_slope) = _advanced(road.stretch, advance)
        # Above its first contact the footprint has no effect on the wheel: the cubic must not bend back to the road
        # there.
        lowest = lift - law.static_deflection
        touching = below > lowest
        v, v_rate = jnp.where(touching, below, lowest), jnp.where(touching, below_rate, speed * lift_slope)
        deflection = law.static_deflection + below + v * (a + v * (b + v * c))
        rate = below_rate + v_rate * (a + v * (2.0 * b + 3.0 * v * c))
        rate = rate + speed * v * (da + v * (db + v * dc))
        (a, b, c), _ = _advanced(road.drag, advance)
        drag = a + v * (b + v * c)
    relative = deflection / law.reference_deflection
    elastic = law.reference_load * _odd_power(relative, law.exponent)
    size = jnp.abs(relative)
    length = size * jnp.sqrt((1.0 + SOFT_DAMPING) / (size + SOFT_DAMPING))
    # Off the ground the force continues to fall, so that it crosses zero with one slope when a wheel lands.
    grown = jnp.where(relative >= 0.0, rate, -jnp.abs(rate)) * length
    return jnp.asarray(elastic + law.damping * (rate + law.growth * (grown - rate))), drag


def _advanced(orders: MapOrders, advance: RunsByAxlesBySets) -> tuple[list[jax.Array], list[jax.Array]]:
    """The rows of a map and their slopes `advance` [m] further on, by their Taylor series."""
    value, first, second, _ = orders
    rows = range(value.shape[-4])
    moved = [value[k] + advance * (first[k] + 0.5 * advance * second[k]) for k in rows]
    return moved, [first[k] + advance * second[k] for k in rows]


def _odd_power(x: jax.Array, exponent: jax.Array) -> jax.Array:
    """sign(x) |x|^n for n about 1 or more, with finite derivatives at zero."""
    size = jnp.abs(x)
    safe = jnp.where(size > NO_DEFLECTION, size, 1.0)
    return jnp.where(size > NO_DEFLECTION, jnp.sign(x) * jnp.exp(exponent * jnp.log(safe)), 0.0)


@partial(
    jax.tree_util.register_dataclass,
    data_fields=["rise", "first_station_m", "step_m", "stretch", "drag"],
    meta_fields=["edged"],
)
@dataclass(frozen=True)
class EffectiveRoad:
    """Quintic B-spline coefficients on uniform stations of the effective profiles and footprint maps.

    `rise` (R, na, n); `stretch` (4, R, na, n), `drag` (3, R, na, n), None for a point follower.  One map (4, 1, na, n),
    (3, 1, na, n) serves all runs.  An `edged` road, or one of a truck that falls behind, is looked up where the wheels
    are; elsewhere it is at the speed that is held, and its Taylor series leads to the wheels, which are within 25 mm.
    """

    rise: np.ndarray
    first_station_m: float
    step_m: float
    stretch: np.ndarray | None = None
    drag: np.ndarray | None = None
    edged: bool = False

    @property
    def station_m(self) -> np.ndarray:
        """Stations of the heights that the splines go through [m]."""
        count = self.rise.shape[-1] - 2 * _PADDING
        return self.first_station_m + self.step_m * (_PADDING + np.arange(count))

    def of_runs(self, runs: Sequence[int]) -> EffectiveRoad:
        """The roads of the named runs, in this order; one may be named several times."""
        stretch, drag = (None if table is None else table[:, runs] for table in (self.stretch, self.drag))
        return replace(self, rise=self.rise[runs], stretch=stretch, drag=drag)

    def for_all(self, count: int) -> EffectiveRoad:
        """The one road as that of so many runs, which share its footprint map."""
        return replace(self, rise=np.repeat(self.rise, count, axis=0))


def spline_coefficients(values: np.ndarray) -> np.ndarray:
    """Coefficients of the interpolating quintic B-spline along the last axis, zero-padded at both ends."""
    padded = np.pad(values, [(0, 0)] * (values.ndim - 1) + [(_PADDING, _PADDING)]).astype(float, copy=False)
    # Flat roads are zero as they are: in a plank drop all axles but one have no other.
    uneven = padded.any(axis=-1)
    if uneven.any():
        padded[uneven] = spline_filter1d(padded[uneven], order=5, axis=-1, mode="mirror")
    return padded


def effective_road(
    station_m: np.ndarray,
    rise_m: np.ndarray,
    stretch: np.ndarray | None = None,
    drag: np.ndarray | None = None,
    *,
    edged: bool = False,
) -> EffectiveRoad:
    """Splines of effective profiles (R, na, n) and maps (rows, R, na, n) on uniform stations [m] from the start."""
    step = float(station_m[1] - station_m[0])
    return EffectiveRoad(
        spline_coefficients(rise_m),
        float(station_m[0]) - _PADDING * step,
        step,
        None if stretch is None else spline_coefficients(stretch),
        None if drag is None else spline_coefficients(drag),
        edged,
    )


def raised(road: EffectiveRoad, first: int, rise_m: np.ndarray) -> EffectiveRoad:
    """The road with heights (R, na, m) [m] added at m of its stations, from number `first` on; those about stay."""
    end = first + rise_m.shape[-1] + 2 * _PADDING
    rise = np.broadcast_to(road.rise, (*rise_m.shape[:2], road.rise.shape[-1])).copy()
    rise[..., first:end] += spline_coefficients(rise_m)
    return replace(road, rise=rise)


#: Heights beside a road's own that are left out where the road has ended [m].
LEAST_RISE_M = 1e-5


@dataclass(frozen=True)
class RoadRise:
    """Heights that the roads of R runs have beside their own: `height_m` (R, na, m) at uniform `station_m` (m,)."""

    station_m: np.ndarray
    height_m: np.ndarray


def raised_along(road: EffectiveRoad, rise: RoadRise) -> EffectiveRoad:
    """The road with further heights, linear between their stations, zero beyond.

    It is made as long as they are larger than :data:`LEAST_RISE_M`.
    """
    own, step = road.station_m, road.step_m
    there = np.flatnonzero(np.abs(rise.height_m).max(axis=(0, 1)) > LEAST_RISE_M)
    first, last = (rise.station_m[there[k]] if there.size else own[k] for k in (0, -1))
    before = max(0, int(np.ceil((own[0] - first) / step - 1e-9)))
    behind = max(0, int(np.ceil((last - own[-1]) / step - 1e-9)))

    def longer(table: np.ndarray) -> np.ndarray:
        return np.pad(table, [(0, 0)] * (table.ndim - 1) + [(before, behind)])

    road = replace(
        road,
        rise=longer(road.rise),
        first_station_m=road.first_station_m - before * step,
        stretch=None if road.stretch is None else longer(road.stretch),
        drag=None if road.drag is None else longer(road.drag),
    )
    heights = np.apply_along_axis(
        lambda h: np.interp(road.station_m, rise.station_m, h, left=0.0, right=0.0), -1, rise.height_m
    )
    return raised(road, 0, heights)


def roads_side_by_side(roads: Sequence[EffectiveRoad]) -> EffectiveRoad:
    """The roads of K models as one, on the stations of the first; the K roads of a run follow each other."""

    def joined(tables: Sequence[np.ndarray | None]) -> np.ndarray | None:
        present = [t for t in tables if t is not None]
        return runs_side_by_side(present, axis=-3) if present else None

    return replace(
        roads[0],
        rise=runs_side_by_side([r.rise for r in roads], axis=-3),
        stretch=joined([r.stretch for r in roads]),
        drag=joined([r.drag for r in roads]),
    )


def road_input(road: EffectiveRoad, position_m: jax.Array) -> RoadInput:
    """Road at wheel positions: effective profile, footprint map, and their derivatives.

    The quintic B-spline basis is continuous over its knots up to the fourth derivative, so the result does not depend
    on which cell rounding chooses for a position that falls on a knot.

    Parameters
    ----------
    position_m : (..., R, na, S) wheel-centre positions from the start of the bump [m].
    """
    count = road.rise.shape[-1]
    moved = jnp.moveaxis(position_m, (-3, -2), (0, 1))
    flat = moved.reshape(*moved.shape[:2], -1)
    # Outside the tabulated stations the road is flat: all coefficients are zero there.
    scaled = jnp.clip((flat - road.first_station_m) / road.step_m, 2.0, count - 4.0)
    cell = jax.lax.stop_gradient(jnp.floor(scaled)).astype(jnp.int32)
    t = scaled - cell

    def derivatives(coefficients: np.ndarray, orders: int) -> list[jax.Array]:
        table = jnp.asarray(coefficients)
        # Six B-spline coefficients become the six coefficients of the polynomial in t on this cell.
        weights = jnp.stack([jnp.take_along_axis(table, cell + k, axis=2) for k in range(-2, 4)])
        terms = jnp.tensordot(jnp.asarray(CELL_POLYNOMIAL), weights, axes=1)
        by_order = []
        for order in range(orders):
            factors = [math.perm(power, order) for power in range(order, 6)]
            value = factors[-1] * terms[5]
            for power in range(4, order - 1, -1):
                value = value * t + factors[power - order] * terms[power]
            by_order.append(jnp.moveaxis(value.reshape(moved.shape), (0, 1), (-3, -2)) / road.step_m**order)
        return by_order

    def stacked(tables: np.ndarray | None) -> MapOrders | None:
        if tables is None:
            return None
        each = [derivatives(table, 4) for table in tables]
        # The coefficient axis stands just before (R, na, S), so that a leading time axis can be sliced.
        return _orders([jnp.stack([coefficients[k] for coefficients in each], axis=-4) for k in range(4)])

    rise, slope, second, third, fourth = derivatives(road.rise, 5)
    return RoadInput(rise, slope, second, third, fourth, stacked(road.stretch), stacked(road.drag))


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


#: Matrix (6, 6) from the B-spline coefficients around a cell to the powers of the position in it.
CELL_POLYNOMIAL = _cell_polynomial()
