"""Forces of suspensions from the motion of the frames: k, c, inertia and centre of gravity without any simulation.

g are the generalised accelerations of the rigid frames (heave of the first, pitch of each, with hinges), and q_i the
deflections of all axles. Then M g = -sum_i phi_i (k_i q_i + c_i q_i'), where phi_i is how the frame above axle i moves.
All of it is measured, so k_i and c_i, and what is doubtful in M, follow by linear least squares in the frequency
domain. Friction, stops and gas springs make it rough, but nothing has to be assumed about tires or road.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid import limits
from sysid.campaign.gaps import readings_at, window_over
from sysid.campaign.records import BumpRun, Channel
from sysid.campaign.statics import chains, static_equilibrium
from sysid.campaign.vehicle_records import LoadCase, Vehicle

#: Below, offsets and drift count; above, frames bend and deflections are small (an assumption).
BAND_HZ = (0.8, 6.0)
#: Rows of the sensors must tell all motions of the frames apart by this singular value.
_DISTINCT = 0.3
#: Shares of the record that a channel, and all channels together, must have seen.
_WHOLE, _TOGETHER = 0.9, 0.7
_DEFLECTION = "suspension_deflection"
#: Deflections that were lost follow from the accelerations of frame and axle, for this share of the axles at most.
_REPLACED = 0.34


@dataclass(frozen=True)
class RunSpectra:
    """Spectra of one run in the band.

    `motion` (n + 1, F) generalised accelerations of n bodies [m/s^2, rad/s^2], `deflection` (axles, F) [m] and
    `velocity` (axles, F) [m/s] of the suspensions, `omega` (F,) [rad/s].
    """

    file: str
    load_case: str
    motion: np.ndarray
    deflection: np.ndarray
    velocity: np.ndarray
    omega: np.ndarray


@dataclass(frozen=True)
class Balance:
    """Solution: `stiffness` [N/m] and `damping` [N s/m] (axles,), and the share of the inertia forces unexplained.

    `freed` are the factors on what was left free, per body, with `freed_se`.
    """

    stiffness: np.ndarray
    damping: np.ndarray
    unexplained: float
    freed: np.ndarray
    freed_se: np.ndarray


def frame_rise(vehicle: Vehicle, body: int, x_m: float) -> np.ndarray:
    """(bodies + 1,) how a point of a frame rises with heave of the first body at x = 0 and nose-up pitch of each."""
    places = hinges(vehicle)
    row = np.zeros(len(vehicle.bodies) + 1)
    row[0] = 1.0
    for k in range(body):
        row[1 + k] -= places[k + 1] - places[k]
    row[1 + body] -= x_m - places[body]
    return row


def hinges(vehicle: Vehicle) -> list[float]:
    """Where each body hangs on the one in front [m]; 0 for the first."""
    return [0.0, *(float(b.hitch_x_m or 0.0) for b in vehicle.bodies[1:])]


def run_spectra(run: BumpRun, vehicle: Vehicle) -> RunSpectra | None:
    """Spectra of a run, None where it lacks the deflection of an axle or sensors that show the frames' motion."""
    if len(chains(vehicle)) != 1 or vehicle.groups or vehicle.equalisers:
        return None
    log = run.log
    step = log.sample_interval_s
    if log.duration_s / step > limits.GRID_STEPS:
        return None
    time = step * np.arange(int(log.duration_s / step + 1e-6) + 1)
    frequency = np.fft.rfftfreq(time.size, step)
    omega = 2.0 * np.pi * frequency[(frequency >= BAND_HZ[0]) & (frequency <= min(BAND_HZ[1], 0.4 / step))]
    if omega.size < 10:
        return None
    used = {c.sensor.column: r for c in log.channels if (r := _seen(c, time)) is not None}
    # The acceleration of an axle replaces a deflection only, so that its gaps and clips do not count beside one.
    measured = {c.sensor.axle for c in log.channels if c.sensor.column in used and c.sensor.kind == _DEFLECTION}
    for c in log.channels:
        if c.sensor.kind == "axle_acceleration" and c.sensor.axle in measured:
            used.pop(c.sensor.column, None)
    window = window_over(time, list(used.values())) if used else None
    if window is None or window.known_s < _TOGETHER * time.size * step:
        return None
    deflection: dict[int, np.ndarray] = {}
    velocity: dict[int, np.ndarray] = {}
    axle_motion: dict[int, np.ndarray] = {}
    rows, readings = [], []
    for channel in log.channels:
        sensor = channel.sensor
        if sensor.column not in used:
            continue
        spectrum = window.transform(used[sensor.column], omega)
        if sensor.kind == _DEFLECTION and sensor.axle is not None:
            deflection[sensor.axle] = spectrum
            velocity[sensor.axle] = window.transform(used[sensor.column], omega, 1)
        elif sensor.kind == "axle_acceleration" and sensor.axle is not None:
            axle_motion[sensor.axle] = spectrum
        elif sensor.kind == "body_acceleration" and sensor.body is not None and sensor.x_m is not None:
            rows.append(frame_rise(vehicle, sensor.body, sensor.x_m))
            readings.append(spectrum)
    if np.linalg.matrix_rank(np.array(rows), tol=_DISTINCT) < len(vehicle.bodies) + 1:
        return None
    motion = np.linalg.lstsq(np.array(rows), np.array(readings), rcond=None)[0]
    lost = _lost_deflections(vehicle, deflection, axle_motion, motion, omega)
    # Integrated from accelerations, a deflection needs a record at rest at both ends.
    if lost is None or (lost and not window.whole):
        return None
    deflection |= lost
    velocity |= {axle: 1j * omega * q for axle, q in lost.items()}
    axles = range(len(vehicle.axles))
    stacked, rates = (np.array([of[i] for i in axles]) for of in (deflection, velocity))
    return RunSpectra(log.file, run.load_case, motion, stacked, rates, omega)


