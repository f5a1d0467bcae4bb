"""States inside suspensions: friction that has slid some way, and dampers in rubber bushings.

Friction is Dahl's element (P. R. Dahl, "A solid friction model", 1968): d phi / d e = (1 - phi sgn v) / z_s; in leaf
packs it goes towards an envelope w(e, v) (:class:`sysid.vehicle_model.suspension.SuspensionLaw`) in place of 1, of
which a step takes the mean of its ends. A damper
in series with bushings of the compliance 1/k_b (a Maxwell element) has a rate u of its own,

    D(u) = k_b (e - e_b),    so    u' = (v - u) / T,    T = (dD/du) / k_b,

e_b the extension of the damper and v the rate of the suspension. Both are followed along the parabola or the straight
line between what is known of a step, in closed form, so that steps may be longer than T.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from sysid.vehicle_model.device_arrays import RunsByAxlesBySets
from sysid.vehicle_model.suspension import SuspensionLaw, damper_force, damper_slope

#: Of a change of rate that takes more than this many time constants, nothing is left.
LONGEST = 600.0
#: Changes of a damper's rate below this [m/s] have the slope of its curve, not that of a chord.
SMALL_CHANGE_M_S = 1e-9


class Extension(NamedTuple):
    """Extension from static rest [m] and its rate [m/s] of every suspension, (R, na, S) each."""

    value: jax.Array
    rate: jax.Array


class SuspensionStates(NamedTuple):
    """State phi [-] of friction and rate u [m/s] of dampers in bushings, (R, na, S); None where no axle has any."""

    slip: jax.Array | None
    damper_rate: jax.Array | None


def states_at_rest(law: SuspensionLaw, zero: jax.Array) -> SuspensionStates:
    """States at static rest, in the shape of `zero` (R, na, S)."""
    return SuspensionStates(None if law.friction is None else zero, None if law.compliance is None else zero)


def states_at_stage(
    law: SuspensionLaw,
    states: SuspensionStates,
    start: Extension,
    tau: float,
    stage: Extension,
    middle_rate: jax.Array | None = None,
) -> SuspensionStates:
    """States at a stage of a step, `tau` [s] after its start; `middle_rate` the rate half way, None if straight."""
    slip, damper_rate = states
    if slip is not None:
        slip = slip_at_stage(law, slip, start, tau, stage)
    if damper_rate is not None:
        bend = 0.0 * start.rate if middle_rate is None else 2.0 * (start.rate + stage.rate) - 4.0 * middle_rate
        damper_rate = _followed(law, damper_rate, start.rate, stage.rate - start.rate - bend, bend, tau)
    return SuspensionStates(slip, damper_rate)


def states_after_step(
    law: SuspensionLaw, states: SuspensionStates, start: Extension, end: Extension, step_s: float
) -> SuspensionStates:
    """States at the end of a step from the extension at both ends."""
    slip, damper_rate = states
    if slip is not None:
        slip = slip_after_step(law, slip, start, end, step_s)
    if damper_rate is not None:
        # The rate's parabola through both ends whose mean is that of the step.
        mean = (end.value - start.value) / step_s
        bend = 3.0 * (start.rate + end.rate) - 6.0 * mean
        damper_rate = _followed(law, damper_rate, start.rate, end.rate - start.rate - bend, bend, step_s)
    return SuspensionStates(slip, damper_rate)


def _followed(
    law: SuspensionLaw, damper_rate: jax.Array, rate: jax.Array, linear: jax.Array, bend: jax.Array, tau: float
) -> jax.Array:
    """Rate of the damper after `tau` along the suspension's rate v + linear s + bend s^2, s from 0 to 1.

    T follows from the slope of the damper's curve where the step begins, and then from the chord of that curve between
    there and where the first T leads. The force changes by the chord times the change of u; u is the rate on the curve
    at that force, by one step of Newton.
    """
    assert law.compliance is not None
    first = _relaxed(law.compliance * damper_slope(law, damper_rate) / tau, damper_rate, rate, linear, bend)
    if law.saturation is None and law.asymmetry is None and law.rate_ramps is None:
        return first
    change = first - damper_rate
    moves = jnp.abs(change) > SMALL_CHANGE_M_S
    here = damper_force(law, damper_rate)
    chord = (damper_force(law, first) - here) / jnp.where(moves, change, 1.0)
    slope = jnp.where(moves, chord, damper_slope(law, damper_rate))
    second = _relaxed(law.compliance * slope / tau, damper_rate, rate, linear, bend)
    missed = here + slope * (second - damper_rate) - damper_force(law, second)
    return jnp.asarray(second + missed / damper_slope(law, second))


def _relaxed(lag: jax.Array, damper_rate: jax.Array, rate: jax.Array, linear: jax.Array, bend: jax.Array) -> jax.Array:
    """u(1) of lag u' = v + linear s + bend s^2 - u, u(0) = `damper_rate`: what follows v, and a remainder."""
    left = jnp.exp(-1.0 / jnp.maximum(lag, 1.0 / LONGEST))
    follows = rate + linear + bend - lag * (linear + 2.0 * bend) + 2.0 * lag**2 * bend
    started = rate - lag * linear + 2.0 * lag**2 * bend
    return jnp.asarray(follows + (damper_rate - started) * left)


