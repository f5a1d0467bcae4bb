"""The motion of an independent truck over a bump: suspensions, tires of radial springs, Runge-Kutta.

A tire is a fan of radial springs with dampers that push where their spoke is shorter than the wheel's radius; no
effective road, no footprint map.  Dry friction is that of leaf springs: Dahl's, grown over a slip length, and shared
by a rocker as the spring is.  A rough road moves a wheel as a whole; that of a drive without a bump also pushes it
along by its slope.  Fourth order with steps of half a millisecond, all runs of a campaign side by side.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from independent_truck import GRAVITY, Elements, Equations, IndependentTruck
from scipy.optimize import brentq

STEP_S = 0.0005
INTERVAL_S = 0.005
SPOKES = np.radians(np.linspace(-60.0, 60.0, 91))
BUMP_M, LENGTH_M = 0.075, 0.9
#: Spacing of the heights of a road, and the station at which they begin [m].
ROAD_STEP_M, ROAD_BEGIN_M = 0.05, -20.0
#: Rate at which friction that falls has lost 63 % of what it loses [m/s].
FADING_M_PER_S = 0.1


def height(s):
    """The bump, a raised cosine about s = 0."""
    inside = jnp.abs(s) < 0.5 * LENGTH_M
    return jnp.where(inside, 0.5 * BUMP_M * (1.0 + jnp.cos(2 * jnp.pi * s / LENGTH_M)), 0.0)


def slope(s):
    """Slope of the bump."""
    inside = jnp.abs(s) < 0.5 * LENGTH_M
    return jnp.where(inside, -jnp.pi * BUMP_M / LENGTH_M * jnp.sin(2 * jnp.pi * s / LENGTH_M), 0.0)


def rough_road(truck: IndependentTruck, rng: np.random.Generator):
    """Height of a rough road over station, 0.05 to 3 cycles/m, spectrum Gd (n / 0.1)^-2."""
    n = np.geomspace(0.05, 3.0, 80)
    amplitude = jnp.asarray(np.sqrt(2.0 * truck.roughness_m3 * (n / 0.1) ** -2 * np.gradient(n)))
    phase, wave = jnp.asarray(rng.uniform(0.0, 2 * np.pi, n.size)), jnp.asarray(2 * np.pi * n)
    return lambda s: jnp.sum(amplitude * jnp.sin(wave * s[..., None] + phase), axis=-1)


def element_columns(truck: IndependentTruck | Sequence[IndependentTruck]) -> dict[str, jax.Array]:
    """Numbers of :class:`Elements` and `damping` by axle, of one truck (na,) or of several (trucks, na)."""
    if isinstance(truck, IndependentTruck):
        return {name: column[0] for name, column in element_columns([truck]).items()}
    each = [t.elements or (Elements(),) * len(t.x_m) for t in truck]
    names = [n for n in Elements.__dataclass_fields__ if n not in ("air", "declared")]
    columns = {n: jnp.asarray([[getattr(e, n) for e in of] for of in each]) for n in names}
    for n, part in enumerate(("air_slope", "air_curve")):
        columns[part] = jnp.asarray([[e.air[n] for e in of] for of in each])
    return columns | {"damping": jnp.asarray([t.damping for t in truck])}


def element_force(truck: IndependentTruck | Sequence[IndependentTruck], stiffness):
    """Forces [N] of springs, and of dampers and stops, over extension and its rate, positive in tension.

    The damper's is that behind its rubber where this is given as a third argument.
    """
    column = element_columns(truck)
    a, b, c = column["air_slope"], column["air_curve"], column["damping"]

    def spring(x):
        helper = column["helper_N_per_m"] * jnp.minimum(x + column["helper_m"], 0.0)
        return stiffness * x * (1.0 - a * x / 2 + b * x**2 / 3) + helper

    def rest(x, rate, behind=None):
        ratio = jnp.where(rate < 0.0, column["bump_ratio"], column["rebound_ratio"])
        damper = c * ratio * rate / (1.0 + jnp.abs(rate) / column["knee_m_per_s"])
        if behind is not None:
            damper = jnp.where(column["bushing_m_per_N"] > 0.0, behind, damper)
        pushed, pulled = jnp.maximum(-x - column["jounce_m"], 0.0), jnp.maximum(x - column["rebound_m"], 0.0)
        stop = column["stop_N_per_m"] * (pulled * (1.0 + pulled / 0.015) - pushed * (1.0 + pushed / 0.015))
        return damper + stop

    return spring, rest, column["friction_share"], column["slip_length_m"]


def rubber_rate(column, force, rate):
    """Rate [N/s] of the force of a linear damper behind its rubber, 0 where there is none."""
    soft = column["bushing_m_per_N"]
    ratio = jnp.where(force < 0.0, column["bump_ratio"], column["rebound_ratio"])
    slower = rate - force / (column["damping"] * ratio)
    return jnp.where(soft > 0.0, slower / jnp.where(soft > 0.0, soft, 1.0), 0.0)


def shortening(s, h, radius):
    """By how much the road shortens every spoke of a wheel with its centre at station s and height h, (..., spokes)."""
    sine, cosine = jnp.sin(SPOKES), jnp.cos(SPOKES)
    rho = h[..., None] / cosine
    for _ in range(4):  # Newton's method
        at = s[..., None] + rho * sine
        rho = rho + (h[..., None] - rho * cosine - height(at)) / (cosine + slope(at) * sine)
    return radius[..., None] - rho


def flat_force(radius: float, sunk: float, exponent: float) -> float:
    """Vertical force of spokes of unit stiffness per radian, the centre `sunk` below the radius over a flat road."""
    shorter = np.maximum(radius - (radius - sunk) / np.cos(SPOKES), 0.0)
    return float(np.trapezoid(np.cos(SPOKES) * shorter**exponent, SPOKES))


def spokes(radius: float, load: float, stiffness: float, damping: float, exponent: float) -> tuple[float, float]:
    """Stiffness and damping per radian of spokes whose tangents on a flat road at `load` are the given ones."""

    def sunk_under(spring: float) -> float:
        return brentq(lambda d: spring * flat_force(radius, d, exponent) - load, 1e-6, 0.25)

    def excess(log_spring: float) -> float:
        spring = np.exp(log_spring)
        sunk = sunk_under(spring)
        more, less = (flat_force(radius, sunk + d, exponent) for d in (1e-5, -1e-5))
        return spring * (more - less) / 2e-5 - stiffness

    spring = float(np.exp(brentq(excess, 13.0, 18.0)))
    touching = radius - (radius - sunk_under(spring)) / np.cos(SPOKES) > 0.0
    return spring, damping / float(np.trapezoid(np.where(touching, 1.0, 0.0), SPOKES))


def rest_height(radius: float, load: float, spring: float, exponent: float) -> float:
    """Height of a wheel's centre at which a flat road carries `load` [N]."""
    return radius - brentq(lambda d: spring * flat_force(radius, d, exponent) - load, 1e-6, 0.25)


