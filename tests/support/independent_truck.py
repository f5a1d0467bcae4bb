"""Logs of trucks whose equations are written out here, apart from the package: rockers, bending frames, spoked tires.

Coordinates p: travel, heave and pitch of every body, the amplitude of every frame that bends, heave of every axle.
Hinges are constraints, taken out by a null space of their rows.  A tire is a fan of radial springs with dampers that
push where their spoke is shorter than the wheel's radius; no effective road, no footprint map.  Runge-Kutta of fourth
order with steps of half a millisecond, all runs of a campaign side by side.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import cycle, product
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from campaign_files import HEADING_DEG, sensor_columns, write_log, write_scan
from scipy.linalg import null_space
from scipy.optimize import brentq

GRAVITY = 9.81
STEP_S = 0.0005
INTERVAL_S = 0.005
SPOKES = np.radians(np.linspace(-60.0, 60.0, 91))
SPOKE_EXPONENT = 0.7
#: Time constant with which a driver holds the speed.
HOLD_S = 0.05
NOISE = {"lvdt": 2.5e-4, "axle": 0.25, "frame": 0.15}
BUMP_M, LENGTH_M = 0.075, 0.9


@dataclass(frozen=True)
class Bending:
    """A frame that bends: frequency [Hz] and damping ratio in the first load case, ends of its beam [m]."""

    frequency_hz: float
    damping_ratio: float
    ends_m: tuple[float, float]


@dataclass(frozen=True)
class IndependentTruck:
    """Numbers of a truck, per axle and per body, SI; `hitch` (x, height) of every body but the first.

    `rocker` the axles that one joins, and `share` of it; `bending` by body, None for rigid ones.  `load_cases` by name:
    axle loads [kg], sprung masses [kg], pitch inertias [kg m2], heights of the centres of gravity [m].
    """

    body: tuple[int, ...]
    x_m: tuple[float, ...]
    unsprung_kg: tuple[float, ...]
    radius_m: tuple[float, ...]
    tire_N_per_m: tuple[float, ...]
    tire_N_s_per_m: tuple[float, ...]
    stiffness: tuple[float, ...]
    damping: tuple[float, ...]
    load_cases: dict[str, tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...], tuple[float, ...]]]
    suspension: tuple[str, ...]
    hitch: tuple[tuple[float, float], ...] = ()
    rocker: tuple[int, ...] = ()
    share: float = 0.0
    bending: tuple[Bending | None, ...] = ()
    names: tuple[str, ...] = field(default=())

    @property
    def bodies(self) -> int:
        """Number of bodies."""
        return len(self.hitch) + 1


def free_beam_shape(t: np.ndarray) -> np.ndarray:
    """First bending mode of a free uniform beam at t in [0, 1], 2 at its ends: cos b cosh b = 1."""
    b = brentq(lambda v: np.cos(v) * np.cosh(v) - 1.0, 4.0, 5.0)
    ratio = (np.cosh(b) - np.cos(b)) / (np.sinh(b) - np.sin(b))
    return np.cosh(b * t) + np.cos(b * t) - ratio * (np.sinh(b * t) + np.sin(b * t))


class Equations:
    """Matrices of a truck in one load case, in coordinates that the hinges leave free."""

    def __init__(self, truck: IndependentTruck, case: str) -> None:
        loads, sprung, inertia, height = (np.array(v, float) for v in truck.load_cases[case])
        x, body = np.array(truck.x_m), np.array(truck.body)
        unsprung = np.array(truck.unsprung_kg)
        nb, na = truck.bodies, x.size
        bends = [b for b in range(nb) if truck.bending and truck.bending[b] is not None]
        unit = np.eye(3 * nb + len(bends) + na)
        xi, z, theta = unit[0 : 3 * nb : 3], unit[1 : 3 * nb : 3], unit[2 : 3 * nb : 3]
        eta = {b: unit[3 * nb + k] for k, b in enumerate(bends)}
        cg, hinge_load = self._statics(truck, loads, sprung)
        shapes = {b: self._shape(truck, b, sprung[b], inertia[b], cg[b]) for b in bends}

        def up(b: int, at: float) -> np.ndarray:
            row = z[b] - theta[b] * (at - cg[b])
            return row + shapes[b][0](at) * eta[b] if b in eta else row

        def ahead(b: int, h: float) -> np.ndarray:
            return xi[b] - theta[b] * (h - height[b])

        mass = sum(
            sprung[b] * (np.outer(z[b], z[b]) + np.outer(xi[b], xi[b])) + inertia[b] * np.outer(theta[b], theta[b])
            for b in range(nb)
        )
        stiff, damp = np.zeros_like(mass), np.zeros_like(mass)
        for b in bends:
            # The frame is as stiff in all load cases: its frequency is declared in the first.
            first = truck.load_cases[next(iter(truck.load_cases))]
            first_cg, _ = self._statics(truck, np.array(first[0]), np.array(first[1]))
            modal = self._shape(truck, b, first[1][b], first[2][b], first_cg[b])[1]
            omega, zeta = 2 * np.pi * truck.bending[b].frequency_hz, truck.bending[b].damping_ratio
            mass += shapes[b][1] * np.outer(eta[b], eta[b])
            stiff += modal * omega**2 * np.outer(eta[b], eta[b])
            damp += modal * 2 * zeta * omega * np.outer(eta[b], eta[b])
        forward = np.array([ahead(body[i], truck.radius_m[i]) for i in range(na)])
        for i in range(na):
            zi = unit[3 * nb + len(bends) + i]
            mass += unsprung[i] * (np.outer(zi, zi) + np.outer(forward[i], forward[i]))
        support = (loads - unsprung) * GRAVITY
        tilt = [float((support * (np.array(truck.radius_m) - height[b]))[body == b].sum()) for b in range(nb)]
        rows = []
        for b, (at, h) in enumerate(truck.hitch, start=1):
            rows += [up(b - 1, at) - up(b, at), ahead(b - 1, h) - ahead(b, h)]
            tilt[b - 1] -= hinge_load[b] * (h - height[b - 1])
            tilt[b] += hinge_load[b] * (h - height[b])
        stiff += sum(t * np.outer(theta[b], theta[b]) for b, t in enumerate(tilt))
        damp += loads.sum() / HOLD_S * np.outer(xi[0], xi[0])
        free = null_space(np.array(rows)) if rows else np.eye(mass.shape[0])
        # Per unit of acceleration: inertia forces of all masses, and forces at the ground that overcome them, shared as
        # the axle loads are; torques of brakes and shafts turn the bodies.
        ground = np.array([ahead(body[i], 0.0) for i in range(na)])
        driven = loads @ ground - mass @ xi.sum(axis=0)
        extension = np.array([up(body[i], x[i]) - unit[3 * nb + len(bends) + i] for i in range(na)])
        through = np.eye(na)
        members = list(truck.rocker)
        if members:
            through[np.ix_(members, members)] = (1 - truck.share) * np.eye(len(members)) + truck.share / len(members)
        inverse = np.linalg.inv(free.T @ mass @ free)
        self.extension = extension @ free
        self.wheel = unit[3 * nb + len(bends) :] @ free
        self.forward = forward @ free
        self.points = np.array([up(body[i], x[i]) for i in range(na)]) @ free
        self.stiffness, self.damping = (inverse @ free.T @ m @ free for m in (stiff, damp))
        self.spring = through @ np.diag(truck.stiffness)
        self.damper = np.diag(truck.damping)
        self.push = inverse @ self.extension.T
        self.lift = inverse @ self.wheel.T
        self.drive = inverse @ self.forward.T
        self.static = loads * GRAVITY
        self.shift = inverse @ free.T @ driven

    @staticmethod
    def _statics(truck: IndependentTruck, loads: np.ndarray, sprung: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Centres of gravity and hinge loads, last body first."""
        support = (loads - np.array(truck.unsprung_kg)) * GRAVITY
        body, x = np.array(truck.body), np.array(truck.x_m)
        cg, hinge = np.zeros(truck.bodies), np.zeros(truck.bodies)
        behind, behind_x = 0.0, 0.0
        for b in reversed(range(truck.bodies)):
            own, weight = body == b, sprung[b] * GRAVITY
            if b == 0:
                cg[b] = (support[own] @ x[own] - behind * behind_x) / (support[own].sum() - behind)
                break
            at = truck.hitch[b - 1][0]
            hinge[b] = weight + behind - support[own].sum()
            cg[b] = (support[own] @ x[own] + hinge[b] * at - behind * behind_x) / weight
            behind, behind_x = hinge[b], at
        return cg, hinge

    @staticmethod
    def _shape(truck: IndependentTruck, b: int, mass: float, inertia: float, cg: float):
        """Shape and modal mass: bending of a free beam, less heave and pitch of a uniform beam with end masses."""
        low, high = truck.bending[b].ends_m
        length = high - low
        nodes, weights = np.polynomial.legendre.leggauss(60)
        at, ds = 0.5 * (low + high) + 0.5 * length * nodes, 0.5 * length * weights
        # Uniform mass and two end masses of the given mass, centre and inertia.
        a = np.array(
            [
                [length, 1.0, 1.0],
                [ds @ (at - cg), low - cg, high - cg],
                [ds @ (at - cg) ** 2, (low - cg) ** 2, (high - cg) ** 2],
            ]
        )
        density, front, rear = np.linalg.solve(a, [mass, 0.0, inertia])
        where, lumps = np.append(at, [low, high]), np.append(density * ds, [front, rear])
        beam = free_beam_shape((where - low) / length)
        heave, pitch = lumps @ beam / mass, lumps @ (beam * (where - cg)) / inertia

        def shape(x: float) -> float:
            return float(free_beam_shape(np.array((x - low) / length)) - heave - pitch * (x - cg))

        return shape, float(lumps @ (beam - heave - pitch * (where - cg)) ** 2)