def _envelope(law: SuspensionLaw, extension: RunsByAxlesBySets, rate: RunsByAxlesBySets | float) -> jax.Array:
    """w(e, v): friction that the leaves reach in the end, over that at rest."""
    if law.friction_growth is None or law.sliding is None or law.sliding_rate is None:
        return jnp.ones_like(extension)
    pressed = jnp.maximum(1.0 - law.friction_growth * extension, 0.0)
    return pressed * (law.sliding + (1.0 - law.sliding) / (1.0 + (rate / law.sliding_rate) ** 2))


def _slide(law: SuspensionLaw, slip: RunsByAxlesBySets, change: jax.Array, envelope: jax.Array) -> jax.Array:
    """phi after the extension changes by `change` in one direction: s w + (phi - s w) exp(-|change| / z_s)."""
    assert law.slip is not None
    end = jnp.sign(change) * envelope
    return end + (slip - end) * jnp.exp(-jnp.abs(change) / law.slip)


def _slide_and_back(
    law: SuspensionLaw, slip: RunsByAxlesBySets, start: Extension, turned: jax.Array, turns: jax.Array, end: Extension
) -> jax.Array:
    """phi after the extension goes to where it turns, and on to its end; without a turn, straight there."""
    at_start, at_end = _envelope(law, start.value, start.rate), _envelope(law, end.value, end.rate)
    between = jnp.where(turns, _envelope(law, turned, 0.0), at_start)
    there = _slide(law, slip, turned - start.value, 0.5 * (at_start + between))
    return _slide(law, there, end.value - turned, 0.5 * (between + at_end))


def slip_at_stage(
    law: SuspensionLaw, slip: RunsByAxlesBySets, start: Extension, tau: float, stage: Extension
) -> jax.Array:
    """Friction state phi at a stage, from the parabola through the step's start and the stage's extension.

    Where the parabola turns inside the stage the friction element slides to the turning point and back; the result is
    continuous where the turning point enters or leaves the stage.

    Parameters
    ----------
    slip : (R, na, S) phi at the start. start, stage : at the start of the step and at the stage.
    tau : time from the start of the step to the stage [s].
    """
    rate = start.rate
    bend = stage.value - start.value - rate * tau
    turns = rate * (rate * tau + 2.0 * bend) < 0.0
    turned = start.value - jnp.where(turns, (rate * tau) ** 2, 0.0) / (4.0 * jnp.where(turns, bend, 1.0))
    return _slide_and_back(law, slip, start, turned, turns, stage)


def slip_after_step(
    law: SuspensionLaw,
    slip: RunsByAxlesBySets,
    start: Extension,
    end: Extension,
    step_s: float,
) -> jax.Array:
    """Friction state phi at the end of a step, through the turning point of the cubic between both ends.

    Parameters
    ----------
    slip : (R, na, S) phi at the start.
    start, end : at both ends.
    step_s : step [s].
    """
    (e0, v0), (e1, v1) = start, end
    turns = v0 * v1 < 0.0
    s = jax.lax.stop_gradient(_turning_point(e1 - e0, v0 * step_s, v1 * step_s, turns))
    # Its rate vanishes there, so the exact derivative needs no derivative of the turning point's place.
    cubic = e0 + s * (step_s * v0 * (1.0 - s) ** 2 + s * ((3.0 - 2.0 * s) * (e1 - e0) - (1.0 - s) * step_s * v1))
    turned = jnp.where(turns, cubic, e0)
    return _slide_and_back(law, slip, Extension(e0, v0), turned, turns, Extension(e1, v1))


def _turning_point(change: jax.Array, v0: jax.Array, v1: jax.Array, turns: jax.Array) -> jax.Array:
    """Root in [0, 1] of v0 + (6 change - 4 v0 - 2 v1) s + (3 v0 + 3 v1 - 6 change) s^2, the cubic's rate."""
    a, b, c = 3.0 * (v0 + v1) - 6.0 * change, 6.0 * change - 4.0 * v0 - 2.0 * v1, v0
    half = -0.5 * (b + jnp.where(b >= 0.0, 1.0, -1.0) * jnp.sqrt(jnp.maximum(b * b - 4.0 * a * c, 0.0)))
    first = jnp.where(a != 0.0, half / jnp.where(a != 0.0, a, 1.0), -1.0)
    second = jnp.where(half != 0.0, c / jnp.where(half != 0.0, half, 1.0), -1.0)
    root = jnp.where((second >= 0.0) & (second <= 1.0), second, first)
    return jnp.where(turns, jnp.clip(root, 0.0, 1.0), 0.0)
