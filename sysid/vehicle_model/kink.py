"""Exact step integrals of a clipped contact force: keeps the integrator's order through lift-off."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp


def clipped_integrals(start: jax.Array, middle: jax.Array, end: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Integrals of max(0, q) and (1 - s) max(0, q) over the unit step, for the quadratic q through three values.

    q(s) = start + b s + a s^2 with a = 2 (start - 2 middle + end), b = -3 start + 4 middle - end.  The step is cut at
    the roots of q, where q does not change sign, so each part contributes max(0, its integral).  As q vanishes at its
    roots the derivative needs no derivative of the root itself.

    Parameters
    ----------
    start, middle, end : arrays of one shape [N], unclipped force at the beginning, middle and end of the step.

    Returns
    -------
    two arrays of that shape [N].
    """
    a = 2.0 * (start - 2.0 * middle + end)
    b = -3.0 * start + 4.0 * middle - end
    lower, upper = jax.lax.stop_gradient(_cuts(start, a, b))

    def plain(s: jax.Array) -> jax.Array:
        return s * (start + s * (b / 2.0 + s * (a / 3.0)))

    def weighted(s: jax.Array) -> jax.Array:
        return s * (start + s * ((b - start) / 2.0 + s * ((a - b) / 3.0 - s * (a / 4.0))))

    def positive_parts(antiderivative: Callable[[jax.Array], jax.Array]) -> jax.Array:
        low, high, whole = antiderivative(lower), antiderivative(upper), antiderivative(jnp.ones_like(lower))
        return jnp.maximum(low, 0.0) + jnp.maximum(high - low, 0.0) + jnp.maximum(whole - high, 0.0)

    return positive_parts(plain), positive_parts(weighted)


def _cuts(c: jax.Array, a: jax.Array, b: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Roots of c + b s + a s^2 clipped to [0, 1] in order; no root is reported as a cut at 0."""
    discriminant = b * b - 4.0 * a * c
    half = -0.5 * (b + jnp.where(b >= 0.0, 1.0, -1.0) * jnp.sqrt(jnp.maximum(discriminant, 0.0)))
    first = jnp.where(a != 0.0, half / jnp.where(a != 0.0, a, 1.0), 0.0)
    second = jnp.where(half != 0.0, c / jnp.where(half != 0.0, half, 1.0), 0.0)
    none = discriminant <= 0.0
    first = jnp.clip(jnp.where(none, 0.0, first), 0.0, 1.0)
    second = jnp.clip(jnp.where(none, 0.0, second), 0.0, 1.0)
    return jnp.minimum(first, second), jnp.maximum(first, second)