def height(s):
    """The bump, a raised cosine about s = 0."""
    inside = jnp.abs(s) < 0.5 * LENGTH_M
    return jnp.where(inside, 0.5 * BUMP_M * (1.0 + jnp.cos(2 * jnp.pi * s / LENGTH_M)), 0.0)


def slope(s):
    """Slope of the bump."""
    inside = jnp.abs(s) < 0.5 * LENGTH_M
    return jnp.where(inside, -jnp.pi * BUMP_M / LENGTH_M * jnp.sin(2 * jnp.pi * s / LENGTH_M), 0.0)


def shortening(s, h, radius):
    """By how much the road shortens every spoke of a wheel with its centre at station s and height h, (..., spokes)."""
    sine, cosine = jnp.sin(SPOKES), jnp.cos(SPOKES)
    rho = h[..., None] / cosine
    for _ in range(4):  # Newton's method
        at = s[..., None] + rho * sine
        rho = rho + (h[..., None] - rho * cosine - height(at)) / (cosine + slope(at) * sine)
    return radius[..., None] - rho


def flat_force(radius: float, sunk: float) -> float:
    """Vertical force of spokes of unit stiffness per radian, the centre `sunk` below the radius over a flat road."""
    shorter = np.maximum(radius - (radius - sunk) / np.cos(SPOKES), 0.0)
    return float(np.trapezoid(np.cos(SPOKES) * shorter**SPOKE_EXPONENT, SPOKES))