def _lost_deflections(
    vehicle: Vehicle,
    measured: Mapping[int, np.ndarray],
    axle_motion: Mapping[int, np.ndarray],
    motion: np.ndarray,
    omega: np.ndarray,
) -> dict[int, np.ndarray] | None:
    """Deflections (F,) of lost sensors, by axle, from q'' = b - a; None where too many are lost."""
    lost = [i for i in range(len(vehicle.axles)) if i not in measured]
    if len(lost) > _REPLACED * len(vehicle.axles) or any(i not in axle_motion for i in lost):
        return None
    rises = {i: frame_rise(vehicle, vehicle.axles[i].body, vehicle.axles[i].x_m) for i in lost}
    return {i: -(rise @ motion - axle_motion[i]) / omega**2 for i, rise in rises.items()}


def _seen(channel: Channel, time: np.ndarray) -> np.ndarray | None:
    """Readings at even times, NaN where missing or clipped; None where these are too many."""
    readings = readings_at(channel, time, BAND_HZ[1], clipped=False)
    return readings if np.isfinite(readings).mean() > _WHOLE else None


@dataclass(frozen=True)
class OwnSprings:
    """A part of the first body, such as a cab, on springs of its own at `x_m`, with a frequency there."""

    x_m: float
    frequency_hz: float
    damping_ratio: float = 0.15

    def moves_more(self, omega: np.ndarray) -> np.ndarray:
        """(F,) its motion over that of the frame below it, less one: (1 + 2 i z r) / (1 - r^2 + 2 i z r) - 1."""
        r = omega / (2.0 * np.pi * self.frequency_hz)
        return r**2 / (1.0 - r**2 + 2j * self.damping_ratio * r)