def on_road(roads: np.ndarray):
    """Height and slope (R, na) of roads (R, n) at stations (R, na), linear between their heights."""
    table = jnp.asarray(roads)

    def at(s):
        place = jnp.clip((s - ROAD_BEGIN_M) / ROAD_STEP_M, 0.0, table.shape[1] - 2.0)
        left = jnp.floor(place).astype(int)
        low, high = (jnp.take_along_axis(table, left + k, axis=1) for k in (0, 1))
        return low + (high - low) * (place - left), (high - low) / ROAD_STEP_M

    return at


def simulate(
    truck: IndependentTruck | Sequence[IndependentTruck],
    runs: list[tuple[str, float, float, float]],
    seconds: float,
    *,
    load_shift: bool = False,
    interval_s: float = INTERVAL_S,
    roads: np.ndarray | None = None,
    step_s: float = STEP_S,
) -> np.ndarray:
    """Readings (T, runs, 4 na) every `interval_s`: deflections, axle and frame accelerations, vertical tire forces.

    Runs are of (load case, speed and start at axle 1, share by which the speed changes until the last axle passes), at
    constant acceleration; with `load_shift` its inertia forces lean the truck, which begins in that equilibrium.
    `truck` may be one for each run, all with as many axles; with `roads` (runs, n), heights every 5 cm from 20 m behind
    station 0 on, there is no bump.
    """
    trucks = [truck] * len(runs) if isinstance(truck, IndependentTruck) else list(truck)
    each = [Equations(t, case) for t, (case, *_) in zip(trucks, runs, strict=True)]
    m = {n: jnp.asarray(np.stack([getattr(e, n) for e in each])) for n in vars(each[0])}
    speed, start, change = (jnp.asarray([r[k] for r in runs])[:, None] for k in (1, 2, 3))
    radius, x = (jnp.asarray([getattr(t, n) for t in trucks]) for n in ("radius_m", "x_m"))
    acceleration = ((speed * (1.0 + change)) ** 2 - speed**2) / (2.0 * x[:, -1:])
    leaning = float(load_shift) * acceleration * m.pop("shift")
    power = trucks[0].spoke_exponent
    tires = {id(t): _tires(t) for t in trucks}
    rest = jnp.asarray(
        [
            [rest_height(r, f, k, power) for r, f, (k, _) in zip(t.radius_m, e.static, tires[id(t)], strict=True)]
            for t, e in zip(trucks, each, strict=True)
        ]
    )
    spring, damper = jnp.moveaxis(jnp.asarray([tires[id(t)] for t in trucks]), 2, 0)
    sine, cosine, turn = jnp.sin(SPOKES), jnp.cos(SPOKES), float(SPOKES[1] - SPOKES[0])
    rough = rough_road(trucks[0], np.random.default_rng(trucks[0].road_seed))
    road = None if roads is None else on_road(roads)
    column = element_columns(trucks)
    spring_force, other_force, share, slip = element_force(trucks, m["suspension"])
    breakaway, soft = share * m["carried"], bool(np.any(column["bushing_m_per_N"] > 0.0))

    def dot(a, v):
        return jnp.einsum("rij,rj->ri", a, v)

    def forces(t, q, v, rubbing, behind):
        tau = t - start
        s = speed * tau + 0.5 * acceleration * tau**2 - x + dot(m["forward"], q)
        h = rest + dot(m["wheel"], q)
        s_rate, h_rate = speed + acceleration * tau + dot(m["forward"], v), dot(m["wheel"], v)
        if road is None:
            delta, rate = jax.jvp(lambda s, h: shortening(s, h - rough(s), radius), (s, h), (s_rate, h_rate))
        else:
            ground, incline = road(s)
            delta = radius[..., None] - (h - ground)[..., None] / cosine
            rate = -(h_rate - incline * s_rate)[..., None] / cosine
        touching = delta > 0.0
        force = jnp.where(touching, spring[..., None] * jnp.where(touching, delta, 1.0) ** power, 0.0)
        force = jnp.maximum(force + jnp.where(touching, damper[..., None] * rate, 0.0), 0.0)
        # Spokes of the flat road about the ends count half: both ends are clear of it.
        vertical, along = (turn * (force * w).sum(axis=-1) for w in (cosine, -sine))
        if road is not None:
            along = -vertical * incline
        length, length_rate = dot(m["extension"], q), dot(m["extension"], v)
        damped = other_force(length, length_rate, behind if soft else None)
        pull = dot(m["through"], spring_force(length) + rubbing) + damped
        motion = (
            -dot(m["stiffness"], q)
            - dot(m["damping"], v)
            - dot(m["push"], pull)
            + dot(m["lift"], vertical - m["static"])
            + dot(m["drive"], along)
            + leaning
        )
        toward = jnp.where(breakaway > 0.0, rubbing / jnp.where(breakaway > 0.0, breakaway, 1.0), 0.0)
        lost = column["fading"] * (1.0 - jnp.exp(-jnp.abs(length_rate) / FADING_M_PER_S))
        rubbing_rate = breakaway / slip * (length_rate - jnp.abs(length_rate) * toward / (1.0 - lost))
        return motion, rubbing_rate, rubber_rate(column, behind, length_rate), vertical

    def derivative(t, state):
        return state[1], *forces(t, *state)[:3]

    def step(state, number):
        t, h = number * step_s, step_s

        def after(share, slope):
            return jax.tree.map(lambda y, k: y + share * h * k, state, slope)

        k1 = derivative(t, state)
        k2 = derivative(t + h / 2, after(0.5, k1))
        k3 = derivative(t + h / 2, after(0.5, k2))
        k4 = derivative(t + h, after(1.0, k3))
        new = jax.tree.map(lambda y, a, b, c, d: y + h / 6 * (a + 2 * b + 2 * c + d), state, k1, k2, k3, k4)
        a1, *_, vertical = forces(t, *state)
        seen = [dot(m["extension"], state[0]), dot(m["wheel"], a1), dot(m["points"], a1), vertical]
        return new, jnp.concatenate(seen, axis=1)

    substeps = round(interval_s / step_s)
    still = jnp.zeros((len(runs), m["push"].shape[1]))

    def at_rest(q):
        # Nothing holds a truck fore and aft: the smallest motion that balances everything else.
        def left(flat):
            return forces(0.0, flat.reshape(q.shape), still, breakaway * 0.0, breakaway * 0.0)[0].ravel()

        for _ in range(8 if load_shift else 0):  # Newton's method
            q = q - jnp.linalg.lstsq(jax.jacfwd(left)(q.ravel()), left(q.ravel()))[0].reshape(q.shape)
        return q

    @jax.jit
    def all_steps(state):
        def sample(state, k):
            first, seen = step(state, k * substeps)
            rest_of, _ = jax.lax.scan(lambda s, j: (step(s, k * substeps + j)[0], None), first, jnp.arange(1, substeps))
            return rest_of, seen

        return jax.lax.scan(sample, state, jnp.arange(round(seconds / interval_s)))[1]

    return np.asarray(all_steps((at_rest(still), still, jnp.zeros_like(breakaway), jnp.zeros_like(breakaway))))


