"""Suspension laws: the force that a suspension puts on axle and body as a function of its extension and rate.

One law per axle is a sum of elements; every element has neutral values, so that axles with different laws can be in the
same arrays. An element that no axle needs is None and takes no time.

    pull = S(e) + D(u) + F_c phi + sum_j ramp_j

e extension from static rest (positive: longer); the static load is not in it. u is the rate of the damper: that of the
extension, or less where rubber bushings give way at the damper's eyes (:mod:`sysid.vehicle_model.suspension_states`,
also for the state phi of friction).  Where a rocker
(equaliser) joins the springs of neighbouring axles, each passes on a share s of the difference to their mean:

    pull_i = S_i + s (mean_j S_j - S_i) + D_i + stops_i,    S = spring and friction.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from sysid.vehicle_model.device_arrays import HostOrDevice, RunsByAxlesBySets
from sysid.vehicle_model.kink import clipped_integrals

#: Rate at which a nonlinear damper's coefficient is stated: c is the secant |D| / |v| there, mean of both directions.
REFERENCE_RATE_M_S = 0.5
#: A gas spring is not compressed below this share of its static length.
SHORTEST = 0.05


class Ramps(NamedTuple):
    """Piecewise linear parts of a curve, each `side` slope max(0, side (x - at)), x extension or its rate.

    `at` [m or m/s], `slope` [N/m or N s/m] and `side` (+1 acts beyond, -1 below `at`) are (J, R, na, S or 1).
    """

    at: jax.Array
    slope: jax.Array
    side: jax.Array


class FrameLaw(NamedTuple):
    """Restoring forces of bending frames, per run, mode and set, over the modal mass: arrays (R, nf, S).

    `stiffness` (2 pi f)^2 [1/s2] of the amplitude, `damping` 2 zeta (2 pi f) [1/s] of its rate.
    """

    stiffness: jax.Array
    damping: jax.Array


class SuspensionLaw(NamedTuple):
    """Suspension per run, axle and set, arrays (R, na, S); elements that are None act on no axle.

    - `stiffness` k [N/m], `damping` c [N s/m].
    - `softening` 1/l [1/m] and `stiffening` 1/d^2 [1/m2]: air spring S = k e (1 / (1 + e / l) + (e / d)^2). It is the
      isothermal law P = P_0 l / (l + e) for k = P_0 / l, and a bellows whose area grows towards both ends of its
      stroke. Zeros give a linear spring.
    - `saturation` v_s [m/s], `rounding` b and `tail` r: damper D = c g s(v) V / s(V), V = 0.5 m/s, s(v) = r v + (1 - r)
      v / sqrt(1 + 2 b |v| / v_s + (v / v_s)^2). r = 1 gives a linear damper, b = 0 a knee at v_s, and b = 1 the
      hyperbola v / (1 + |v| / v_s). A small v_s with r > 0 gives a regularised Coulomb force in addition to a viscous
      one.
    - `asymmetry` q: g = 2 q / (1 + q) in rebound (v > 0) and 2 / (1 + q) in compression; 1 is symmetric.
    - `friction` F_c [N] and `slip` z_s [m]: Dahl's element d phi / d e = (1 - phi sgn v) / z_s (P. R. Dahl, "A solid
      friction model", 1968).
    - `friction_growth` g [1/m], `sliding` r and `sliding_rate` v_s [m/s] of leaf packs, whose friction grows with what
      presses the leaves together and falls with speed: phi goes towards w sgn v instead of sgn v,
      w(e, v) = max(0, 1 - g e) (r + (1 - r) / (1 + (v / v_s)^2)). The envelopes of loading and unloading are apart by
      2 F_c w, and approached over z_s (P. S. Fancher et al., Measurement and representation of the mechanical
      properties of truck leaf springs, SAE 800905, 1980, doi:10.4271/800905).
    - `compliance` 1/k_b [m/N] of the rubber bushings in series with the damper; 0 holds it rigidly.
    - `trailing` b: the wheel goes aft by b times its jounce, forward if b < 0 (:mod:`sysid.vehicle_model.simulation`).
    - `ramps`: corners of the spring curve: hanger lash and tables; `stops`: bump stops, beside the spring;
      `rate_ramps`: corners of the damper curve.
    - `frames` of the bodies above, where they bend.
    - `load_share` s of a rocker between the springs of neighbouring axles; 0 on axles without one.
    """

    stiffness: RunsByAxlesBySets
    damping: RunsByAxlesBySets
    softening: RunsByAxlesBySets | None = None
    stiffening: RunsByAxlesBySets | None = None
    saturation: RunsByAxlesBySets | None = None
    rounding: RunsByAxlesBySets | None = None
    tail: RunsByAxlesBySets | None = None
    asymmetry: RunsByAxlesBySets | None = None
    friction: RunsByAxlesBySets | None = None
    slip: RunsByAxlesBySets | None = None
    friction_growth: RunsByAxlesBySets | None = None
    sliding: RunsByAxlesBySets | None = None
    sliding_rate: RunsByAxlesBySets | None = None
    load_share: RunsByAxlesBySets | None = None
    compliance: RunsByAxlesBySets | None = None
    trailing: RunsByAxlesBySets | None = None
    ramps: Ramps | None = None
    stops: Ramps | None = None
    rate_ramps: Ramps | None = None
    frames: FrameLaw | None = None


#: Elements with smooth coefficients, and the fields of :class:`SuspensionLaw` that are theirs: the native engine leaves
#: out those that no axle has.
ELEMENT_FIELDS: dict[str, tuple[str, ...]] = {
    "gas_spring": ("softening", "stiffening"),
    "saturating": ("saturation", "rounding", "tail"),
    "asymmetric": ("asymmetry",),
    "friction": ("friction", "slip"),
    "leaf_friction": ("friction_growth", "sliding", "sliding_rate"),
    "equaliser": ("load_share",),
    "damper_bushing": ("compliance",),
    "trailing_links": ("trailing",),
}


def _ramp_force(ramps: Ramps, x: jax.Array) -> jax.Array:
    at, slope, side = ramps
    return jnp.asarray((side * slope * jnp.maximum(side * (x - at), 0.0)).sum(axis=0))


def spring_force(law: SuspensionLaw, extension: RunsByAxlesBySets) -> jax.Array:
    """Elastic force of spring and stops [N], positive when it pulls axle and body together."""
    force = _of_spring(law, extension)
    return force if law.stops is None else force + _ramp_force(law.stops, extension)


def _of_spring(law: SuspensionLaw, extension: RunsByAxlesBySets) -> jax.Array:
    """Force S(e) of the spring alone, with its corners [N]."""
    force = law.stiffness * extension
    if law.softening is not None:
        force = force / jnp.maximum(1.0 + extension * law.softening, SHORTEST)
    if law.stiffening is not None:
        force = force + law.stiffness * law.stiffening * extension**3
    if law.ramps is not None:
        force = force + _ramp_force(law.ramps, extension)
    return jnp.asarray(force)


def damper_force(law: SuspensionLaw, rate: RunsByAxlesBySets) -> jax.Array:
    """Damper force D(v) [N] at rates of the damper [m/s]."""
    force = _symmetric_damper(law, rate)
    if law.asymmetry is not None:
        force = force * jnp.where(rate >= 0.0, law.asymmetry, 1.0) * (2.0 / (1.0 + law.asymmetry))
    if law.rate_ramps is not None:
        force = force + _ramp_force(law.rate_ramps, rate)
    return jnp.asarray(force)


def damper_slope(law: SuspensionLaw, rate: RunsByAxlesBySets) -> jax.Array:
    """Slope dD/dv of the damper force [N s/m] at rates of the damper [m/s]; at a corner, that of higher rates."""
    slope = law.damping * jnp.ones_like(rate)
    if law.saturation is not None and law.tail is not None and law.rounding is not None:
        # d/dv of v / sqrt(g), g = 1 + 2 b x + x^2 and x = |v| / v_s, is (1 + b x) / g^1.5.
        relative = jnp.abs(rate) / law.saturation
        curve = 1.0 + relative * (2.0 * law.rounding + relative)
        steep = law.tail + (1.0 - law.tail) * (1.0 + law.rounding * relative) / (curve * jnp.sqrt(curve))
        slope = law.damping * steep / _damper_shape(law, REFERENCE_RATE_M_S)
    if law.asymmetry is not None:
        slope = slope * jnp.where(rate >= 0.0, law.asymmetry, 1.0) * (2.0 / (1.0 + law.asymmetry))
    if law.rate_ramps is not None:
        at, steps, side = law.rate_ramps
        slope = slope + jnp.where(side * (rate - at) > 0.0, steps, 0.0).sum(axis=0)
    return jnp.asarray(slope)


def _symmetric_damper(law: SuspensionLaw, rate: RunsByAxlesBySets) -> jax.Array:
    if law.saturation is None or law.tail is None or law.rounding is None:
        return law.damping * rate

    return jnp.asarray(law.damping * rate * _damper_shape(law, rate) / _damper_shape(law, REFERENCE_RATE_M_S))


def _damper_shape(law: SuspensionLaw, rate: RunsByAxlesBySets | float) -> jax.Array:
    if law.saturation is None or law.tail is None or law.rounding is None:
        raise ValueError("a damper without a knee has no shape")
    relative = jnp.abs(rate) / law.saturation
    return law.tail + (1.0 - law.tail) / jnp.sqrt(1.0 + relative * (2.0 * law.rounding + relative))


def suspension_force(
    law: SuspensionLaw,
    extension: RunsByAxlesBySets,
    damper_rate: RunsByAxlesBySets,
    slip: RunsByAxlesBySets | None,
    sharing: HostOrDevice | None = None,
) -> jax.Array:
    """Force [N] that pulls axle and body together, less the static one, (R, na, S).

    Parameters
    ----------
    law : coefficients. extension, damper_rate : (R, na, S) extension from static rest [m] and rate of the damper
    [m/s]. slip : (R, na, S) state phi of the friction elements, None where no axle has one. sharing : (R, na, na) means
    over the axles of every rocker; None for suspensions without rockers.
    """
    force = _of_spring(law, extension)
    if law.friction is not None and slip is not None:
        force = force + law.friction * slip
    force = shared(law, sharing, force) + damper_force(law, damper_rate)
    return force if law.stops is None else force + _ramp_force(law.stops, extension)


def shared(law: SuspensionLaw, sharing: HostOrDevice | None, force: RunsByAxlesBySets) -> jax.Array:
    """Spring forces on axles and frame with rockers: each spring passes on its share of the difference to the mean."""
    if sharing is None or law.load_share is None:
        return force
    return force + law.load_share * (jnp.matmul(sharing, force) - force)


def has_kinks(law: SuspensionLaw) -> bool:
    """Whether the law has corners in extension or rate that the integrator corrects."""
    return any(part is not None for part in (law.ramps, law.stops, law.rate_ramps, law.asymmetry, law.saturation))


def kink_corrections(
    law: SuspensionLaw,
    extension: tuple[jax.Array, ...],
    rate: tuple[jax.Array, ...],
    sharing: HostOrDevice | None = None,
) -> tuple[jax.Array, jax.Array]:
    """Errors of Runge-Kutta at the corners of the law: corrections of the mean force and its first moment [N].

    With q the quadratic through the stage values of a corner's argument, the exact integrals of its positive part
    replace the quadrature of the stages (:mod:`sysid.vehicle_model.kink`); both corrections vanish in a step that does
    not touch the corner.

    Parameters
    ----------
    extension, rate : four stage values each, (R, na, S), in the order of the Nystrom step; rates are the damper's.
    sharing : as in :func:`suspension_force`.
    """
    impulse, moment = jnp.zeros_like(extension[0]), jnp.zeros_like(extension[0])
    for ramps, values in ((law.ramps, extension), (law.stops, extension), (law.rate_ramps, rate)):
        if ramps is None:
            continue
        at, slope, side = ramps
        mean, first = ((side * slope * x).sum(axis=0) for x in _missed(*(side * (x - at) for x in values)))
        if ramps is law.ramps:
            mean, first = shared(law, sharing, mean), shared(law, sharing, first)
        impulse, moment = impulse + mean, moment + first
    curvature: RunsByAxlesBySets | float = 0.0
    if law.saturation is not None and law.tail is not None and law.rounding is not None:
        # D = c v / s(V) + curvature v |v| near rest.
        mean, first = _missed_curvature(rate[0], rate[3])
        stated = _damper_shape(law, REFERENCE_RATE_M_S)
        curvature = (law.tail - 1.0) * law.rounding * law.damping / (law.saturation * stated)
        common = curvature if law.asymmetry is None else 2.0 * curvature / (1.0 + law.asymmetry)
        impulse, moment = impulse + common * mean, moment + common * first
    if law.asymmetry is not None:
        # D = (2 / (1 + q)) (d(v) + (q - 1) max(d(v), 0)): the second part has a corner. The parabola continues as d(v)
        # does for v > 0.
        ahead = (_symmetric_damper(law, v) + 2.0 * curvature * jnp.minimum(v, 0.0) ** 2 for v in rate)
        mean, first = _missed(*ahead)
        share = 2.0 * (law.asymmetry - 1.0) / (law.asymmetry + 1.0)
        impulse, moment = impulse + share * mean, moment + share * first
    return impulse, moment


def _missed_curvature(a: jax.Array, b: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Exact less Runge-Kutta integrals of v |v| and (1 - s) v |v|, v the straight line from `a` to `b` through zero."""
    turns = a * b < 0.0
    first, last = jnp.where(turns, a, 0.0), jnp.where(turns, b, 1.0)
    middle, change = 0.5 * (first + last), last - first
    before, between, after = (v * jnp.abs(v) for v in (first, middle, last))
    cubes = (jnp.abs(last) ** 3 - jnp.abs(first) ** 3) / (3.0 * change)
    fourth = (after * jnp.abs(after) - before * jnp.abs(before)) / (4.0 * change)
    mean = cubes - (before + 4.0 * between + after) / 6.0
    moment = (last * cubes - fourth) / change - (before + 2.0 * between) / 6.0
    return jnp.where(turns, mean, 0.0), jnp.where(turns, moment, 0.0)


def _missed(*values: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Exact less Runge-Kutta integrals of max(0, q) and (1 - s) max(0, q) for four stage values of q."""
    exact, exact_moment = clipped_integrals(values[0], 0.5 * (values[1] + values[2]), values[3])
    f1, f2, f3, f4 = (jnp.maximum(q, 0.0) for q in values)
    return exact - (f1 + 2.0 * f2 + 2.0 * f3 + f4) / 6.0, exact_moment - (f1 + f2 + f3) / 6.0
