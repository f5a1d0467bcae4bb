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
from sysid.campaign.records import BumpRun, Channel
from sysid.campaign.statics import chains, static_equilibrium
from sysid.campaign.vehicle_records import LoadCase, Vehicle

#: Below, offsets and drift count; above, frames bend and deflections are small (an assumption).
BAND_HZ = (0.8, 6.0)
#: Rows of the sensors must tell all motions of the frames apart by this singular value, and channels be whole.
_DISTINCT, _WHOLE = 0.3, 0.9
#: Deflections that were lost follow from the accelerations of frame and axle, for this share of the axles at most.
_REPLACED = 0.34


@dataclass(frozen=True)
class RunSpectra:
    """Spectra of one run in the band.

    `motion` (n + 1, F) generalised accelerations of n bodies [m/s^2, rad/s^2], `deflection` (axles, F) [m],
    `omega` (F,) [rad/s].
    """

    file: str
    load_case: str
    motion: np.ndarray
    deflection: np.ndarray
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
    grid = np.arange(0.0, log.duration_s + 0.5 * step, step)
    frequency = np.fft.rfftfreq(grid.size, step)
    band = (frequency >= BAND_HZ[0]) & (frequency <= min(BAND_HZ[1], 0.4 / step))
    if band.sum() < 10:
        return None
    edge = max(2, grid.size // 20)
    window = np.ones(grid.size)
    window[:edge] = 0.5 - 0.5 * np.cos(np.pi * np.arange(edge) / edge)
    window[-edge:] = window[:edge][::-1]
    deflection: dict[int, np.ndarray] = {}
    axle_motion: dict[int, np.ndarray] = {}
    rows, readings = [], []
    for channel in log.channels:
        spectrum = _spectrum(channel, grid, window, band)
        sensor = channel.sensor
        if spectrum is None:
            continue
        if sensor.kind == "suspension_deflection" and sensor.axle is not None:
            deflection[sensor.axle] = spectrum
        elif sensor.kind == "axle_acceleration" and sensor.axle is not None:
            axle_motion[sensor.axle] = spectrum
        elif sensor.kind == "body_acceleration" and sensor.body is not None and sensor.x_m is not None:
            rows.append(frame_rise(vehicle, sensor.body, sensor.x_m))
            readings.append(spectrum)
    if np.linalg.matrix_rank(np.array(rows), tol=_DISTINCT) < len(vehicle.bodies) + 1:
        return None
    motion = np.linalg.lstsq(np.array(rows), np.array(readings), rcond=None)[0]
    omega = 2.0 * np.pi * frequency[band]
    by_axle = _all_deflections(vehicle, deflection, axle_motion, motion, omega)
    return None if by_axle is None else RunSpectra(log.file, run.load_case, motion, by_axle, omega)


def _all_deflections(
    vehicle: Vehicle,
    measured: Mapping[int, np.ndarray],
    axle_motion: Mapping[int, np.ndarray],
    motion: np.ndarray,
    omega: np.ndarray,
) -> np.ndarray | None:
    """(axles, F) deflections; those of a lost sensor by q'' = b - a; None where too many are lost."""
    lost = [i for i in range(len(vehicle.axles)) if i not in measured]
    if len(lost) > _REPLACED * len(vehicle.axles) or any(i not in axle_motion for i in lost):
        return None
    whole = dict(measured)
    for i in lost:
        axle = vehicle.axles[i]
        whole[i] = -(frame_rise(vehicle, axle.body, axle.x_m) @ motion - axle_motion[i]) / omega**2
    return np.array([whole[i] for i in range(len(vehicle.axles))])


def _spectrum(channel: Channel, grid: np.ndarray, window: np.ndarray, band: np.ndarray) -> np.ndarray | None:
    good = np.isfinite(channel.value) & (channel.censored == 0)
    if good.sum() < max(20, _WHOLE * good.size) or channel.time_s[good][-1] < grid[-1] - 0.3:
        return None
    value = np.interp(grid, channel.time_s[good], channel.value[good])
    return np.asarray(np.fft.rfft((value - np.median(value)) * window)[band])


def balance(
    spectra: Sequence[RunSpectra], vehicle: Vehicle, load_cases: Sequence[LoadCase], free: str | None = None
) -> Balance | None:
    """Solve the balance of all runs together.

    Parameters
    ----------
    spectra, load_cases
        Runs, and the masses that each is taken to have.
    free
        ``inertia``: the pitch inertia of every body about its hinge gets a factor of its own; ``moment``: the first
        moment, mass times the distance of the centre of gravity from the hinge, does.

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
        columns += [np.outer(p, -1j * run.omega * q) for p, q in zip(phi, run.deflection, strict=True)]
        columns += [-f for f in freed]
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