def spokes(radius: float, load: float, stiffness: float, damping: float) -> tuple[float, float]:
    """Stiffness and damping per radian of spokes whose tangents on a flat road at `load` are the given ones."""

    def sunk_under(spring: float) -> float:
        return brentq(lambda d: spring * flat_force(radius, d) - load, 1e-6, 0.25)

    def excess(log_spring: float) -> float:
        spring = np.exp(log_spring)
        sunk = sunk_under(spring)
        return spring * (flat_force(radius, sunk + 1e-5) - flat_force(radius, sunk - 1e-5)) / 2e-5 - stiffness

    spring = float(np.exp(brentq(excess, 13.0, 18.0)))
    touching = radius - (radius - sunk_under(spring)) / np.cos(SPOKES) > 0.0
    return spring, damping / float(np.trapezoid(np.where(touching, 1.0, 0.0), SPOKES))


def rest_height(radius: float, load: float, spring: float) -> float:
    """Height of a wheel's centre at which a flat road carries `load` [N]."""
    return radius - brentq(lambda d: spring * flat_force(radius, d) - load, 1e-6, 0.25)


def simulate(
    truck: IndependentTruck, runs: list[tuple[str, float, float, float]], seconds: float, *, load_shift: bool = False
) -> np.ndarray:
    """Readings (T, runs, 3 na): deflections, axle and frame accelerations.

    Runs are of (load case, speed and start at axle 1, share by which the speed changes until the last axle passes), at
    constant acceleration; with `load_shift` its inertia forces lean the truck, which begins in that equilibrium.
    """
    each = [Equations(truck, case) for case, *_ in runs]
    m = {n: jnp.asarray(np.stack([getattr(e, n) for e in each])) for n in vars(each[0])}
    speed, start, change = (jnp.asarray([r[k] for r in runs])[:, None] for k in (1, 2, 3))
    acceleration = ((speed * (1.0 + change)) ** 2 - speed**2) / (2.0 * truck.x_m[-1])
    leaning = float(load_shift) * acceleration * m.pop("shift")
    first = np.array(next(iter(truck.load_cases.values()))[0]) * GRAVITY
    tires = [spokes(*v) for v in zip(truck.radius_m, first, truck.tire_N_per_m, truck.tire_N_s_per_m, strict=True)]
    rest = jnp.asarray(
        [[rest_height(r, f, k) for r, f, (k, _) in zip(truck.radius_m, e.static, tires, strict=True)] for e in each]
    )
    spring, damper = jnp.asarray(tires).T
    radius, x = jnp.asarray(truck.radius_m), jnp.asarray(truck.x_m)
    sine, cosine, turn = jnp.sin(SPOKES), jnp.cos(SPOKES), float(SPOKES[1] - SPOKES[0])

    def dot(a, v):
        return jnp.einsum("rij,rj->ri", a, v)

    def accelerations(t, q, v):
        tau = t - start
        s = speed * tau + 0.5 * acceleration * tau**2 - x + dot(m["forward"], q)
        h = rest + dot(m["wheel"], q)
        s_rate, h_rate = speed + acceleration * tau + dot(m["forward"], v), dot(m["wheel"], v)
        delta, rate = jax.jvp(lambda s, h: shortening(s, h, radius), (s, h), (s_rate, h_rate))
        touching = delta > 0.0
        force = jnp.where(touching, spring[:, None] * jnp.where(touching, delta, 1.0) ** SPOKE_EXPONENT, 0.0)
        force = jnp.maximum(force + jnp.where(touching, damper[:, None] * rate, 0.0), 0.0)
        # Spokes of the flat road about the ends count half: both ends are clear of it.
        vertical, along = (turn * (force * w).sum(axis=-1) for w in (cosine, -sine))
        pull = dot(m["spring"], dot(m["extension"], q)) + dot(m["damper"], dot(m["extension"], v))
        return (
            -dot(m["stiffness"], q)
            - dot(m["damping"], v)
            - dot(m["push"], pull)
            + dot(m["lift"], vertical - m["static"])
            + dot(m["drive"], along)
            + leaning
        )

    def step(state, number):
        q, v = state
        t, h = number * STEP_S, STEP_S
        a1 = accelerations(t, q, v)
        a2 = accelerations(t + h / 2, q + h / 2 * v, v + h / 2 * a1)
        a3 = accelerations(t + h / 2, q + h / 2 * v + h * h / 4 * a1, v + h / 2 * a2)
        a4 = accelerations(t + h, q + h * v + h * h / 2 * a2, v + h * a3)
        new = q + h * v + h * h / 6 * (a1 + a2 + a3), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        seen = jnp.concatenate([dot(m["extension"], q), dot(m["wheel"], a1), dot(m["points"], a1)], axis=1)
        return new, seen

    substeps = round(INTERVAL_S / STEP_S)
    still = jnp.zeros((len(runs), m["push"].shape[1]))

    def at_rest(q):
        # Nothing holds a truck fore and aft: the smallest motion that balances everything else.
        def left(flat):
            return accelerations(0.0, flat.reshape(q.shape), still).ravel()

        for _ in range(8 if load_shift else 0):  # Newton's method
            q = q - jnp.linalg.lstsq(jax.jacfwd(left)(q.ravel()), left(q.ravel()))[0].reshape(q.shape)
        return q

    @jax.jit
    def all_steps(state):
        def sample(state, k):
            first, seen = step(state, k * substeps)
            rest_of, _ = jax.lax.scan(lambda s, j: (step(s, k * substeps + j)[0], None), first, jnp.arange(1, substeps))
            return rest_of, seen

        return jax.lax.scan(sample, state, jnp.arange(round(seconds / INTERVAL_S)))[1]

    return np.asarray(all_steps((at_rest(still), still)))


