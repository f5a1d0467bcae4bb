"""Trucks whose equations are written out here, apart from the package: rockers, bending frames, hinges.

Coordinates p: travel, heave and pitch of every body, the amplitude of every frame that bends, heave of every axle.
Hinges are constraints, taken out by a null space of their rows.  :mod:`independent_motion` integrates them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space
from scipy.optimize import brentq

GRAVITY = 9.81
#: Time constant with which a driver holds the speed.
HOLD_S = 0.05


@dataclass(frozen=True)
class Bending:
    """A frame that bends: frequency [Hz] and damping ratio in the first load case, ends of its beam [m]."""

    frequency_hz: float
    damping_ratio: float
    ends_m: tuple[float, float]


@dataclass(frozen=True)
class Cab:
    """A part of the first body that stands at `x_m` on a spring and a damper of its own, and only heaves."""

    mass_kg: float
    x_m: float
    frequency_hz: float
    damping_ratio: float


@dataclass(frozen=True)
class Elements:
    """What the suspension of an axle has beside its spring and damper; none of it by default.

    `friction_share` of the static force of the suspension, reached over some `slip_length_m`; damper force
    c q' r / (1 + |q'| / knee), r = `bump_ratio` in compression and `rebound_ratio` in rebound; air spring
    k q (1 + a q / 2 + b q^2 / 3) with `air` = (a [1/m], b [1/m2]), its k as the static force to the power
    `load_exponent`; stops beyond the travels, which are `declared` or not, k_s d (1 + d / 15 mm).

    Physics that no law of the package has: friction falls by the share `fading` at rates well above 0.1 m/s; a rubber
    of `bushing_m_per_N` in series with the damper (whose knee is then far away); a second leaf of `helper_N_per_m`
    beyond `helper_m` of jounce.
    """

    friction_share: float = 0.0
    slip_length_m: float = 0.0015
    bump_ratio: float = 1.0
    rebound_ratio: float = 1.0
    knee_m_per_s: float = 1e9
    air: tuple[float, float] = (0.0, 0.0)
    load_exponent: float = 0.0
    jounce_m: float = 1.0
    rebound_m: float = 1.0
    stop_N_per_m: float = 2.0e6
    declared: bool = True
    fading: float = 0.0
    bushing_m_per_N: float = 0.0
    helper_N_per_m: float = 0.0
    helper_m: float = 1.0


@dataclass(frozen=True)
class IndependentTruck:
    """Numbers of a truck, per axle and per body, SI; `hitch` (x, height) of every body but the first.

    `rocker` the axles that one joins, and `share` of it; `bending` by body, None for rigid ones.  `load_cases` by name:
    axle loads [kg], sprung masses [kg], pitch inertias [kg m2], heights of the centres of gravity [m], all with the
    `cab`.  `stiffness` of the first load case; `roughness_m3` of the road, displacement spectrum at 0.1 cycles/m; a
    spoke's force grows with its shortening to the power `spoke_exponent`.
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
    elements: tuple[Elements, ...] = ()
    roughness_m3: float = 0.0
    road_seed: int = 5
    spoke_exponent: float = 0.7
    cab: Cab | None = None

    def stiffness_of(self, case: str) -> np.ndarray:
        """Stiffness of every suspension in a load case [N/m]."""
        unsprung = np.array(self.unsprung_kg)
        first = np.array(next(iter(self.load_cases.values()))[0]) - unsprung
        power = np.array([e.load_exponent for e in self.elements or (Elements(),) * len(self.x_m)])
        return np.array(self.stiffness) * ((np.array(self.load_cases[case][0]) - unsprung) / first) ** power

    def secant_damping(self, velocity_m_per_s: float = 0.5) -> np.ndarray:
        """Mean of compression and rebound of force over velocity [N s/m]."""
        each = self.elements or (Elements(),) * len(self.x_m)
        knee = np.array([e.knee_m_per_s for e in each])
        ratio = np.array([0.5 * (e.bump_ratio + e.rebound_ratio) for e in each])
        return np.array(self.damping) * ratio / (1.0 + velocity_m_per_s / knee)

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
        above = 3 * nb + len(bends) + (truck.cab is not None)
        unit = np.eye(above + na)
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
        if truck.cab is not None:
            # Its motion against the frame is a coordinate; the body's masses hold it as if it moved with the frame.
            part, frame, against = truck.cab, up(0, truck.cab.x_m), unit[above - 1]
            mass += part.mass_kg * (np.outer(frame + against, frame + against) - np.outer(frame, frame))
            spring = part.mass_kg * (2 * np.pi * part.frequency_hz) ** 2
            stiff += spring * np.outer(against, against)
            damp += 2 * part.damping_ratio * np.sqrt(spring * part.mass_kg) * np.outer(against, against)
        forward = np.array([ahead(body[i], truck.radius_m[i]) for i in range(na)])
        for i in range(na):
            zi = unit[above + i]
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
        extension = np.array([up(body[i], x[i]) - unit[above + i] for i in range(na)])
        through = np.eye(na)
        members = list(truck.rocker)
        if members:
            through[np.ix_(members, members)] = (1 - truck.share) * np.eye(len(members)) + truck.share / len(members)
        inverse = np.linalg.inv(free.T @ mass @ free)
        self.extension = extension @ free
        self.wheel = unit[above:] @ free
        self.forward = forward @ free
        self.points = np.array([up(body[i], x[i]) for i in range(na)]) @ free
        self.stiffness, self.damping = (inverse @ free.T @ m @ free for m in (stiff, damp))
        self.through = through
        self.suspension = truck.stiffness_of(case)
        self.carried = support
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
        """Shape and modal mass: bending of a free beam, less heave and pitch of a body of that mass and inertia.

        A uniform beam with end masses; where one of these would be negative, a uniform beam of 30 % of the mass and two
        equal masses on it.
        """
        low, high = truck.bending[b].ends_m
        length = high - low
        nodes, weights = np.polynomial.legendre.leggauss(60)
        at, ds = 0.5 * (low + high) + 0.5 * length * nodes, 0.5 * length * weights
        a = np.array(
            [
                [length, 1.0, 1.0],
                [ds @ (at - cg), low - cg, high - cg],
                [ds @ (at - cg) ** 2, (low - cg) ** 2, (high - cg) ** 2],
            ]
        )
        density, *lumps = np.linalg.solve(a, [mass, 0.0, inertia])
        places = [low, high]
        if min(lumps) < 0.0:
            density, lumps = 0.3 * mass / length, [0.35 * mass] * 2
            centre = cg - density * (ds @ (at - cg)) / (0.7 * mass)
            rest = inertia - density * (ds @ (at - cg) ** 2)
            apart = np.sqrt(rest / (0.7 * mass) - (centre - cg) ** 2)
            places = [centre - apart, centre + apart]
        where, lumps = np.append(at, places), np.append(density * ds, lumps)
        beam = free_beam_shape((where - low) / length)
        heave, pitch = lumps @ beam / mass, lumps @ (beam * (where - cg)) / inertia

        def shape(x: float) -> float:
            return float(free_beam_shape(np.array((x - low) / length)) - heave - pitch * (x - cg))

        return shape, float(lumps @ (beam - heave - pitch * (where - cg)) ** 2)


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
