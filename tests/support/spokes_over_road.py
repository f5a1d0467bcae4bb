"""A planar truck over a road with edges whose tires are radial springs, summed over the road at every instant.

No footprint map, no effective profile, no table: at every stage of the integration the spokes of every wheel meet the
road point by point, and what lies behind an edge is hidden.  A tire presses as hard as on a flat road at the same
vertical force of its spokes, and its damping acts on that deflection, as in :mod:`sysid.vehicle_model.contact`.
Bodies, suspensions and the classical Runge-Kutta scheme are written out here on the matrices of the vehicle.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import brentq

STEP_S = 0.0005
#: How far from below the centre the road is looked at [m], and the distance of its points.
REACH_M, POINT_M = 0.3, 0.002


@dataclass(frozen=True)
class Tires:
    """Per axle (na,): radius [m], static load here and in the first load case [N], there the tangent stiffness [N/m]
    and damping [N s/m]; `exponent` of a spoke."""

    radius_m: np.ndarray
    load_N: np.ndarray
    reference_N: np.ndarray
    stiffness_N_per_m: np.ndarray
    damping_N_s_per_m: np.ndarray
    exponent: float


def flat_force(radius: float, sunk: float, power: float) -> float:
    """Vertical force of unit spokes, the centre `sunk` below the radius over a flat road: a fan of 4000."""
    end = np.arccos((radius - sunk) / radius)
    phi = end * np.sin(np.linspace(-0.5, 0.5, 4001) * np.pi)
    return float(np.trapezoid(np.cos(phi) * np.maximum(radius - (radius - sunk) / np.cos(phi), 0.0) ** power, phi))


def at_rest(tires: Tires, i: int) -> tuple[float, float]:
    """Stiffness of the spokes of an axle, whose tangent on a flat road is the given one, and how far it sinks [m]."""
    radius, power = tires.radius_m[i], tires.exponent

    def excess(sunk: float) -> float:
        force, more, less = (flat_force(radius, sunk + d, power) for d in (0.0, 1e-5, -1e-5))
        return tires.reference_N[i] / force * (more - less) / 2e-5 - tires.stiffness_N_per_m[i]

    reference = brentq(excess, 2e-3, 0.15)
    spoke = tires.reference_N[i] / flat_force(radius, reference, power)
    return spoke, brentq(lambda d: spoke * flat_force(radius, d, power) - tires.load_N[i], 1e-4, 0.2)


def unit_force(road_m: jax.Array, height_m: jax.Array, s: jax.Array, h: jax.Array, radius: jax.Array, power: float):
    """Vertical and forward force of unit spokes of wheels (...,) at stations and heights s, h [m]."""
    window = round(2 * REACH_M / POINT_M)
    first = jnp.searchsorted(road_m, s - REACH_M)
    at = first[..., None] + jnp.arange(window)
    x, z = road_m[at] - s[..., None], height_m[at]
    vertical, forward = 0.0, 0.0
    for side in (1.0, -1.0):
        d, up = (side * x, z) if side > 0 else (side * x[..., ::-1], z[..., ::-1])
        below = h[..., None] - up
        angle = jnp.maximum(jnp.arctan2(d, below), 0.0)
        seen = jax.lax.associative_scan(jnp.maximum, angle, axis=-1)
        low, high = seen[..., :-1], seen[..., 1:]
        middle = 0.5 * (low + high)
        # Where the ray meets the line between two points: d = below tan(middle).
        d0, d1, b0, b1 = d[..., :-1], d[..., 1:], below[..., :-1], below[..., 1:]
        turn = jnp.tan(middle)
        across = (d1 - d0) - (b1 - b0) * turn
        share = (b0 * turn - d0) / jnp.where(jnp.abs(across) > 1e-12, across, 1.0)
        rho = (b0 + jnp.clip(share, 0.0, 1.0) * (b1 - b0)) / jnp.cos(middle)
        shorter = jnp.where(high > low, radius[..., None] - rho, 0.0)
        push = jnp.where(shorter > 0.0, jnp.where(shorter > 0.0, shorter, 1.0) ** power, 0.0) * (high - low)
        vertical = vertical + (push * jnp.cos(middle)).sum(axis=-1)
        forward = forward - side * (push * jnp.sin(middle)).sum(axis=-1)
    return vertical, forward


def drive(matrices, law, tires: Tires, axle_x, road_m, height_m, speed_m_s: float, seconds: float):
    """Times (T,) from where axle 1 is over station 0, and vertical forces (T, na) [N], positions (T, na, 2) of centres.

    Parameters
    ----------
    matrices : StackedMatrices of one run without axle groups, rockers and bending frames.
    law : stiffness and damping (na,) of linear suspensions.
    axle_x : (na,) [m]; road_m, height_m : (n,) points of the road, `POINT_M` apart or closer at edges.
    """
    na = len(axle_x)
    spoke, sunk = (jnp.asarray(v) for v in zip(*(at_rest(tires, i) for i in range(na)), strict=True))
    radius, x = (jnp.asarray(v) for v in (tires.radius_m, axle_x))
    # Deflection on a flat road over the vertical force of its spokes.
    levels = np.linspace(0.0, 1.0, 400) ** 1.5 * 0.25
    flat = jnp.asarray([[flat_force(r, u * r, tires.exponent) for u in levels] for r in tires.radius_m])
    depth = jnp.asarray(np.outer(tires.radius_m, levels))
    reference = jax.vmap(jnp.interp)(jnp.asarray(tires.reference_N) / spoke, flat, depth)
    position, rate, acceleration = (jnp.asarray(m[0]) for m in matrices[:3])
    inverse, static = jnp.asarray(matrices.inverse_unsprung[0, :, 0]), jnp.asarray(matrices.static_load[0, :, 0])
    k, c = (jnp.asarray(v) for v in law)
    road, up = jnp.asarray(road_m), jnp.asarray(height_m)
    damping = jnp.asarray(tires.damping_N_s_per_m)

    def forces(t, y):
        body, body_rate, axle, axle_rate = y
        shift, drift = position @ body, rate @ body_rate
        s = speed_m_s * t - x + shift[na : 2 * na]
        h = radius - sunk + axle

        def deflection(s, h):
            vertical, forward = unit_force(road, up, s, h, radius, tires.exponent)
            return jax.vmap(jnp.interp)(vertical, flat, depth), vertical, forward

        found = jax.jvp(deflection, (s, h), (speed_m_s + drift[na : 2 * na], axle_rate))
        (sunken, vertical, forward), (sinking, _, _) = found
        size = sunken / reference
        length = size * jnp.sqrt(1.1 / (size + 0.1))
        whole = jnp.maximum(spoke * vertical + damping * length * sinking, 0.0)
        along = jnp.where(vertical > 0.0, forward / jnp.where(vertical > 0.0, vertical, 1.0), 0.0) * whole
        pull = k * (shift[:na] - axle) + c * (drift[:na] - axle_rate)
        moved = acceleration @ jnp.concatenate([pull, along]) + shift[2 * na :] + drift[2 * na :]
        return (body_rate, moved, axle_rate, inverse * (whole - static + pull)), (whole, jnp.stack([s, h], axis=-1))

    def step(y, n):
        t = STEP_S * n

        def after(share, slope):
            return jax.tree.map(lambda a, b: a + share * STEP_S * b, y, slope)

        a, shown = forces(t, y)
        b, _ = forces(t + STEP_S / 2, after(0.5, a))
        d, _ = forces(t + STEP_S / 2, after(0.5, b))
        e, _ = forces(t + STEP_S, after(1.0, d))
        return jax.tree.map(lambda y, a, b, c, d: y + STEP_S / 6 * (a + 2 * b + 2 * c + d), y, a, b, d, e), shown

    still, rest = jnp.zeros(position.shape[1]), jnp.zeros(na)
    numbers = jnp.arange(round(seconds / STEP_S))
    _, (force, places) = jax.jit(lambda y: jax.lax.scan(step, y, numbers))((still, still, rest, rest))
    return STEP_S * np.arange(len(force)), np.asarray(force), np.asarray(places)
