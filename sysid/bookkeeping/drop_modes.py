"""Drops against runs: after the fall the truck rings in its modes, which follow from its masses and the runs' springs.

M u'' + C u' + K u = 0 with the stiffness and damping that the balance of the frames finds in the runs gives poles p_j;
the suspension of a drop then moves as sum_j Re(a_j exp(p_j t)) + b, whatever the fall was like: the a_j are free.  With
the masses of another load case, or other springs, the poles do not fit.  Neighbours and pitch are in the modes, so the
frequency of a single axle has not to be guessed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.bookkeeping.force_balance import Balance, frame_rise
from sysid.campaign.gaps import readings_at
from sysid.campaign.records import PlankDrop
from sysid.campaign.statics import static_equilibrium
from sysid.campaign.vehicle_records import LoadCase, Vehicle

#: Motion of bodies [Hz]: modes up to it are those of the ringing.
HIGHEST_HZ = 6.0
#: Steps of the ringing, and how long it is used [s].
_STEP_S, _USED_S = 0.005, 1.2
_PLATEAU_S, _AT_REST_S = 0.3, 0.7


@dataclass(frozen=True)
class Ringing:
    """Deflection (n,) [m] of the suspension of a drop after its landing, every `_STEP_S`, and its drop.

    `noise_m`: standard deviation of the readings at rest, at the end of the record [m].
    """

    drop: PlankDrop
    deflection_m: np.ndarray
    noise_m: float = 0.0

    @property
    def power(self) -> float:
        """Sum of the squares about the mean [m^2]."""
        return float(np.sum((self.deflection_m - self.deflection_m.mean()) ** 2))


def ringings(drops: Sequence[PlankDrop]) -> Iterator[Ringing]:
    """What rings after each drop; nothing of drops with a gap there, without a deflection, or that do not fall."""
    for drop in drops:
        found = _ringing(drop)
        if found is not None:
            yield Ringing(drop, *found)


def _ringing(drop: PlankDrop) -> tuple[np.ndarray, float] | None:
    channel = next((c for c in drop.log.channels if c.sensor.kind == "suspension_deflection"), None)
    if channel is None or channel.time_s.size < 100:
        return None
    time = np.arange(float(channel.time_s[0]), float(channel.time_s[-1]), _STEP_S)
    value = readings_at(channel, time, HIGHEST_HZ)
    if not np.isfinite(value[time < time[0] + _PLATEAU_S]).any() or not np.isfinite(value[-10:]).any():
        return None
    rest = value[time > time[-1] - _AT_REST_S]
    away = value - np.nanmedian(rest)
    plateau = float(np.nanmedian(away[time < time[0] + _PLATEAU_S]))
    if not np.isfinite(away).any() or not np.isfinite(plateau):
        return None
    # The wheel has landed where the suspension is furthest from where it was before the fall.
    begin = int(np.nanargmax(np.abs(away - plateau)))
    used = away[begin : begin + round(_USED_S / _STEP_S)]
    whole = used.size == round(_USED_S / _STEP_S) and np.isfinite(used).all()
    return (used, float(np.nanstd(rest))) if whole else None


def poles(vehicle: Vehicle, load_case: LoadCase, found: Balance, factor: float = 1.0) -> np.ndarray:
    """Poles [1/s] of the modes up to `HIGHEST_HZ`, with the springs of the runs times a factor; of pairs one each."""
    axles, frames = len(vehicle.axles), len(vehicle.bodies) + 1
    mass, stiffness, damping = np.zeros((3, frames + axles, frames + axles))
    centre = static_equilibrium(vehicle, load_case).cg_x_m
    for b in range(len(vehicle.bodies)):
        rise = np.concatenate([frame_rise(vehicle, b, float(centre[b])), np.zeros(axles)])
        mass += load_case.sprung_mass_kg[b] * np.outer(rise, rise)
        mass[1 + b, 1 + b] += load_case.pitch_inertia_kg_m2[b]
    for i, axle in enumerate(vehicle.axles):
        row = np.concatenate([frame_rise(vehicle, axle.body, axle.x_m), -np.eye(axles)[i]])
        stiffness += factor * found.stiffness[i] * np.outer(row, row)
        damping += np.sqrt(factor) * max(float(found.damping[i]), 0.0) * np.outer(row, row)
        at = frames + i
        mass[at, at] += vehicle.unsprung_mass_kg[i]
        stiffness[at, at] += axle.tire_stiffness_N_per_m
        damping[at, at] += axle.tire_damping_N_s_per_m
    zero, one = np.zeros_like(mass), np.eye(len(mass))
    values = np.linalg.eigvals(np.block([[zero, one], [-np.linalg.solve(mass, np.hstack([stiffness, damping]))]]))
    kept = values[(values.imag >= 0.0) & (np.abs(values) < 2.0 * np.pi * HIGHEST_HZ)]
    return np.asarray(kept)


def unexplained(ringing: Ringing, modes: np.ndarray) -> float:
    """What modes with these poles leave of the squares of a ringing [m^2]."""
    time = _STEP_S * np.arange(ringing.deflection_m.size)
    columns = [np.ones(time.size)]
    for pole in modes:
        decay = np.exp(pole * time)
        columns += [decay.real, decay.imag] if pole.imag > 0.0 else [decay.real]
    design = np.stack(columns, axis=1)
    amplitudes = np.linalg.lstsq(design, ringing.deflection_m, rcond=1e-6)[0]
    return float(np.sum((ringing.deflection_m - design @ amplitudes) ** 2))