def balance(
    spectra: Sequence[RunSpectra],
    vehicle: Vehicle,
    load_cases: Sequence[LoadCase],
    free: str | None = None,
    part: OwnSprings | None = None,
) -> Balance | None:
    """Solve the balance of all runs together.

    Parameters
    ----------
    spectra, load_cases
        Runs, and the masses that each is taken to have.
    free
        ``inertia``: the pitch inertia of every body about its hinge gets a factor of its own; ``moment``: the first
        moment, mass times the distance of the centre of gravity from the hinge, does.
    part
        A part of the first body that moves against its frame; its share of the body's mass comes last in `freed`.

    Returns
    -------
    Balance or None
        None where the runs do not determine it.
    """
    rows, targets = [], []
    for run, load_case in zip(spectra, load_cases, strict=True):
        inertia, freed, size = _inertia_forces(run, vehicle, load_case, free)
        phi = np.array([frame_rise(vehicle, a.body, a.x_m) for a in vehicle.axles])
        columns = [np.outer(p, -q) for p, q in zip(phi, run.deflection, strict=True)]
        columns += [np.outer(p, -v) for p, v in zip(phi, run.velocity, strict=True)]
        columns += [-f for f in freed]
        if part is not None:
            rise = frame_rise(vehicle, 0, part.x_m)
            more = part.moves_more(run.omega) * (rise @ run.motion)
            columns.append(np.outer(rise, -load_case.sprung_mass_kg[0] * more))
        scaled = np.stack([(c / size).ravel() for c in columns], axis=1)
        target = (inertia / size).ravel()
        rows.append(np.concatenate([scaled.real, scaled.imag]))
        targets.append(np.concatenate([target.real, target.imag]))
    design, target = np.concatenate(rows), np.concatenate(targets)
    length = np.linalg.norm(design, axis=0)
    if not np.all(length > 0.0) or design.shape[0] <= design.shape[1]:
        return None
    solution, _, rank, _ = np.linalg.lstsq(design / length, target, rcond=1e-8)
    if rank < design.shape[1]:
        return None
    rest = target - design / length @ solution
    # Neighbouring frequencies of a windowed record tell the same, and what is left is no noise.
    spread = float(rest @ rest) / max(1.0, 0.3 * (target.size - design.shape[1]))
    error = np.sqrt(np.diag(np.linalg.inv((design / length).T @ (design / length))) * spread) / length
    count = len(vehicle.axles)
    solved = solution / length
    unexplained = float(rest @ rest) / len(spectra)
    return Balance(solved[:count], solved[count : 2 * count], unexplained, solved[2 * count :], error[2 * count :])


def _inertia_forces(
    run: RunSpectra, vehicle: Vehicle, load_case: LoadCase, free: str | None
) -> tuple[np.ndarray, list[np.ndarray], np.ndarray]:
    """Known part of M g, the parts that are free, one per body, and the size (n + 1, 1) of all of it."""
    places = hinges(vehicle)
    centre = static_equilibrium(vehicle, load_case).cg_x_m
    whole = np.zeros_like(run.motion)
    freed: list[np.ndarray] = []
    for b, place in enumerate(places):
        mass, arm = load_case.sprung_mass_kg[b], float(centre[b]) - place
        turning = load_case.pitch_inertia_kg_m2[b] + mass * arm**2
        rise = frame_rise(vehicle, b, place)
        pitch = np.zeros(rise.size)
        pitch[1 + b] = 1.0
        up, turn = rise @ run.motion, run.motion[1 + b]
        moment = -mass * arm * (np.outer(rise, turn) + np.outer(pitch, up))
        inertia = turning * np.outer(pitch, turn)
        whole = whole + mass * np.outer(rise, up) + moment + inertia
        freed.append({"inertia": inertia, "moment": moment}.get(free or "", np.zeros_like(whole)))
    size = np.sqrt(np.mean(np.abs(whole) ** 2, axis=1, keepdims=True) * whole.size)
    known = whole - sum(freed)
    return known, freed if free else [], np.maximum(size, 1e-12)