def write_truck_campaign(
    folder: Path,
    truck: IndependentTruck,
    *,
    declare: str = "",
    bending: str = "",
    speeds=(8.0, 16.0, 24.0),
    changes=(0.0,),
    load_shift: bool = False,
    of_runs: str = "",
    seed: int = 1,
) -> dict[str, tuple[float, float]]:
    """A campaign folder with a scan and one run per load case and speed [km/h]; declared masses are the true ones.

    `declare` is text after the axles, such as a group; `bending` a key of the last body; `changes` of the speed over a
    passage are taken by the runs in turn, `load_shift` as in :func:`simulate`; `of_runs` a key of every run.  Returns
    speed at axle 1 [m/s] and its change by the file of a run.
    """
    rng = np.random.default_rng(seed)
    (folder / "bump_runs").mkdir(parents=True, exist_ok=True)
    write_scan(folder / "bump_scan.csv", lambda s: np.asarray(height(s)), 0.5 * LENGTH_M, 20_000, 0.0015, rng)
    runs = [
        (case, v / 3.6 * (1.0 + 0.01 * rng.normal()), rng.uniform(0.7, 1.2), change, v)
        for (case, v), change in zip(product(truck.load_cases, speeds), cycle(changes))
    ]
    length = [r[2] + (truck.x_m[-1] + LENGTH_M) / (r[1] * (1.0 + min(r[3], 0.0))) + 2.0 for r in runs]
    clean = simulate(truck, [r[:4] for r in runs], max(length), load_shift=load_shift)
    columns, kinds = sensor_columns(len(truck.x_m))
    sd = np.array([NOISE[k] for k in kinds])
    lines, driven = [], {}
    for r, (case, speed, _, change, v) in enumerate(runs):
        file = f"bump_runs/{case}_{v:g}.csv"
        values = clean[: int(length[r] / INTERVAL_S), r]
        gain = 1.0 + 0.003 * rng.normal(size=sd.size)
        values = gain * values + sd * (rng.normal(size=values.shape) + 4.0 * rng.uniform(-1.0, 1.0, sd.size))
        write_log(folder / file, INTERVAL_S, columns, kinds, values)
        driven[file] = speed, change
        key = f", {of_runs}" if of_runs else ""
        lines.append(
            f'  {{ case = "{case} {v:g}", file = "{file}", load_case = "{case}", nominal_speed_km_h = {v:g}{key} }},'
        )
    text = _campaign_text(truck, declare, bending, lines)
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    return driven


