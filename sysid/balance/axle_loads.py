"""Axle loads of drives from the motion of axles and the laws of the suspensions; they need no tire and no road.

    T_i = m_ui z_i'' - F_i(q_i, q_i')

is the change of the vertical force of the road on axle i: its unsprung mass times its acceleration, less the pull of
its suspension. Spectra are Welch's, less what the noise of the sensors puts in, whose covariance C is known; the load
coefficient is the standard deviation over the load at rest, less noise in the same way. To first order, every unknown
theta of the balance changes a spectrum by twice the real part of the cross spectrum of T with dT / dtheta, so that
intervals hold the covariance of laws, masses, departures and gains. Noise, and forces on the bodies that no law
explains, add the variance of the spectrum of a short record.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import csd, resample_poly, welch

from sysid.balance.equations import DEPARTURES, Block, axle_force, departure_shares, shape_bases, suspension_forces
from sysid.balance.laws import Unknown
from sysid.balance.motion import END_S, HIGHEST_HZ, smoother, stretching
from sysid.balance.records import AxleLoads
from sysid.balance.search import Found, shapes_at
from sysid.display import Z90

#: Forces are used to 25 Hz: every second one will do where readings are at most this far apart [s].
_CLOSE_S = 0.005
#: Segments of the spectra [s], which overlap by half, as those of predicted loads.
SEGMENT_S = 8.0
#: Steps of derivatives by the laws, in standard deviations.
_PART = 0.1


@dataclass(frozen=True)
class Force:
    """Change of the road's force on one axle in one stretch: `value` (n,) [N], and its derivatives `by` (k, n).

    They are `step_s` [s] apart, the stretch's times :func:`fewer`. `places` (k,) are those of the unknowns in the
    covariance of the balance. The force by displacements is `mass` [kg] times the acceleration of the axle, less
    alpha + i omega beta, `dynamic`, times the deflection.
    """

    step_s: float
    value: np.ndarray
    places: np.ndarray
    by: np.ndarray
    mass: float
    dynamic: tuple[float, float]

    def of_state(self, omega: np.ndarray, axle: int, deflections: np.ndarray) -> np.ndarray:
        """The force by displacements (F, nx) at `omega` (F,), `deflections` (na, nx) by displacements."""
        alpha, beta = self.dynamic
        by = -(alpha + 1j * omega[:, None] * beta) * deflections[axle]
        by[:, deflections.shape[1] - deflections.shape[0] + axle] -= self.mass * omega**2
        return np.asarray(by)


def fewer(block: Block) -> int:
    """Samples of a stretch for one of the forces."""
    return 2 if block.stretch.step_s <= _CLOSE_S + 1e-9 else 1


def slower(block: Block, values: np.ndarray) -> np.ndarray:
    """Every so many of values (..., n), less what is too fast for them."""
    return values if fewer(block) == 1 else np.asarray(resample_poly(values, 1, fewer(block), axis=-1, padtype="line"))


def forces_of(block: Block, unknowns: Sequence[Unknown], found: Found) -> list[Force]:
    """Forces of the road on all axles in a stretch, front to rear, at the end of the search."""
    na, n, step = len(block.vehicle.axles), block.stretch.count, block.stretch.step_s
    nu, count, masses = block.columns.size, len(unknowns), len(block.changes)
    sd = np.sqrt(np.diag(found.covariance))
    shapes = shapes_at(unknowns, found.values, na)
    shape_bases(block, shapes)
    pull = suspension_forces(block, unknowns, found.values, shapes)
    acceleration = block.motion.acceleration[nu:]
    by: list[dict[int, np.ndarray]] = [{} for _ in range(na)]
    case = block.passage.load_case
    for quantity in dict.fromkeys(u.quantity for u in unknowns):
        moved = found.values.copy()
        steps = {}
        for j, u in enumerate(unknowns):
            if u.quantity == quantity and u.load_case in (case, None):
                steps[j] = _PART * max(float(sd[j]), 1e-6 * u.sd)
                moved[j] += steps[j]
        there = suspension_forces(block, unknowns, moved, shapes_at(unknowns, moved, na))
        for j, h in steps.items():
            for i in range(na) if unknowns[j].axle is None else (unknowns[j].axle or 0,):
                by[i][j] = slower(block, -(there[i] - pull[i]) / h)
    for j, change in enumerate(block.changes):
        if change is not None:
            for i in np.flatnonzero(change.unsprung).tolist():
                by[i][count + j] = slower(block, change.unsprung[i] * acceleration[i])
    omega = 2.0 * np.pi * np.fft.rfftfreq(n, step)
    shares = departure_shares(omega)
    departures = count + masses + na
    gains = departures + DEPARTURES * na
    readings = np.fft.rfft(block.stretch.readings, axis=1)[:, block.chosen].T
    kept = n // fewer(block)

    def back(spectrum: np.ndarray) -> np.ndarray:
        return np.asarray(np.fft.irfft(spectrum[: kept // 2 + 1], kept) / fewer(block))

    forces = []
    for i in range(na):
        for part, spectrum in enumerate(shares * np.fft.rfft(pull[i])):
            by[i][departures + DEPARTURES * i + part] = back(-spectrum)
        _, dynamic = axle_force(block, i, unknowns, found.values).force
        mass = float(block.matrices.unsprung_mass[i])
        linear = float(dynamic[0].real), float(dynamic[0].imag / block.omega[0])
        value = slower(block, mass * acceleration[i] - pull[i])
        force = Force(step * fewer(block), value, np.empty(0), np.empty(0), mass, linear)
        of_state = force.of_state(block.omega, i, stretching(block.matrices))
        of_readings = (of_state[:, None, :] @ block.gain)[:, 0] * readings
        for g, column in enumerate((of_readings @ block.of_gains).T):
            spectrum = np.zeros(omega.size, complex)
            spectrum[block.chosen] = column
            by[i][gains + g] = back(spectrum)
        forces.append(replace(force, places=np.array(list(by[i])), by=np.array(list(by[i].values()))))
    return forces


def axle_loads(
    driven: Sequence[tuple[Block, list[Force]]],
    unknowns: Sequence[Unknown],
    found: Found,
    scale_sd: float,
    gain_sd: float,
) -> tuple[AxleLoads, ...]:
    """Spectra and load coefficients of all axles, one record per log, from its longest stretch.

    Parameters
    ----------
    driven
        Stretches of drives with their forces.
    unknowns, found
        Of the balance.
    scale_sd, gain_sd
        Standard deviations of the logarithms of two factors that the balance does not see: on all masses, forces and
        loads at rest, and on all sensors.
    """
    longest: dict[str, tuple[Block, list[Force]]] = {}
    for block, forces in driven:
        other = longest.get(block.passage.file)
        if other is None or block.stretch.count > other[0].stretch.count:
            longest[block.passage.file] = block, forces
    return tuple(_of_block(*each, len(unknowns), found, scale_sd, gain_sd) for each in longest.values())


def _of_block(
    block: Block, forces: Sequence[Force], laws: int, found: Found, scale_sd: float, gain_sd: float
) -> AxleLoads:
    step, n = forces[0].step_s, forces[0].value.size
    per_segment = min(n, round(SEGMENT_S / step))
    rate = 1.0 / step
    density, low, high, coefficient = [], [], [], []
    frequency = np.fft.rfftfreq(per_segment, step)
    kept = frequency <= min(HIGHEST_HZ, 0.4 * rate)
    df = frequency[1]
    # Independent segments that overlapping ones are worth (Hann: P. D. Welch, 1967).
    segments = max(1.0, 1.89 * (n / per_segment) - 0.89)
    static = block.matrices.static_load
    at_rest = np.zeros((static.size, found.covariance.shape[0]))
    for j, change in enumerate(block.changes):
        if change is not None:
            at_rest[:, laws + j] = change.static / static
    left = _unexplained(block)
    _, by_noise = smoother(block.stretch, 2.0 * np.pi * frequency)
    ends = int(END_S / step)
    inside = slice(ends, n - ends)
    slow = np.fft.rfftfreq(n, step) <= frequency[kept][-1]
    for i, force in enumerate(forces):
        _, raw = welch(force.value, rate, nperseg=per_segment)
        of_state = force.of_state(2.0 * np.pi * frequency, i, stretching(block.matrices))
        noise = 2.0 * block.stretch.step_s * np.einsum("fx,fxy,fy->f", of_state, by_noise, np.conj(of_state)).real
        other = np.interp(frequency, block.omega / (2.0 * np.pi), 2.0 * block.stretch.step_s * left[:, i])
        true = np.maximum(raw - noise, 1e-3 * raw)
        _, crossed = csd(force.value, force.by, rate, nperseg=per_segment)
        change = 2.0 * crossed.real.T
        covariance = found.covariance[np.ix_(force.places, force.places)]
        by_laws = np.einsum("fj,jk,fk->f", change, covariance, change)
        by_chance = (2.0 * true * (noise + other) + noise**2 + other**2) / segments
        half = Z90 * np.sqrt(by_laws + by_chance + (2.0 * true * math.hypot(scale_sd, gain_sd)) ** 2)
        density.append(true[kept])
        low.append(np.maximum(true - half, 0.0)[kept])
        high.append((true + half)[kept])
        # All of the stretch counts alike here, and in the spectrum its middle.
        about = np.fft.irfft(slow * np.fft.rfft(force.value), n)[inside]
        about -= about.mean()
        power = float(np.mean(about**2))
        area = max(power - float(np.sum(noise[kept]) * df), 1e-3 * power)
        row = np.zeros(found.covariance.shape[0])
        row[force.places] = force.by[:, inside] @ about / (about.size * area)
        row -= at_rest[i]
        variance = float(row @ found.covariance @ row) + gain_sd**2
        variance += 0.25 * float(np.sum(by_chance[kept])) * df**2 / area**2
        value, sd = math.sqrt(area) / float(static[i]), math.sqrt(variance)
        coefficient.append((value, value * math.exp(-Z90 * sd), value * math.exp(Z90 * sd)))
    values, lows, highs = (np.array(x) for x in zip(*coefficient, strict=True))
    return AxleLoads(
        block.passage.file, block.passage.load_case, n * step, static, values, lows, highs, frequency[kept],
        np.array(density), np.array(low), np.array(high),
    )  # fmt: skip


def _unexplained(block: Block) -> np.ndarray:
    """Smallest suspension forces (F, na) that would explain what the balance leaves, as variances [N2]."""
    lever = np.linalg.pinv(block.matrices.attachment[:, block.columns].T)
    each = np.einsum("iu,buv,iv->bi", lever, block.unexplained, lever)
    return np.repeat(each, [b - a for a, b in block.bands], axis=0)
