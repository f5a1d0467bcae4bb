"""Equations of motion of a made truck, all runs of a campaign side by side.

Coordinates of each body are fore-aft motion, heave, pitch (nose up) and roll (left up), of each axle heave and roll, of
each mass on own springs heave.  All are small, so every point moves by a constant row times the coordinates: masses are
M = sum m_i j_i j_i^T, forces Q = sum f_i j_i.  Hinges are constraints, taken out by a basis of their null space.  Laws
act on the motion from rest: preloads and weight cancel, but for the moments of those that act off the centre of gravity
of a body that turns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from studies.made_trucks.contact import Contact
from studies.made_trucks.truck import GRAVITY, Array, Truck

_SPRINGS_ABOVE_WHEEL_CENTRE_M = 0.15  # leaf packs on top of their axles, assumption
_HINGE_DAMPING_RATIO = 0.025  # welded and bolted frames in bending: 2 to 3 %, assumption


@dataclass(frozen=True)
class Lane:
    """One run: axle 1 is at `station_m` of the road at time 0.  A drop lifts `plank_axle` before it rolls off."""

    case: int
    speed_m_s: float
    station_m: float
    profile: tuple[int, int] = (0, 0)  # tables of left and right wheels
    skew_rad: float = 0.0  # the bump lies turned, its left end further
    rough: tuple[Array, Array] | None = None  # heights left and right every 0.02 m from `rough_from_m`
    rough_from_m: float = 0.0
    plank_axle: int | None = None
    plank_m: float = 0.0
    damper_scale: float = 1.0


@dataclass(frozen=True)
class History:
    """Motion at the steps: coordinates and accelerations (time, lane, n), wheel loads (time, lane, wheel)."""

    time_s: Array
    position: Array
    acceleration: Array
    wheel_load_n: Array


class Rows:
    """Rows of a load case over the free coordinates."""

    def __init__(self, truck: Truck, case: int) -> None:
        """Assemble masses, constraints and linear springs."""
        self.truck, self.case = truck, case
        of = truck.load_cases[case]
        self.cg_x = list(truck.cg_x_m(case))
        self.cg_h = list(of.cg_height_m)
        self.of_axle = list(truck.axle_body)
        masses, pitch, roll = list(of.body_mass_kg), list(of.pitch_inertia_kg_m2), list(of.roll_inertia_kg_m2)
        for own in truck.own_springs:
            mass, b = own.mass_kg[case], own.body
            rest = masses[b] - mass
            x, h = (
                (masses[b] * c - mass * o) / rest for c, o in ((self.cg_x[b], own.x_m), (self.cg_h[b], own.height_m))
            )
            away = (self.cg_x[b] - own.x_m) ** 2 + (self.cg_h[b] - own.height_m) ** 2
            moved = (self.cg_x[b] - x) ** 2 + (self.cg_h[b] - h) ** 2
            pitch[b] -= mass * away + rest * moved
            masses[b], self.cg_x[b], self.cg_h[b] = rest, x, h
            if pitch[b] < 0.2 * of.pitch_inertia_kg_m2[b]:
                raise ValueError("a mass on own springs takes too much of the inertia of its body")
        hinge = self._halve(masses, pitch, roll) if truck.frame_hinge_hz else None
        bodies = len(masses)
        self.first_axle, self.first_own = 4 * bodies, 4 * bodies + 2 * truck.axles
        self.full = self.first_own + len(truck.own_springs)
        rows: list[Array] = []
        if len(of.body_mass_kg) > 1:
            at = truck.hitch_x_m, truck.hitch_height_m
            rows += [self._up(0, at[0]) - self._up(1, at[0]), self._forward(0, at[1]) - self._forward(1, at[1])]
        if hinge is not None:
            b, x, h = hinge
            rows += [self._up(b, x) - self._up(b + 1, x), self._forward(b, h) - self._forward(b + 1, h)]
            rows.append(self._unit(4 * b + 3) - self._unit(4 * b + 7))
        basis = null_space(np.array(rows)) if rows else np.eye(self.full)
        inertia = [(m, self._unit(4 * b + k)) for b in range(bodies) for k, m in enumerate((masses[b],) * 2)]
        inertia += [(j, self._unit(4 * b + 2)) for b, j in enumerate(pitch)]
        inertia += [(j, self._unit(4 * b + 3)) for b, j in enumerate(roll)]
        for a in range(truck.axles):
            inertia += [
                (truck.unsprung_kg[a], self._unit(self.first_axle + 2 * a)),
                (truck.unsprung_kg[a], self.wheel_forward(a)),
                (truck.axle_roll_inertia_kg_m2[a], self._unit(self.first_axle + 2 * a + 1)),
            ]
        linear: list[tuple[float, float, Array]] = []
        for a in range(truck.axles):
            turn = self._unit(4 * self.of_axle[a] + 3) - self._unit(self.first_axle + 2 * a + 1)
            linear.append((truck.auxiliary_roll_n_m[a], 0.01 * truck.auxiliary_roll_n_m[a], turn))
        if len(of.body_mass_kg) > 1:
            linear.append((truck.hitch_roll_n_m, 0.01 * truck.hitch_roll_n_m, self._unit(3) - self._unit(7)))
        for n, own in enumerate(truck.own_springs):
            row, omega = self._unit(self.first_own + n), 2.0 * np.pi * own.frequency_hz
            inertia += [(own.mass_kg[case], row), (own.mass_kg[case], self._forward(own.body, own.height_m))]
            stiffness = own.mass_kg[case] * omega**2
            linear.append((stiffness, 2.0 * own.damping_ratio * stiffness / omega, self._up(own.body, own.x_m) - row))
        # Static forces turn with the body that they act on, away from the height of its centre of gravity: weight tips
        # it over.  Axles pitch with their body; it rolls over them about the height of its springs.
        for angle, height_m in ((2, truck.radius_m), (3, truck.radius_m + _SPRINGS_ABOVE_WHEEL_CENTRE_M)):
            for b in range(bodies):
                forces = [(truck.spring_load_n(case)[a], height_m) for a, on in enumerate(self.of_axle) if on == b]
                forces += [(-GRAVITY * o.mass_kg[case], o.height_m) for o in truck.own_springs if o.body == b]
                if len(of.body_mass_kg) > 1 and b < 2:
                    hitch_n = GRAVITY * truck.hitch_load_kg(case)
                    forces.append((hitch_n if b else -hitch_n, truck.hitch_height_m))
                tipping = sum(f * (h - self.cg_h[b]) for f, h in forces)
                linear.append((tipping, 0.0, self._unit(4 * b + angle)))
        full = sum(m * np.outer(j, j) for m, j in inertia)
        self.mass = basis.T @ full @ basis
        self.basis = basis
        if hinge is not None:
            b = hinge[0]
            bend = self._unit(4 * b + 2) - self._unit(4 * b + 6)
            # The free frame by itself: both halves on the hinge, nothing else.
            own_rows = np.array([self._up(b, hinge[1]) - self._up(b + 1, hinge[1])])
            keep = [4 * b + 1, 4 * b + 2, 4 * b + 5, 4 * b + 6]
            free = null_space(own_rows[:, keep])
            m = free.T @ np.diag([masses[b], pitch[b], masses[b + 1], pitch[b + 1]]) @ free
            compliance = (free.T @ bend[keep]) @ np.linalg.solve(m, free.T @ bend[keep])
            omega = 2.0 * np.pi * truck.frame_hinge_hz
            stiffness = omega**2 / compliance
            linear.append((stiffness, 2.0 * _HINGE_DAMPING_RATIO * stiffness / omega, bend))
        zero = np.zeros((basis.shape[1],) * 2)
        self.stiffness = sum((k * np.outer(j @ basis, j @ basis) for k, _, j in linear), zero)
        self.damping = sum((c * np.outer(j @ basis, j @ basis) for _, c, j in linear), zero)
        sides = [(a, s) for a in range(truck.axles) for s in (0.5, -0.5)]
        slope = np.broadcast_to(truck.link_slope, (truck.axles,))
        self.springs = np.array([self.deflection(a, s * truck.spring_track_m[a]) for a, s in sides]) @ basis
        self.dampers = np.array([self.deflection(a, s * truck.damper_track_m[a]) for a, s in sides]) @ basis
        self.wheels = np.array([self.axle_up(a, s * truck.track_m[a]) for a, s in sides]) @ basis
        # A link leads the wheel aft in jounce, forward in extension.
        self.ahead = (
            np.array(
                [self.wheel_forward(a) + slope[a] * self.deflection(a, s * truck.spring_track_m[a]) for a, s in sides]
            )
            @ basis
        )
        held_m = self.cg_h[0] if truck.speed_hold_height_m is None else truck.speed_hold_height_m
        self.drive = self._forward(0, held_m) @ basis

    def _halve(self, masses: list[float], pitch: list[float], roll: list[float]) -> tuple[int, float, float]:
        """Split the last body at its middle into two halves of the same mass, centre and inertia together."""
        b = len(masses) - 1
        on = self.truck.axle_x_m[np.array(self.of_axle) == b]
        front = self.truck.hitch_x_m if b else float(on[0])
        apart = 0.55 * (float(on[-1]) - front)  # between the centres of the halves, assumption
        halves = 0.25 * masses[b] * apart**2
        if halves > 0.85 * pitch[b]:
            apart *= float(np.sqrt(0.85 * pitch[b] / halves))
            halves = 0.85 * pitch[b]
        at = self.cg_x[b]
        for values, half in ((masses, masses[b] / 2), (pitch, (pitch[b] - halves) / 2), (roll, roll[b] / 2)):
            values[b:] = [half, half]
        self.cg_x[b:] = [at - apart / 2, at + apart / 2]
        self.cg_h[b:] = [self.cg_h[b]] * 2
        for a, x in enumerate(self.truck.axle_x_m):
            if self.of_axle[a] == b and x > at:
                self.of_axle[a] = b + 1
        return b, at, self.cg_h[b]

    def _unit(self, n: int) -> Array:
        row = np.zeros(self.full)
        row[n] = 1.0
        return row

    def _up(self, body: int, x_m: float, y_m: float = 0.0) -> Array:
        return (
            self._unit(4 * body + 1)
            + (self.cg_x[body] - x_m) * self._unit(4 * body + 2)
            + y_m * self._unit(4 * body + 3)
        )

    def _forward(self, body: int, height_m: float) -> Array:
        """Nose up moves points below the centre of gravity forward."""
        return self._unit(4 * body) + (self.cg_h[body] - height_m) * self._unit(4 * body + 2)

    def axle_up(self, axle: int, y_m: float) -> Array:
        """Rise of an axle at a place across."""
        return self._unit(self.first_axle + 2 * axle) + y_m * self._unit(self.first_axle + 2 * axle + 1)

    def body_up(self, axle: int, y_m: float) -> Array:
        """Rise of the frame above an axle."""
        return self._up(self.of_axle[axle], self.truck.axle_x_m[axle], y_m)

    def deflection(self, axle: int, y_m: float) -> Array:
        """Extension of the suspension at a place across."""
        return self.body_up(axle, y_m) - self.axle_up(axle, y_m)

    def wheel_forward(self, axle: int) -> Array:
        """Forward motion of the wheel centres, without the motion of links."""
        return self._forward(self.of_axle[axle], self.truck.radius_m)


def tire_constants(truck: Truck) -> tuple[Array, Array]:
    """Factor A of F = A D^m per wheel, and damping per wheel, of tires with the tangent that the truck declares."""
    m = truck.tire_exponent
    load = 0.5 * GRAVITY * truck.load_cases[0].axle_load_kg
    factor = load * (0.5 * truck.tire_stiffness_n_per_m / (m * load)) ** m
    return truck.each(factor), truck.each(0.5 * truck.tire_damping_n_s_per_m)


class Equations:
    """Right-hand side for all lanes."""

    def __init__(self, truck: Truck, lanes: list[Lane], contact: Contact) -> None:
        """Gather what belongs to each lane."""
        self.truck, self.lanes, self.contact = truck, lanes, contact
        rows = [Rows(truck, case) for case in range(len(truck.load_cases))]
        case = np.array([lane.case for lane in lanes])
        self.cases = rows
        w = 2 * truck.axles
        self.w = w
        stack = [np.vstack([r.springs, r.dampers, r.wheels, r.ahead, r.drive[None]]) for r in rows]
        self.rows = np.array(stack)[case]
        self.mass = np.array([r.mass for r in rows])[case]
        self.by_force = np.array([np.linalg.solve(r.mass, s.T) for r, s in zip(rows, stack, strict=True)])[case]
        self.by_position = np.array([np.linalg.solve(r.mass, r.stiffness) for r in rows])[case]
        self.by_rate = np.array([np.linalg.solve(r.mass, r.damping) for r in rows])[case]
        self.spring_stiffness = np.array([r.stiffness for r in rows])[case]
        t = truck
        self.k = np.array([t.wheels(c.stiffness_n_per_m, t.left_spring_share) for c in t.load_cases])[case]
        spring_load = np.array([t.spring_load_n(n) for n in range(len(rows))])
        self.spring_load = np.array([t.wheels(v) for v in spring_load])[case]
        share = np.broadcast_to(t.left_damper_share, (t.axles,))
        scale = np.array([lane.damper_scale for lane in lanes])[:, None]
        self.rebound = scale * t.wheels(t.damper_rebound_n_s_per_m, share)
        self.jounce = scale * t.wheels(t.damper_jounce_n_s_per_m, share)
        self.saturation = t.each(t.damper_saturation_m_s)
        self.bushing = t.each(t.bushing_n_per_m) / 2.0
        self.has_bushing = bool(np.all(np.isfinite(self.bushing)))
        self.friction = t.each(t.friction_share) * self.spring_load
        self.helper_ratio = t.each(t.helper_ratio)
        # Compression still missing to the knee, negative beyond it, by the main spring of the first load case.
        knee = np.broadcast_to(t.helper_knee_n, (t.axles,))
        main = t.load_cases[0].stiffness_n_per_m
        past = np.array([t.each(np.minimum(_helper_gap(v, knee, main, t.helper_ratio), 9.0)) for v in spring_load])
        self.gap = past[case]
        self.main = np.array(t.wheels(main, t.left_spring_share))
        self.bellows = t.each(t.bellows_m)
        self.stop = t.each(t.jounce_m), t.each(t.rebound_m)
        factor, self.tire_c = tire_constants(t)
        speed = np.array([lane.speed_m_s for lane in lanes])
        self.factor = np.broadcast_to(factor, (len(lanes), w))
        self.static_load = np.array([t.wheels(GRAVITY * c.axle_load_kg, t.left_load_share) for c in t.load_cases])[case]
        self.static_depth = (self.static_load / self.factor) ** (1.0 / t.tire_exponent)
        self.speed = speed
        side = t.track_m[:, None] * np.array([0.5, -0.5])
        skew = np.array([np.tan(lane.skew_rad) for lane in lanes])
        first = np.array([lane.station_m for lane in lanes])
        x = np.repeat(t.axle_x_m, 2)
        self.station = first[:, None] - x - skew[:, None] * side.reshape(-1)
        self.profile = np.array([np.tile(lane.profile, t.axles) for lane in lanes])
        self.plank = np.zeros((len(lanes), w))
        self.flat = np.full((len(lanes), w), False)
        for n, lane in enumerate(lanes):
            if lane.plank_axle is not None:
                on = np.arange(w) // 2 == lane.plank_axle
                self.plank[n, on] = lane.plank_m
                self.flat[n] = ~on
        self.drop = np.array([lane.plank_axle is not None for lane in lanes])
        rough = [lane.rough for lane in lanes if lane.rough is not None]
        self.rough: Array | None = None
        if rough:
            count = max(r[0].size for r in rough)
            self.rough = np.zeros((len(lanes), 2, count))
            for n, lane in enumerate(lanes):
                if lane.rough is not None:
                    self.rough[n, :, : lane.rough[0].size] = lane.rough
            self.rough_from = np.array([lane.rough_from_m for lane in lanes])[:, None]
        self.total = np.array([np.sum(c.axle_load_kg) for c in t.load_cases])[case]
        self.at = np.arange(len(lanes))[:, None], np.tile([0, 1], t.axles)[None]

    def pull(self, e: Array, rate: Array, e_damper: Array, damper_rate: Array, h: Array, b: Array) -> tuple[Array, ...]:
        """Pull of springs and dampers (lane, wheel), and rates of the friction and of the dampers' own extension."""
        t = self.truck
        spring = self.k * e
        if np.any(np.isfinite(self.bellows)):
            # Polytropic gas, exponent 1.3 between isothermal and adiabatic: the tangent at rest is k.
            left = np.maximum(1.0 + e / self.bellows, 0.15)
            spring = np.where(
                np.isfinite(self.bellows),
                self.k * np.where(np.isfinite(self.bellows), self.bellows, 1.0) / 1.3 * (1.0 - left**-1.3),
                spring,
            )
        if np.any(self.helper_ratio):
            # k of a load case already holds the helper that its static load has reached.
            own = self.helper_ratio * self.main
            staged = self.main * e - own * (_softplus(-e - self.gap) - _softplus(-self.gap))
            spring = np.where(self.helper_ratio > 0.0, staged, spring)
        below, above = -e - self.stop[0], e - self.stop[1]
        for past, sign in ((below, -1.0), (above, 1.0)):
            past = np.maximum(past, 0.0)
            spring = spring + sign * 0.5 * t.stop_n_per_m * past * (1.0 + past / 0.01)
        if t.rocker_share:
            pair = spring[:, -4:].reshape(-1, 2, 2)
            spring = spring.copy()
            spring[:, -4:] += t.rocker_share * (np.mean(pair, axis=1, keepdims=True) - pair).reshape(-1, 4)
        lost = t.friction_rate_loss * np.abs(rate) / (np.abs(rate) + t.friction_rate_m_s)
        envelope = self.friction * (1.0 - lost)
        h_rate = (rate * envelope - np.abs(rate) * h) / t.friction_stroke_m
        if self.has_bushing:
            force = self.bushing * (e_damper - b)
            c = np.where(force > 0.0, self.rebound, self.jounce)
            b_rate = force / c
        elif t.lash_m:
            # The eye is free within the lash and stiff at its ends.
            gap = e_damper - b
            end = np.sign(gap) * np.maximum(np.abs(gap) - t.lash_m / 2.0, 0.0)
            force = 1.2e7 * end
            b_rate = force / np.where(force > 0.0, self.rebound, self.jounce)
        else:
            c = np.where(damper_rate > 0.0, self.rebound, self.jounce)
            force = c * damper_rate / (1.0 + np.abs(damper_rate) / self.saturation)
            b_rate = np.zeros_like(b)
        return spring + h, force, h_rate, b_rate

    def __call__(self, time: float, p: Array, v: Array, h: Array, b: Array) -> tuple[Array, Array, Array, Array]:
        """Acceleration, rates of the laws' own states, and wheel loads."""
        w = self.w
        moved, rates = (np.matmul(self.rows, q[:, :, None])[:, :, 0] for q in (p, v))
        pulled = self.pull(moved[:, :w], rates[:, :w], moved[:, w : 2 * w], rates[:, w : 2 * w], h, b)
        rise, rise_rate = moved[:, 2 * w : 3 * w], rates[:, 2 * w : 3 * w]
        ahead, ahead_rate = moved[:, 3 * w : 4 * w], rates[:, 3 * w : 4 * w]
        rolled = np.where(self.drop, np.maximum(time - SETTLE_S, 0.0), time)
        station = self.station + (self.speed * rolled)[:, None] + ahead
        moving = np.where(self.drop & (time < SETTLE_S), 0.0, self.speed)[:, None] + ahead_rate
        depth, depth_rate = self.static_depth - rise, -rise_rate
        if np.any(self.drop):
            # Lifted onto the plank smoothly, before it rolls off: `profile` is the plank's edge.
            lift = min(time / LIFT_S, 1.0)
            depth = depth - self.plank * (1.0 - lift**2 * (3.0 - 2.0 * lift))
            depth_rate = depth_rate + self.plank * (6.0 * lift * (1.0 - lift) / LIFT_S)
            station = np.where(self.flat, 1e3, station)
        if self.rough is not None:
            at = np.clip((station - self.rough_from) / ROUGH_STEP_M, 0.0, self.rough.shape[2] - 1.001)
            n = at.astype(np.int64)
            low, high = self.rough[(*self.at, n)], self.rough[(*self.at, n + 1)]
            begun = min(time / ROUGH_BEGIN_S, 1.0)
            depth = depth + begun * (low + (at - n) * (high - low))
            depth_rate = depth_rate + begun * (high - low) / ROUGH_STEP_M * moving
        d, by_station, by_depth, ratio = self.contact(self.profile, station, depth)
        d_rate = by_station * moving + by_depth * depth_rate
        touching = d > 0.0
        load = self.factor * np.maximum(d, 0.0) ** self.truck.tire_exponent + self.tire_c * d_rate * touching
        load = np.maximum(load, 0.0) * touching
        vertical = load - self.static_load
        drive = -self.total * rates[:, -1] / self.truck.speed_hold_s
        force = np.concatenate([-pulled[0], -pulled[1], vertical, load * ratio, drive[:, None]], axis=1)
        a = np.matmul(self.by_force, force[:, :, None])[:, :, 0]
        a -= np.matmul(self.by_position, p[:, :, None])[:, :, 0] + np.matmul(self.by_rate, v[:, :, None])[:, :, 0]
        return a, pulled[2], pulled[3], load


