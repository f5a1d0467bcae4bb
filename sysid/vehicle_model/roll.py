r"""Roll: the motion of differences between left and right, beside that of their means.

The planar model follows the means of both sides. For a truck that is nearly symmetric the differences form a linear
system of their own: with body rolls Phi_b and axle rolls phi_i, positive with the left side up,

    I_b Phi_b'' = - sum_i (K_i theta_i + C_i theta_i') + M_b,
    I_i phi_i'' = K_i theta_i + C_i theta_i' - E_i (k_i phi_i + c_i phi_i') + M_i,    theta_i = Phi_b(i) - phi_i.

K_i and C_i are stiffness and damping of a suspension in roll, k_i and c_i those of its tires in heave, both sides
together, and E_i the mean of the squared distances of the tires from the middle. The moments come from the difference
of the road under both sides, and from sides that differ in stiffness, damping or load.

Tires are not linear where they leave the road, one side before the other. So the tires of both sides are simulated
about the planar motion of their axle (:class:`TiresBySide`), and derivatives have their slopes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from scipy.signal import lfilter

from sysid.vehicle_model.contact import contact_damping
from sysid.vehicle_model.filters import FilterRecursion


@dataclass(frozen=True)
class Sideways:
    """Lateral motion y of the whole truck, positive to the left, of which roll is a part.

    A body with its centre of gravity h above the axis of roll moves there by y - h Phi; tires of radius r under an axle
    slip by y' + r phi' and resist with C_i times that: their cornering stiffness over the speed.

    - `body_mass`, `cg_above_axis_m` (nb,): [kg] and h [m]; `mass`: of the whole truck [kg];
    - `cornering` (na,): C_i [N s/m] at a speed of reference, and `radius_m` (na,);
    - `slower` (R,): speed of reference over that of the runs.
    """

    body_mass: np.ndarray
    cg_above_axis_m: np.ndarray
    mass: float
    cornering: np.ndarray
    radius_m: np.ndarray
    slower: np.ndarray


@dataclass(frozen=True)
class RollSystem:
    """Roll of a vehicle of nb bodies and na axles.

    - `body_inertia` (nb,), `axle_inertia` (na,): about the axis of roll [kg m2];
    - `stiffness`, `damping` (na,): of the suspensions in roll, K_i [N m/rad] and C_i [N m s/rad];
    - `tire_stiffness`, `tire_damping` (na,): k_i [N/m] and c_i [N s/m] at the static load;
    - `square_track_m2` (na,): E_i;
    - `body_of` (na,): the body above every axle; `hitches`: pairs of bodies that are joined by `hitch_stiffness`
      [N m/rad];
    - `sideways`: how the truck moves sideways, None if it does not.
    """

    body_inertia: np.ndarray
    axle_inertia: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    tire_stiffness: np.ndarray
    tire_damping: np.ndarray
    square_track_m2: np.ndarray
    body_of: tuple[int, ...]
    hitches: tuple[tuple[int, int], ...] = ()
    hitch_stiffness: float = 0.0
    sideways: Sideways | None = None

    @property
    def bodies(self) -> int:
        """Number nb of bodies: the first coordinates are theirs, those of the axles follow."""
        return self.body_inertia.size

    @property
    def axles(self) -> slice:
        """Coordinates of the axles; the lateral motion comes last, if there is one."""
        return slice(self.bodies, self.bodies + self.axle_inertia.size)

    @property
    def inertia(self) -> np.ndarray:
        """Mass matrix of all coordinates [kg m2; kg m and kg for the lateral motion]."""
        diagonal = np.concatenate([self.body_inertia, self.axle_inertia])
        if self.sideways is None:
            return np.diag(diagonal)
        way = self.sideways
        total = np.diag([*diagonal, way.mass])
        here, moment = range(self.bodies), way.body_mass * way.cg_above_axis_m
        total[here, here] += moment * way.cg_above_axis_m
        total[here, -1] = total[-1, here] = -moment
        return total

    @property
    def turns(self) -> np.ndarray:
        """Rows (na, n) that turn coordinates into the roll of the body over every axle, theta_i."""
        rows = np.zeros((self.axle_inertia.size, self.inertia.shape[0]))
        for i, body in enumerate(self.body_of):
            rows[i, body], rows[i, self.bodies + i] = 1.0, -1.0
        return rows

    @property
    def slipping(self) -> np.ndarray:
        """Damping matrix (n, n) of tires that slip sideways at the speed of reference."""
        rows = np.zeros((self.axle_inertia.size, self.inertia.shape[0]))
        if self.sideways is None:
            return np.asarray(rows.T @ rows)
        rows[:, self.axles] = np.diag(self.sideways.radius_m)
        rows[:, -1] = 1.0
        return np.asarray(rows.T @ (self.sideways.cornering[:, None] * rows))

    def _symmetric(self, of_suspensions: np.ndarray, of_tires: np.ndarray, of_hitches: float) -> np.ndarray:
        """K or C of all coordinates."""
        total = self.turns.T @ (of_suspensions[:, None] * self.turns)
        total[self.axles, self.axles] += np.diag(self.square_track_m2 * of_tires)
        for front, rear in self.hitches:
            apart = np.zeros(total.shape[0])
            apart[front], apart[rear] = 1.0, -1.0
            total += of_hitches * np.outer(apart, apart)
        return np.asarray(total)

    @property
    def stiffness_matrix(self) -> np.ndarray:
        """Stiffness (n, n) at the static load [N m/rad]."""
        return self._symmetric(self.stiffness, self.tire_stiffness, self.hitch_stiffness)

    @property
    def damping_matrix(self) -> np.ndarray:
        """Damping (n, n) at the static load and the speed of reference [N m s/rad]."""
        return np.asarray(self._symmetric(self.damping, self.tire_damping, 0.0) + self.slipping)


@dataclass(frozen=True)
class RollMotion:
    """Roll of R runs for Q courses of the moments: `angle` [rad], `rate` [rad/s], `acceleration` [rad/s2].

    All are (T, n, R, Q), n coordinates.
    """

    angle: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray


@dataclass(frozen=True)
class TiresBySide:
    """Tires of both sides about the planar motion of their axle.

    With y the half track, d the difference of the road under both sides and e the deflection of the mean, the sides are
    deflected by e + a and e - a, a = d / 2 - g y phi; g is 1 on a flat road. Each has half of the axle's force F(e) =
    F_ref (e / u_ref)^n, and half of its damping (:func:`sysid.vehicle_model.contact.contact_damping`); none pulls.

    - `half_track_m` (na,): y; `exponent`: n;
    - `deflection`, `rate` (T, na, R): e [m], below 0 where the axle is off the road, and its rate [m/s];
    - `difference`, `difference_rate` (T, na, R): d [m] and its rate [m/s];
    - `gain` (T, na, R): g, by how much the deflection grows with the lowering of the wheel over the bump;
    - `reference_load`, `reference_deflection`, `damping`, `growth` (na,): F_ref [N], u_ref [m], damping at u_ref
      [N s/m], and g, 1 where it grows with the length of contact.
    """

    half_track_m: np.ndarray
    exponent: float
    deflection: np.ndarray
    rate: np.ndarray
    difference: np.ndarray
    difference_rate: np.ndarray
    gain: np.ndarray
    reference_load: np.ndarray
    reference_deflection: np.ndarray
    damping: np.ndarray
    growth: np.ndarray

    def forces(self, at: int | slice, angle: np.ndarray, turning: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forces [N] of left and right tires at one sample or several, for roll of the axles (..., na, R, Q)."""
        lever = (self.half_track_m[:, None] * self.gain[at])[..., None]
        apart = 0.5 * self.difference[at][..., None] - lever * angle
        moving = 0.5 * self.difference_rate[at][..., None] - lever * turning
        mean, rate = self.deflection[at][..., None], self.rate[at][..., None]
        left, right = self._force(np.array([mean + apart, mean - apart]), np.array([rate + moving, rate - moving]))
        return left, right

    def moment(self, at: int, angle: np.ndarray, turning: np.ndarray, system: RollSystem) -> np.ndarray:
        """Moment (na, R, Q) [N m] on the axles at a sample; twin tires resist roll a little more than one between."""
        left, right = self.forces(at, angle, turning)
        half = self.half_track_m[:, None, None]
        twins = system.square_track_m2[:, None, None] - half**2
        contact = 0.5 * ((left > 0.0).astype(float) + (right > 0.0))
        resisting = system.tire_stiffness[:, None, None] * angle + system.tire_damping[:, None, None] * turning
        return np.asarray(half * (left - right) - twins * contact * resisting)

    def _force(self, deflection: np.ndarray, rate: np.ndarray) -> np.ndarray:
        load, reference = (x[:, None, None] for x in (self.reference_load, self.reference_deflection))
        pressed = np.maximum(deflection / reference, 0.0)
        damping = self._damping(pressed, (1, 1))
        return np.asarray(0.5 * np.maximum(load * pressed**self.exponent + damping * rate, 0.0))

    def _damping(self, pressed: np.ndarray, behind: tuple[int, ...]) -> np.ndarray:
        """Damping [N s/m] of an axle's tires at e / u_ref (..., na, *behind); none of those in the air."""
        damping, growth = (x.reshape(-1, *behind) for x in (self.damping, self.growth))
        return contact_damping(damping, pressed, growth) * (pressed > 0.0)

    def slopes(self, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Stiffness [N/m] and damping [N s/m] of the tires (T, na, R) along a course of the roll of the axles."""
        apart = 0.5 * self.difference - self.half_track_m[:, None] * self.gain * angle
        stiffness, damping = np.zeros_like(apart), np.zeros_like(apart)
        tangent = self.exponent * self.reference_load / self.reference_deflection
        for deflection in (self.deflection + apart, self.deflection - apart):
            pressed = np.maximum(deflection / self.reference_deflection[:, None], 0.0)
            # Not of tires in the air: with an exponent below one that would be no number.
            steeper = np.power(pressed, self.exponent - 1.0, out=np.zeros_like(pressed), where=pressed > 0.0)
            stiffness += 0.5 * tangent[:, None] * steeper
            damping += 0.5 * self._damping(pressed, (1,))
        return stiffness, damping


@dataclass(frozen=True)
class FrictionBySide:
    """Friction of suspensions whose sides move apart: half of the axle's Dahl element at each spring.

    A side at y slips by the extension of the mean plus y theta. Over an increment dx the share phi of the breakaway
    force becomes sgn(dx) + (phi - sgn(dx)) exp(-|dx| / z_s), whatever its rate.

    - `half_track_m`, `force`, `slip_m` (na,): y of the springs, breakaway force of the axle [N] and z_s [m];
    - `extension` (T, na, R): of the mean [m].
    """

    half_track_m: np.ndarray
    force: np.ndarray
    slip_m: np.ndarray
    extension: np.ndarray

    def slipped(self, at: int, before: np.ndarray, apart: np.ndarray) -> np.ndarray:
        """Shares (2, na, R, Q) of left and right at a sample after those before, for a change of theta (na, R, Q)."""
        mean = (self.extension[at] - self.extension[at - 1])[..., None]
        turned = self.half_track_m[:, None, None] * apart
        way = np.stack([mean + turned, mean - turned])
        sign = np.sign(way)
        return np.asarray(sign + (before - sign) * np.exp(-np.abs(way) / self.slip_m[:, None, None]))

    def moment(self, shares: np.ndarray) -> np.ndarray:
        """Moment (na, R, Q) [N m] on the body above, the opposite on the axle."""
        return np.asarray((-0.5 * self.half_track_m * self.force)[:, None, None] * (shares[0] - shares[1]))


def roll_motion(
    system: RollSystem,
    step_s: float,
    moment: np.ndarray,
    tires: TiresBySide | None = None,
    friction: FrictionBySide | None = None,
) -> RollMotion:
    """Roll from rest under moments, by the matrix exponential of a step.

    Moments vary linearly over a step, and are sharpened by 1 - d^2 / 12 (d^2 the second difference), which makes the
    error of the steps one of fourth order. What is not linear is a further moment, found by two corrections per step.

    Parameters
    ----------
    step_s : h [s].
    moment : M (T, n, R, Q) on all coordinates [N m]; with `tires` without that of the road.
    tires, friction : of both sides about the planar motion, None for the linear tires of the system, for none.
    """
    count, axles = system.inertia.shape[0], system.axles
    samples, _, runs, courses = moment.shape
    inverse = np.linalg.inv(system.inertia)
    rates = slice(count + axles.start, count + axles.stop)
    stiffness, damping = system.stiffness_matrix, system.damping_matrix
    decay, first, last = _step_matrices(inverse, stiffness, damping, step_s)
    sharp = moment.copy()
    sharp[1:-1] -= (moment[2:] - 2.0 * moment[1:-1] + moment[:-2]) / 12.0
    sharp = sharp.reshape(samples, count, -1)
    state = np.zeros((samples, 2 * count, runs * courses))
    extra = np.zeros((samples, count, runs * courses))
    turns, shape = system.turns, (-1, runs, courses)
    shares = np.zeros((2, system.axle_inertia.size, runs, courses))
    of_angle, of_rate = (
        (system.square_track_m2 * x)[:, None, None] for x in (system.tire_stiffness, system.tire_damping)
    )

    def departed(at: int, there: np.ndarray) -> np.ndarray:
        """Moments (n, R Q) of what is not linear."""
        total = np.zeros((count, runs * courses))
        if tires is not None:
            angle, rate = there[axles].reshape(shape), there[rates].reshape(shape)
            total[axles] = (tires.moment(at, angle, rate, system) + of_angle * angle + of_rate * rate).reshape(
                -1, runs * courses
            )
        if faster is not None:
            total -= faster * (slipping @ there[count:])
        if friction is not None and at > 0:
            total += turns.T @ friction.moment(slid(at, there)).reshape(-1, runs * courses)
        return total

    def slid(at: int, there: np.ndarray) -> np.ndarray:
        assert friction is not None
        return friction.slipped(at, shares, (turns @ (there[:count] - state[at - 1, :count])).reshape(shape))

    way, slipping = system.sideways, system.slipping
    faster = None if way is None or np.all(way.slower == 1.0) else np.repeat(way.slower - 1.0, courses)
    linear = tires is None and friction is None and faster is None
    if not linear:
        extra[0] = departed(0, state[0])
    for k in range(samples - 1):
        known = decay @ state[k] + first @ (sharp[k] + extra[k]) + last @ sharp[k + 1]
        there = known + last @ extra[k]
        if not linear:
            for _ in range(2):
                extra[k + 1] = departed(k + 1, there)
                there = known + last @ extra[k + 1]
            if friction is not None:
                shares = slid(k + 1, there)
        state[k + 1] = there
    angle, rate = state[:, :count], state[:, count:]
    total = moment.reshape(samples, count, -1) - stiffness @ angle - damping @ rate + extra
    of_all = (samples, count, runs, courses)
    acceleration = inverse @ total
    return RollMotion(angle.reshape(of_all), rate.reshape(of_all), acceleration.reshape(of_all))


def _step_matrices(
    inverse: np.ndarray, stiffness: np.ndarray, damping: np.ndarray, step_s: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """State after a step from that before it (2n, 2n), and from moments at its start and at its end (2n, n)."""
    count = inverse.shape[0]
    whole = np.zeros((4 * count, 4 * count))
    whole[:count, count : 2 * count] = step_s * np.eye(count)
    whole[count : 2 * count, :count] = -step_s * inverse @ stiffness
    whole[count : 2 * count, count : 2 * count] = -step_s * inverse @ damping
    whole[count : 2 * count, 2 * count : 3 * count] = step_s * inverse
    whole[2 * count : 3 * count, 3 * count :] = np.eye(count)
    exponential = expm(whole)[: 2 * count]
    constant, ramp = exponential[:, 2 * count : 3 * count], exponential[:, 3 * count :]
    return exponential[:, : 2 * count], constant - ramp, ramp


def through_filter(recursion: FilterRecursion | None, signal: np.ndarray) -> np.ndarray:
    """A signal (T, ...) on the filter's steps through the anti-alias filter, from rest; itself without one."""
    if recursion is None:
        return signal
    shown = np.zeros_like(signal)
    coefficients = zip(
        recursion.decay, recursion.start, recursion.middle, recursion.feed, recursion.weight, strict=True
    )
    for decay, start, middle, feed, weight in coefficients:
        memory = lfilter([0.5 * middle, start + 0.5 * middle], [1.0, -decay], signal, axis=0)
        shown += (weight * (memory + feed * signal)).real
    return shown