def _campaign_text(truck: IndependentTruck, declare: str, bending: str, runs: list[str]) -> str:
    lines = ["schema = 1", "", "[campaign]", 'title = "Synthetic campaign of an independent truck"', "", "[vehicle]"]
    lines += ['name = "independent truck"', ""]
    for b in range(truck.bodies):
        lines += ["[[vehicle.body]]", f'name = "body {b + 1}"']
        if b:
            lines += [f"hitch_x_m = {truck.hitch[b - 1][0]}", f"hitch_height_m = {truck.hitch[b - 1][1]}"]
        if b == truck.bodies - 1 and bending:
            lines.append(bending)
        lines.append("")
    for i, x in enumerate(truck.x_m):
        lines += [
            "[[vehicle.axle]]",
            f'name = "axle {i + 1}"',
            f'body = "body {truck.body[i] + 1}"',
            f"x_m = {x}",
            f"unsprung_mass_kg = {truck.unsprung_kg[i]}",
            f"tire_stiffness_N_per_m = {truck.tire_N_per_m[i]}",
            f"tire_damping_N_s_per_m = {truck.tire_N_s_per_m[i]}",
            f"tire_radius_m = {truck.radius_m[i]}",
            f'suspension = "{truck.suspension[i]}"',
            "load_dependent = false",
            "",
        ]
    lines += [declare, ""]
    for case, (loads, sprung, inertia, tall) in truck.load_cases.items():
        lines += [
            f"[load_case.{case}]",
            f"axle_loads_kg = {list(loads)}",
            f"sprung_mass_kg = {list(sprung)}",
            f"pitch_inertia_kg_m2 = {list(inertia)}",
            f"cg_height_m = {list(tall)}",
            "",
        ]
    lines += ["[acquisition]", f"sample_interval_s = {INTERVAL_S}", "", "[sensors.bump_run]"]
    columns, kinds = sensor_columns(len(truck.x_m))
    for k, (column, kind) in enumerate(zip(columns, kinds, strict=True)):
        i = k % len(truck.x_m)
        if kind == "frame":
            place = f'kind = "body_acceleration", body = "body {truck.body[i] + 1}", x_m = {truck.x_m[i]}, unit = "g"'
        else:
            what, unit = ("suspension_deflection", "mm") if kind == "lvdt" else ("axle_acceleration", "g")
            place = f'kind = "{what}", axle = "axle {i + 1}", unit = "{unit}"'
        lines.append(f"{column} = {{ {place} }}")
    lines += ["", "[scan]", 'file = "bump_scan.csv"', f"heading_deg = {HEADING_DEG}", "", "[tests]", "bump_run = ["]
    return "\n".join([*lines, *runs, "]", ""])