def _tires(truck: IndependentTruck) -> list[tuple[float, float]]:
    """Spokes of all axles, whose tangents are those of the first load case."""
    first = np.array(next(iter(truck.load_cases.values()))[0]) * GRAVITY
    of_tires = zip(truck.radius_m, first, truck.tire_N_per_m, truck.tire_N_s_per_m, strict=True)
    return [spokes(*v, truck.spoke_exponent) for v in of_tires]


def peak_ratios(truck: IndependentTruck, passes: tuple[tuple[str, float], ...]) -> np.ndarray:
    """Largest vertical tire force over the static one, (passes, na), of passes at (load case, speed [km/h]).

    It is taken from every step of the integration: readings 5 ms apart miss a peak at 48 km/h by up to 2 %.
    """
    runs = [(case, v / 3.6, 1.0, 0.0) for case, v in passes]
    seconds = max(1.0 + (truck.x_m[-1] + LENGTH_M) / r[1] for r in runs) + 1.5
    force = simulate(truck, runs, seconds, interval_s=STEP_S)[:, :, 3 * len(truck.x_m) :]
    static = np.array([truck.load_cases[case][0] for case, _ in passes]) * GRAVITY
    return force.max(axis=0) / static


def tire_forces(truck: IndependentTruck, load_case: str, speed_km_h: float) -> tuple[np.ndarray, np.ndarray]:
    """Times (T,) from the instant at which axle 1 meets the bump, and vertical tire forces (T, na) of one pass."""
    speed, begin = speed_km_h / 3.6, 1.0
    seconds = begin + (truck.x_m[-1] + LENGTH_M) / speed + 1.5
    force = simulate(truck, [(load_case, speed, begin, 0.0)], seconds, interval_s=STEP_S)[:, 0, 3 * len(truck.x_m) :]
    return STEP_S * np.arange(len(force)) - begin, force