#: A drop: lifted within LIFT_S, at rest until SETTLE_S, then rolling.
LIFT_S, SETTLE_S = 1.5, 3.5
ROUGH_STEP_M = 0.02
#: The road grows rough from rest within this time.
ROUGH_BEGIN_S = 0.8


def _softplus(x: Array) -> Array:
    """Smooth max(0, x): leaves touch one after another, within some 2 mm."""
    width = 1e-3
    return np.asarray(width * np.logaddexp(0.0, x / width))


def _helper_gap(load_n: Array, knee_n: Array, main: Array, ratio: Array) -> Array:
    """Compression from rest to the knee of a two-stage spring [m], negative beyond it."""
    rate = np.where(load_n > knee_n, main * (1.0 + ratio), main)
    return np.asarray((knee_n - load_n) / rate)


def helper_stiffness(load_n: Array, knee_n: Array, main: Array, ratio: Array) -> Array:
    """Tangent of a two-stage spring at rest [N/m]."""
    gap = _helper_gap(load_n, knee_n, main, ratio)
    return np.asarray(main * (1.0 + ratio / (1.0 + np.exp(np.clip(gap / 1e-3, -50.0, 50.0)))))


def simulate(equations: Equations, duration_s: float, step_s: float = 5e-4, start: Array | None = None) -> History:
    """Integrate by the classical Runge-Kutta method from rest, or from coordinates `start` (lane, n)."""
    lanes, n = len(equations.lanes), equations.rows.shape[2]
    steps = round(duration_s / step_s)
    p = np.zeros((lanes, n)) if start is None else start.copy()
    v, h, b = np.zeros((lanes, n)), np.zeros((lanes, equations.w)), np.zeros((lanes, equations.w))
    position, acceleration = np.empty((steps, lanes, n)), np.empty((steps, lanes, n))
    loads = np.empty((steps, lanes, equations.w))
    for i in range(steps):
        time = i * step_s
        a1, h1, b1, load = equations(time, p, v, h, b)
        position[i], acceleration[i], loads[i] = p, a1, load
        half = 0.5 * step_s
        v2 = v + half * a1
        a2, h2, b2, _ = equations(time + half, p + half * v, v2, h + half * h1, b + half * b1)
        v3 = v + half * a2
        a3, h3, b3, _ = equations(time + half, p + half * v2, v3, h + half * h2, b + half * b2)
        v4 = v + step_s * a3
        a4, h4, b4, _ = equations(time + step_s, p + step_s * v3, v4, h + step_s * h3, b + step_s * b3)
        sixth = step_s / 6.0
        p = p + sixth * (v + 2.0 * v2 + 2.0 * v3 + v4)
        v = v + sixth * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        h = h + sixth * (h1 + 2.0 * h2 + 2.0 * h3 + h4)
        b = b + sixth * (b1 + 2.0 * b2 + 2.0 * b3 + b4)
    if not np.all(np.isfinite(p)):
        raise FloatingPointError("the simulated motion is not finite; take a smaller step")
    return History(step_s * np.arange(steps, dtype=float), position, acceleration, loads)
