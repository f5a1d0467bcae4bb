"""Equations of motion of the bodies in one stretch of a record, in the frequency domain.

    e = M u'' + K u + sum_i phi_i F_i - sum_i t_i X_i + m xi'',

with u the vertical body coordinates, K the static loads that tilt with the bodies, phi_i how the frame rises above
suspension i, F_i its force, X_i the horizontal force on wheel i and t_i its lever; xi is the fore-aft travel, which
nobody measures: it follows from the horizontal forces and from how the speed is held. What the body's balance leaves
is e. The road pushes along a wheel by

    X_i = -N_i h_i' / v,    h_i = z_i + (m_ui z_i'' - F_i) / (kt_i + ct_i d/dt),

N_i its vertical force and h_i the height of the road as the wheel feels it. Nominal tires are enough here: the term is
a few per cent of the balance, and a tire is an order of magnitude stiffer than the path that it is added to.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sysid.balance.laws import (
    ASYMMETRY,
    CURVE,
    DAMPING,
    FRICTION,
    SATURATION,
    SLIP,
    SLOPE,
    SOFTNESS,
    STIFFNESS,
    STOP,
    Shapes,
    Unknown,
    damper_shape,
    delayed,
    friction_state,
    stop_ramp,
)  # fmt: skip
from sysid.balance.motion import Gains, Motion, Stretch, edge_taper, smoother, vertical_columns
from sysid.campaign.vehicle_records import Vehicle
from sysid.vehicle_model.assembly import PlanarMatrices

#: Frequencies of the balance: below, accelerations are noise; above, frames bend and tires ring (an assumption) [Hz].
BAND_HZ = (0.7, 15.0)
#: A wheel averages the road over its footprint: slopes of shorter waves push nothing along (an assumption) [Hz].
_FOOTPRINT_HZ = 12.0
#: Least samples of a band whose unexplained forces have one covariance, and its width over its frequency.
_BAND_BINS, _BAND_WIDTH = 14, 0.35
#: Standard deviation of the horizontal force on a wheel over the computed one (an assumption): a tire rolls over more
#: than its middle, and its stiffness is nominal.
PUSH_SD = 0.2
#: No law is exact, and channels are not quite simultaneous: each suspension's force is off by a share of this standard
#: deviation, in phase and out of phase, in each of these bands (an assumption).
DEPARTURE_SD, _DEPARTURE_HZ = 0.01, (0.0, 2.0, 5.0, 1e3)
DEPARTURES = 2 * (len(_DEPARTURE_HZ) - 1)
_STEPS = {SATURATION: 1e-2, SOFTNESS: 1e-8, SLIP: 1e-2}


@dataclass(frozen=True)
class Passage:
    """A record besides its readings: file, load case, speed [m/s] and the time constant with which it is held [s]."""

    file: str
    load_case: str
    speed_m_s: float | None
    hold_s: float


@dataclass(frozen=True)
class MassChange:
    """Change of matrices by one standard deviation of a declared mass property, (nu, nu), (nu, nu) and (na, nu).

    `unsprung` (na,) [kg] and `static` (na,) [N] are what it does to unsprung masses and loads at rest.
    """

    mass: np.ndarray
    tilt: np.ndarray
    attachment: np.ndarray
    unsprung: np.ndarray
    static: np.ndarray


@dataclass
class Block:
    """One stretch with its equations; F frequencies `omega` [rad/s], nu body coordinates, na axles.

    `bands` are pairs of places among the frequencies; `unexplained` (bands, nu, nu) the covariance of forces that no
    law explains, filled in by the search. `gain` (F, nx, sensors) and `covariance` (F, nx, nx) of the smoother,
    `readings` (sensors, F); `of_gains` (sensors, g) is how far gains move with independent numbers of variance one.
    `shapes` are those of `bases`.
    """

    passage: Passage
    stretch: Stretch
    motion: Motion
    matrices: PlanarMatrices
    changes: tuple[MassChange | None, ...]
    vehicle: Vehicle
    omega: np.ndarray
    chosen: np.ndarray
    bands: list[tuple[int, int]]
    covariance: np.ndarray
    gain: np.ndarray
    readings: np.ndarray
    inertia: tuple[np.ndarray, np.ndarray]
    bases: dict[str, np.ndarray]
    of_gains: np.ndarray
    unexplained: np.ndarray
    shapes: Shapes | None = None

    @property
    def columns(self) -> np.ndarray:
        """Places of the vertical body coordinates."""
        return vertical_columns(self.matrices)

    def transform(self, values: np.ndarray) -> np.ndarray:
        """Spectra (..., F) of values (..., n), white noise keeping its variance."""
        taper, scale = edge_taper(self.stretch.count, self.stretch.step_s)
        return np.asarray(np.fft.rfft(values * taper, axis=-1)[..., self.chosen] / scale)


def block_of(
    passage: Passage,
    stretch: Stretch,
    motion: Motion,
    matrices: PlanarMatrices,
    changes: tuple[MassChange | None, ...],
    vehicle: Vehicle,
    gains: Gains,
) -> Block:
    """Equations of one stretch, with the transforms that no law changes."""
    frequency = np.fft.rfftfreq(stretch.count, stretch.step_s)
    chosen = np.flatnonzero((frequency >= BAND_HZ[0]) & (frequency <= min(BAND_HZ[1], 0.4 / stretch.step_s)))
    omega = 2.0 * np.pi * frequency[chosen]
    nu = vertical_columns(matrices).size
    gain, covariance = smoother(stretch, omega)
    empty = np.zeros((0,))
    block = Block(
        passage, stretch, motion, matrices, changes, vehicle, omega, chosen, _bands(omega.size), covariance,
        gain, empty, (empty, empty), {}, empty, np.zeros((0, nu, nu)),
    )  # fmt: skip
    block.inertia = block.transform(motion.acceleration[:nu]), block.transform(motion.displacement[:nu])
    q = motion.deflection
    # Springs and stops; friction and dampers follow with their shapes.
    block.bases[STIFFNESS] = block.transform(q)
    block.bases[SLOPE] = block.transform(0.5 * (q**2 - np.mean(q**2, axis=1, keepdims=True)))
    block.bases[CURVE] = block.transform(q**3 / 3.0)
    block.bases[STOP] = block.transform(np.array([stop_ramp(a, x) for a, x in zip(vehicle.axles, q, strict=True)]))
    block.gain, block.readings = gain, block.transform(stretch.readings)
    # A gain that all sensors share changes no k and c.
    factor = np.linalg.cholesky(gains.covariance)
    block.of_gains = (factor - factor.mean(axis=0))[gains.of(stretch)]
    return block


def _bands(count: int) -> list[tuple[int, int]]:
    edges = [0]
    while edges[-1] < count:
        edges.append(min(count, edges[-1] + max(_BAND_BINS, int(_BAND_WIDTH * (edges[-1] + _BAND_BINS)))))
    if len(edges) > 2 and edges[-1] - edges[-2] < _BAND_BINS:
        edges.pop(-2)
    return list(pairwise(edges))


def shape_bases(block: Block, shapes: Shapes) -> None:
    """Transforms of friction and dampers with their nonlinear numbers, and by these."""
    if block.shapes is not None and block.shapes.same(shapes):
        return
    block.shapes = shapes
    q, rate, step = block.motion.deflection, block.motion.deflection_rate, block.stretch.step_s
    carried = block.matrices.carried_load[:, None]
    friction = [np.array([friction_state(x, z) for x in q]) for z in (shapes.slip, shapes.slip * np.exp(_STEPS[SLIP]))]
    block.bases[FRICTION] = block.transform(carried * friction[0])
    block.bases[SLIP] = block.transform(carried * (friction[1] - friction[0]) / _STEPS[SLIP])

    def damper(saturation: np.ndarray, delay: np.ndarray) -> np.ndarray:
        felt = [delayed(v, float(t), step) for v, t in zip(rate, delay, strict=True)]
        force = np.array([damper_shape(v, float(s)) for v, s in zip(felt, saturation, strict=True)])
        return np.array([np.maximum(force, 0.0), np.minimum(force, 0.0)])

    here = damper(shapes.saturation, shapes.delay)
    block.bases[DAMPING] = block.transform(here)
    more = damper(shapes.saturation + _STEPS[SATURATION], shapes.delay)
    block.bases[SATURATION] = block.transform((more - here) / _STEPS[SATURATION])
    late = damper(shapes.saturation, shapes.delay + 1e-4)
    block.bases[SOFTNESS] = block.transform((late - here) / 1e-4)


@dataclass(frozen=True)
class AxleForce:
    """Force (F,) of one suspension, derivatives by unknowns (place, (F,)), and with each the dynamic stiffness (F,).

    That is alpha + i omega beta of the spring and damper that do most of the same (statistical linearisation; by
    Bussgang's theorem it is also how noise of the deflection passes through the law).
    """

    force: tuple[np.ndarray, np.ndarray]
    derivatives: list[tuple[int, np.ndarray, np.ndarray]]


def _dynamic(force: np.ndarray, deflection: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """alpha + i omega beta (F,), by least squares, of a force from a deflection, spectra (F,)."""
    size = np.abs(deflection) ** 2
    work = np.conj(deflection) * force
    alpha = np.sum(work.real) / np.sum(size)
    beta = np.sum(omega * work.imag) / np.sum(omega**2 * size)
    return np.asarray(alpha + 1j * omega * beta)


def axle_force(block: Block, axle: int, unknowns: Sequence[Unknown], values: np.ndarray) -> AxleForce:
    """Force of a suspension in the frequency domain at values (p,) of the unknowns."""
    place: dict[str, int] = {}
    for j, u in enumerate(unknowns):
        if u.axle in (axle, None) and u.load_case in (block.passage.load_case, None):
            place[u.quantity] = j

    def value(quantity: str) -> float:
        return float(values[place[quantity]]) if quantity in place else 0.0

    def size(quantity: str) -> float:
        return float(unknowns[place[quantity]].unit * np.exp(value(quantity)))

    b = {name: basis[..., axle, :] for name, basis in block.bases.items()}
    k, c = size(STIFFNESS), size(DAMPING)
    spring = b[STIFFNESS] + value(SLOPE) * b[SLOPE] + value(CURVE) * b[CURVE]
    r = np.exp(value(ASYMMETRY))
    longer, shorter, turn = 2.0 * r / (1.0 + r), 2.0 / (1.0 + r), 2.0 * r / (1.0 + r) ** 2
    damper = longer * b[DAMPING][0] + shorter * b[DAMPING][1]
    force = k * spring + c * damper + value(FRICTION) * b[FRICTION] + value(STOP) * b[STOP]
    by = {
        STIFFNESS: k * spring,
        DAMPING: c * damper,
        ASYMMETRY: c * turn * (b[DAMPING][0] - b[DAMPING][1]),
        SATURATION: c * (longer * b[SATURATION][0] + shorter * b[SATURATION][1]),
        SOFTNESS: c * c * (longer * b[SOFTNESS][0] + shorter * b[SOFTNESS][1]),
        SLOPE: k * b[SLOPE],
        CURVE: k * b[CURVE],
        FRICTION: b[FRICTION],
        SLIP: value(FRICTION) * b[SLIP],
        STOP: b[STOP],
    }
    q, omega = b[STIFFNESS], block.omega
    derivatives = [(j, by[quantity], _dynamic(by[quantity], q, omega)) for quantity, j in place.items()]
    return AxleForce((force, _dynamic(force, q, omega)), derivatives)


def horizontal_forces(block: Block, forces: np.ndarray) -> np.ndarray:
    """Spectra (na, F) of the horizontal forces on the wheels, from suspension forces (na, n) [N]."""
    speed = block.passage.speed_m_s
    na, n = forces.shape
    if not speed:
        return np.zeros((na, block.omega.size), complex)
    nu = block.columns.size
    axles = block.vehicle.axles
    tire_k = np.array([a.tire_stiffness_N_per_m for a in axles])[:, None]
    tire_c = np.array([a.tire_damping_N_s_per_m for a in axles])[:, None]
    vertical = block.matrices.unsprung_mass[:, None] * block.motion.acceleration[nu:] - forces
    omega = 2.0 * np.pi * np.fft.rfftfreq(n, block.stretch.step_s)
    low_pass = 1.0 / (1.0 + (omega / (2.0 * np.pi * _FOOTPRINT_HZ)) ** 8)
    tire = np.fft.rfft(vertical, axis=1) / (tire_k + 1j * omega * tire_c)
    height = np.fft.rfft(block.motion.displacement[nu:], axis=1) + tire
    slope = np.fft.irfft(1j * omega * low_pass * height, n, axis=1) / speed
    load = np.maximum(block.matrices.static_load[:, None] + vertical, 0.0)
    return block.transform(-load * slope)


def suspension_forces(block: Block, unknowns: Sequence[Unknown], values: np.ndarray, shapes: Shapes) -> np.ndarray:
    """Forces (na, n) of the suspensions over time [N]."""
    q, rate, step = block.motion.deflection, block.motion.deflection_rate, block.stretch.step_s
    forces = np.zeros_like(q)
    for i, axle in enumerate(block.vehicle.axles):
        v = {u.quantity: (u, float(x)) for u, x in zip(unknowns, values, strict=True)
             if u.axle in (i, None) and u.load_case in (block.passage.load_case, None)}  # fmt: skip
        of = {name: x for name, (_, x) in v.items()}
        if STIFFNESS not in v:
            continue
        k, c = (v[name][0].unit * np.exp(v[name][1]) for name in (STIFFNESS, DAMPING))
        r = np.exp(of.get(ASYMMETRY, 0.0))
        damper = damper_shape(delayed(rate[i], float(shapes.delay[i]), step), float(shapes.saturation[i]))
        spring = q[i] * (1.0 + of.get(SLOPE, 0.0) * q[i] / 2.0 + of.get(CURVE, 0.0) * q[i] ** 2 / 3.0)
        rubbing = of.get(FRICTION, 0.0) * block.matrices.carried_load[i]
        forces[i] = (
            k * spring
            + c * damper * np.where(damper > 0.0, 2.0 * r / (1.0 + r), 2.0 / (1.0 + r))
            + (rubbing * friction_state(q[i], shapes.slip) if rubbing else 0.0)
            + of.get(STOP, 0.0) * stop_ramp(axle, q[i])
        )
    return forces


def pushed(block: Block, horizontal: np.ndarray) -> np.ndarray:
    """What fore-aft motion adds to the balance, spectra (1 + na, nu, F): without horizontal forces, and by each.

    M_c (xi'' + d' q' / tau) + m u'' = sum X_i along the chain, M_c its mass, d the row of the point where the speed is
    held, tau the time constant.
    """
    m, columns, omega = block.matrices, block.columns, block.omega
    along = np.setdiff1d(np.arange(m.mass.shape[0]), columns)
    hold = m.drive.T @ ((m.chain_mass / block.passage.hold_s)[:, None] * m.drive) / (1j * omega[:, None, None])
    stiff = m.mass + hold
    across = stiff[:, along][:, :, columns]
    answer = np.linalg.inv(stiff[:, along][:, :, along]) @ across
    # (F, nu, along): by forces along the chain, through the travel that they cause.
    through = np.conj(np.swapaxes(np.conj(answer), 1, 2))
    held = hold[:, columns][:, :, columns] - through @ across
    still = held @ block.inertia[0].T[:, :, None]
    levers = through @ m.travel[:, along].T - m.travel[:, columns].T
    return np.concatenate([np.moveaxis(still, 2, 0), np.moveaxis(levers * horizontal.T[:, None, :], 2, 0)]).swapaxes(
        1, 2
    )


def departure_shares(omega: np.ndarray) -> np.ndarray:
    """Shares (departures, F) of a force, in phase and out of phase in every band, of one standard deviation."""
    hz = omega / (2.0 * np.pi)
    inside = np.array([(hz >= a) & (hz < b) for a, b in pairwise(_DEPARTURE_HZ)])
    return np.asarray(DEPARTURE_SD * np.concatenate([inside, 1j * inside]))


@dataclass(frozen=True)
class Balanced:
    """The balance of a block at one point.

    - `left` (nu, F) forces e; `by` (p, nu, F) its derivatives by laws, masses and gains;
    - `whole` (F, nu, nx): e by displacements, those of bodies first;
    - `of_readings` (F, nu, sensors): e by readings;
    - `noise` (F, nu, nu): covariance of e by noise of the sensors;
    - `dynamic` (place, axle, (F,)): derivatives of the dynamic stiffness of axles.
    """

    left: np.ndarray
    by: np.ndarray
    whole: np.ndarray
    of_readings: np.ndarray
    noise: np.ndarray
    dynamic: list[tuple[int, int, np.ndarray]]


def balanced(
    block: Block, unknowns: Sequence[Unknown], values: np.ndarray, beside: np.ndarray, others: np.ndarray
) -> Balanced:
    """Balance of a block at `values` (p,) of laws and `others` (m + g,) of masses and gains, in their prior sd.

    `beside` (nu, F) is what horizontal forces add.
    """
    m, columns, omega = block.matrices, block.columns, block.omega
    nu, na = columns.size, m.unsprung_mass.size
    attachment, mass = m.attachment[:, columns], m.mass[np.ix_(columns, columns)]
    tilt = m.tilt[np.ix_(columns, columns)]
    for amount, change in zip(others, block.changes, strict=False):
        if change is not None:
            mass, tilt = mass + amount * change.mass, tilt + amount * change.tilt
            attachment = attachment + amount * change.attachment
    acceleration, displacement = block.inertia
    count, masses = len(unknowns), len(block.changes)
    by = np.zeros((count + others.size, nu, omega.size), complex)
    forces = np.zeros((na, omega.size), complex)
    dynamic_stiffness = np.zeros((omega.size, na), complex)
    dynamic = []
    for i in range(na):
        force = axle_force(block, i, unknowns, values)
        forces[i], dynamic_stiffness[:, i] = force.force
        for j, derivative, stiffness in force.derivatives:
            by[j] += np.outer(attachment[i], derivative)
            dynamic.append((j, i, stiffness))
    for j, change in enumerate(block.changes):
        if change is not None:
            by[count + j] = change.mass @ acceleration + change.tilt @ displacement + change.attachment.T @ forces
    body = -(omega[:, None, None] ** 2) * mass + tilt + (attachment.T * dynamic_stiffness[:, None, :]) @ attachment
    axles = -attachment.T[None] * dynamic_stiffness[:, None, :]
    whole = np.concatenate([body, axles], axis=2)
    of_readings = whole @ block.gain
    pushes = slice(count + masses, count + masses + na)
    by[pushes] = PUSH_SD * beside[1:]
    departures = slice(pushes.stop, pushes.stop + DEPARTURES * na)
    shares = departure_shares(omega)
    for i in range(na):
        for part, share in enumerate(shares):
            place = departures.start + DEPARTURES * i + part
            by[place] = np.outer(attachment[i], share * forces[i])
            dynamic.append((place, i, share * dynamic_stiffness[:, i]))
    by[departures.stop :] = np.moveaxis((of_readings * block.readings.T[:, None, :]) @ block.of_gains, 0, 2).swapaxes(
        0, 1
    )
    left = mass @ acceleration + tilt @ displacement + attachment.T @ forces + beside.sum(axis=0)
    left = left + np.tensordot(others[masses:], by[count + masses :], axes=1)
    noise = whole @ block.covariance @ np.conj(np.swapaxes(whole, 1, 2))
    return Balanced(left, by, whole, of_readings, noise, dynamic)
