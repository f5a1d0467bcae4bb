"""Rigid beams that carry groups of axles: coordinates, mass matrix, and where wheels and suspensions stand.

A beam over the axles x_1 ... x_n has its middle at x_m = mean(x_i) and moves by its heave u (up) and its pitch psi
(nose-up); wheel i under it rises by u - psi (x_i - x_m).  With unsprung masses m_i of the axles, mass m_b and pitch
inertia I_b of the beam, whose centre of gravity is its middle, the kinetic energy is

    T = 1/2 [m_b u'^2 + I_b psi'^2 + sum_i m_i (u' - psi' (x_i - x_m))^2].

The body stands on the middle, so that the suspension sees u alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.campaign.vehicle_records import Vehicle


@dataclass(frozen=True)
class Beams:
    """Unsprung coordinates of a vehicle with axle groups, na slots for na axles.

    A single axle's slot is its heave. A group's first slot is the heave of the beam's middle, its second slot the
    beam's pitch; unused slots do not move.

    - `wheel` (na, na) gives the rise of each wheel from the coordinates;
    - `mass` (na, na) [kg, kg m, kg m2]: 1 for an unused slot;
    - `carries` (na,): 1 if a suspension is connected to the slot's heave, else 0;
    - `used` (na,) bool: False for unused slots.
    """

    wheel: np.ndarray
    mass: np.ndarray
    carries: np.ndarray
    used: np.ndarray


def assemble_beams(vehicle: Vehicle) -> Beams | None:
    """Coordinates and masses of the beams of a vehicle; None where every axle moves by itself."""
    groups = [g for g in vehicle.groups if len(g.axles) > 1]
    if not groups:
        return None
    count = len(vehicle.axles)
    wheel, mass = np.eye(count), np.diag(vehicle.unsprung_mass_kg)
    used = np.ones(count, bool)
    for group in groups:
        members = list(group.axles)
        first, second = members[:2]
        rows = np.zeros((len(members), count))
        x = np.array([vehicle.axles[i].x_m for i in members])
        rows[:, first] = 1.0
        rows[:, second] = x.mean() - x
        axle_mass = np.array([vehicle.axles[i].unsprung_mass_kg for i in members])
        wheel[members] = rows
        mass[members, members] = 0.0
        mass += rows.T @ (axle_mass[:, None] * rows)
        mass[first, first] += group.mass_kg
        mass[second, second] += group.pitch_inertia_kg_m2
        left_over = members[2:]
        used[left_over] = False
        mass[left_over, left_over] = 1.0
    carries = np.equal(vehicle.suspension_axle, np.arange(count)).astype(float)
    return Beams(wheel, mass, carries, used)


def unsprung_names(vehicle: Vehicle) -> tuple[str, ...]:
    """Names of the unsprung coordinates in use, in the order of their slots."""
    owner = {i: group for group in vehicle.groups if len(group.axles) > 1 for i in group.axles}
    names = []
    for i, axle in enumerate(vehicle.axles):
        if i not in owner:
            names.append(f"heave {axle.name}")
        elif i in owner[i].axles[:2]:
            names.append(f"{'heave' if i == owner[i].axles[0] else 'pitch'} {owner[i].name}")
    return tuple(names)