#: A rigid three-axle truck on leaf springs whose tandem shares 80 % of its load over a rocker.
THREE_AXLES = IndependentTruck(
    body=(0, 0, 0),
    x_m=(0.0, 4.2, 5.55),
    unsprung_kg=(520.0, 900.0, 860.0),
    radius_m=(0.48, 0.5, 0.5),
    tire_N_per_m=(1.65e6, 2.9e6, 2.7e6),
    tire_N_s_per_m=(2200.0, 3000.0, 2900.0),
    stiffness=(4.3e5, 9.5e5, 8.0e5),
    damping=(1.05e4, 1.6e4, 1.4e4),
    load_cases={
        "empty": ((4100.0, 3300.0, 2880.0), (8000.0,), (25000.0,), (1.15,)),
        "laden": ((5400.0, 8600.0, 8280.0), (20000.0,), (46000.0,), (1.55,)),
    },
    suspension=("leaf", "leaf", "leaf"),
    rocker=(1, 2),
    share=0.8,
)

#: A tractor with a lowboy whose frame bends at 8 Hz.
LOWBOY = IndependentTruck(
    body=(0, 0, 0, 1, 1, 1),
    x_m=(0.0, 4.07, 5.39, 13.33, 14.63, 15.93),
    unsprung_kg=(540.0, 1050.0, 1050.0, 740.0, 740.0, 740.0),
    radius_m=(0.5, 0.5, 0.5, 0.42, 0.42, 0.42),
    tire_N_per_m=(1.65e6, 2.9e6, 2.9e6, 2.9e6, 2.9e6, 2.9e6),
    tire_N_s_per_m=(2200.0, 3000.0, 3000.0, 3000.0, 3000.0, 3000.0),
    stiffness=(4.2e5, 4.0e5, 4.4e5, 1.0e6, 9.2e5, 1.08e6),
    damping=(1.1e4, 1.4e4, 1.3e4, 1.2e4, 1.25e4, 1.3e4),
    load_cases={
        "empty": ((3955.0, 2676.0, 3012.0, 3021.0, 3447.0, 3946.0), (5103.0, 10094.0), (18000.0, 150000.0), (1.0, 1.2)),
        "laden": ((4300.0, 6200.0, 6500.0, 7400.0, 7800.0, 8200.0), (5103.0, 30437.0), (18000.0, 450000.0), (1.0, 1.5)),
    },
    suspension=("leaf", "air", "air", "leaf", "leaf", "leaf"),
    hitch=((4.43, 1.2),),
    bending=(None, Bending(8.0, 0.025, (4.43, 15.93))),
)
