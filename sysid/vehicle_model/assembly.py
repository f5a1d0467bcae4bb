"""Mass matrix and kinematic rows of the planar vehicle, from geometry and mass properties.

Coordinates of one chain of hinged bodies: fore-aft travel xi of the first body's centre of gravity about its nominal
position (forward positive), its heave z (up), and the pitch theta of every body (nose-up).  Each axle adds its own
heave.  All angles are small.  A point of body b at x (rearward) and height h moves by

    up       z_b  - theta_b (x - x_b)
    forward  xi_b - theta_b (h - h_b)

with (x_b, h_b) the body's centre of gravity; a hinge at (x_h, h_h) makes both equal for the bodies it joins. Axles move
along the vertical axis of the body; a beam that joins several axles carries them at wheel height. So an unsprung mass
below the centre of gravity adds to the pitch inertia, and a horizontal force at the wheel centre turns the body. Static
loads that act off the height of the centre of gravity tilt with the body; the second-order terms of their potential
give each body the (negative) pitch stiffness

    sum_i S_i (h_i - h_b) + H_b (h_hitch - h_b) - H_(b+1) (h_next hitch - h_b)

with S_i the static suspension forces, H_b the load on the body's own hinge and H_(b+1) the load it carries behind.

A body whose frame bends has one more coordinate, by which a point at x rises phi(x) times as much
(:mod:`sysid.vehicle_model.bending`): above its suspensions, at its hinges and at its sensors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sysid.arrays import Axles
from sysid.campaign.statics import carried_by_suspensions, chains, static_equilibrium
from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.vehicle_model.beams import Beams, assemble_beams, unsprung_names
from sysid.vehicle_model.bending import FrameMode, frame_modes

#: Half of the length over which the slope of a bent frame is taken [m].
_SLOPE_M = 1e-3


@dataclass(frozen=True)
class PlanarMatrices:
    """Arrays of one vehicle in one load case; nb body coordinates, na axles.

    - `mass` (nb, nb): body block [kg, kg m, kg m2];
    - `tilt` (nb, nb): stiffness of the static loads [N m/rad];
    - `unsprung_mass` (na,): with the share of a common beam [kg];
    - `attachment` (na, nb): vertical motion of the body above each suspension (of an axle group the first row; its
      second row is the pitch of the body, further ones are zero, as the unsprung coordinates of :class:`Beams`);
    - `travel` (na, nb): forward motion of each wheel centre;
    - `drive` (chains, nb): forward motion of the point of its first body where each chain is driven: the centre of
      gravity, or the road;
    - `chain_mass` (chains,): mass that is driven [kg];
    - `hold_s`: time constant of the drive [s], None for those of the runs, and `hold_factor` on it;
    - `static_load` (na,): vertical road force at rest [N];
    - `carried_load` (na,): static force on its suspension [N];
    - `heave_rows`, `travel_rows`, `pitch_rows` (bodies, nb): motion of each centre of gravity;
    - `cg_x` (bodies,): [m];
    - `beams`: if axles are grouped, else None;
    - `sharing` (na, na) means over the axles that every rocker joins, None without rockers;
    - `frames`: the bending modes, and `frame_columns` (modes,): their places among the body coordinates.
    """

    mass: np.ndarray
    tilt: np.ndarray
    unsprung_mass: Axles
    attachment: np.ndarray
    travel: np.ndarray
    drive: np.ndarray
    chain_mass: np.ndarray
    static_load: Axles
    carried_load: Axles
    heave_rows: np.ndarray
    travel_rows: np.ndarray
    pitch_rows: np.ndarray
    cg_x: np.ndarray
    beams: Beams | None = None
    sharing: np.ndarray | None = None
    frames: tuple[FrameMode, ...] = ()
    frame_columns: tuple[int, ...] = ()
    hold_s: float | None = None
    hold_factor: float = 1.0

    def body_point(self, body: int, x_m: float) -> np.ndarray:
        """Row (nb,) that gives the vertical motion of a point of `body` at `x_m` behind axle 1."""
        row = self.heave_rows[body] - self.pitch_rows[body] * (x_m - self.cg_x[body])
        for frame, column in zip(self.frames, self.frame_columns, strict=True):
            if frame.body == body:
                row = row + frame.rise(x_m) * np.eye(row.size)[column]
        return np.asarray(row)

    def body_turn(self, body: int, x_m: float | None) -> np.ndarray:
        """Row (nb,) that gives the rotation of `body`, nose up, at `x_m` of a frame that bends."""
        row = self.pitch_rows[body]
        for frame, column in zip(self.frames, self.frame_columns, strict=True):
            if frame.body == body and x_m is not None:
                slope = (frame.rise(x_m + _SLOPE_M) - frame.rise(x_m - _SLOPE_M)) / (2.0 * _SLOPE_M)
                row = row - slope * np.eye(row.size)[column]
        return np.asarray(row)


def coordinate_names(vehicle: Vehicle) -> tuple[str, ...]:
    """Names of the generalised coordinates: body coordinates chain by chain, then unsprung ones.

    Those are the heave of each axle, and heave and pitch of the beam of each axle group.
    """
    names: list[str] = []
    for chain in chains(vehicle):
        names += [f"fore-aft {vehicle.bodies[chain[0]].name}", f"heave {vehicle.bodies[chain[0]].name}"]
        names += [f"pitch {vehicle.bodies[b].name}" for b in chain]
        names += [f"bending {vehicle.bodies[b].name}" for b in chain if vehicle.bodies[b].bending is not None]
    return (*names, *unsprung_names(vehicle))


def body_coordinates(vehicle: Vehicle) -> int:
    """Number of the generalised coordinates of bodies."""
    return len(coordinate_names(vehicle)) - len(unsprung_names(vehicle))


def assemble(vehicle: Vehicle, load_case: LoadCase, first: LoadCase | None = None) -> PlanarMatrices:
    """Assemble the planar model of a vehicle in one load case; `first` is the one that frames' frequencies belong to.

    M = sum_b m_b (z_b z_b' + xi_b xi_b') + I_b theta_b theta_b' + sum_i m_ui x_i x_i', where z_b, xi_b, theta_b and x_i
    are the rows that give each motion from the body coordinates. The modal mass is added at the amplitude of every
    bending mode.

    Raises
    ------
    CampaignError
        If axle loads and masses do not add up.
    """
    statics = static_equilibrium(vehicle, load_case)
    cg_x = np.asarray(statics.cg_x_m, float)
    cg_h = np.asarray(load_case.cg_height_m, float)
    groups = chains(vehicle)
    frames = frame_modes(vehicle, load_case, first)
    heave, travel, pitch, bend = _body_rows(vehicle, groups, cg_x, cg_h, frames)
    axles = vehicle.axles
    body_of = np.array([a.body for a in axles])
    wheel_h = np.array([a.tire_radius_m for a in axles])
    unsprung = np.array(vehicle.unsprung_mass_kg)
    support_x = np.array(vehicle.suspension_x_m)
    attachment = heave[body_of] - pitch[body_of] * (support_x - cg_x[body_of])[:, None]
    columns = tuple(int(np.flatnonzero(bend[f.body])[0]) for f in frames)
    for frame, column in zip(frames, columns, strict=True):
        carrying = np.flatnonzero(body_of == frame.body)
        attachment[carrying, column] += [frame.rise(x) for x in support_x[carrying]]
    for group in vehicle.groups:
        attachment[list(group.axles[1:])] = 0.0
        attachment[list(group.axles[1:2])] = pitch[body_of[group.axles[0]]]
    wheel_travel = travel[body_of] - pitch[body_of] * (wheel_h - cg_h[body_of])[:, None]
    sprung = np.asarray(load_case.sprung_mass_kg, float)
    inertia = np.asarray(load_case.pitch_inertia_kg_m2, float)
    mass = (
        heave.T @ (sprung[:, None] * heave)
        + travel.T @ (sprung[:, None] * travel)
        + pitch.T @ (inertia[:, None] * pitch)
        + wheel_travel.T @ (unsprung[:, None] * wheel_travel)
    )
    mass[columns, columns] += [f.modal_mass for f in frames]
    hitch_load = np.asarray(statics.hitch_load_N, float)
    preload = np.asarray(statics.suspension_preload_N, float)
    tilt = np.zeros(len(vehicle.bodies))
    np.add.at(tilt, body_of, preload * (wheel_h - cg_h[body_of]))
    for chain in groups:
        for front, rear in pairwise(chain):
            hinge_h = _hinge_height(vehicle, rear, cg_h)
            tilt[rear] += hitch_load[rear] * (hinge_h - cg_h[rear])
            tilt[front] -= hitch_load[rear] * (hinge_h - cg_h[front])
    leading = [chain[0] for chain in groups]
    # Engine, axle and wheels turn against each other: together they push the body at the height of the road.
    below = cg_h[leading] if vehicle.driven_at == "road" else np.zeros(len(leading))
    return PlanarMatrices(
        mass=mass,
        tilt=pitch.T @ (tilt[:, None] * pitch),
        unsprung_mass=unsprung,
        attachment=attachment,
        travel=wheel_travel,
        drive=travel[leading] + below[:, None] * pitch[leading],
        chain_mass=np.array([sprung[c].sum() + unsprung[np.isin(body_of, c)].sum() for c in groups]),
        static_load=statics.tire_load_N,
        carried_load=carried_by_suspensions(vehicle) @ preload,
        heave_rows=heave,
        travel_rows=travel,
        pitch_rows=pitch,
        cg_x=cg_x,
        beams=assemble_beams(vehicle),
        sharing=equaliser_means(vehicle),
        frames=frames,
        frame_columns=columns,
        hold_s=vehicle.hold_s,
        hold_factor=vehicle.hold_factor,
    )


def equaliser_means(vehicle: Vehicle) -> np.ndarray | None:
    """Matrix (na, na) that turns spring forces into their mean over the axles of each rocker, else into themselves."""
    if not vehicle.equalisers:
        return None
    means = np.eye(len(vehicle.axles))
    for rocker in vehicle.equalisers:
        members = list(rocker.axles)
        means[np.ix_(members, members)] = 1.0 / len(members)
    return means


def _body_rows(
    vehicle: Vehicle, groups: list[list[int]], cg_x: np.ndarray, cg_h: np.ndarray, frames: Sequence[FrameMode]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Heave, forward motion, pitch and bending of every body, (bodies, nb) each, from the body coordinates."""
    modes = {frame.body: frame for frame in frames}
    nb = sum(2 + len(chain) for chain in groups) + len(modes)
    heave = np.zeros((len(vehicle.bodies), nb))
    travel, pitch, bend = np.zeros_like(heave), np.zeros_like(heave), np.zeros_like(heave)
    column = 0
    for chain in groups:
        travel[chain[0], column] = 1.0
        heave[chain[0], column + 1] = 1.0
        for offset, body in enumerate(chain):
            pitch[body, column + 2 + offset] = 1.0
        bending = [body for body in chain if body in modes]
        for offset, body in enumerate(bending):
            bend[body, column + 2 + len(chain) + offset] = 1.0
        for front, rear in pairwise(chain):
            hinge = vehicle.bodies[rear]
            hinge_h = _hinge_height(vehicle, rear, cg_h)
            hinge_x = float(hinge.hitch_x_m or 0.0)
            heave[rear] = heave[front] - pitch[front] * (hinge_x - cg_x[front]) + pitch[rear] * (hinge_x - cg_x[rear])
            for body, side in ((front, 1.0), (rear, -1.0)):
                if body in modes:
                    heave[rear] += side * modes[body].rise(hinge_x) * bend[body]
            travel[rear] = travel[front] - pitch[front] * (hinge_h - cg_h[front]) + pitch[rear] * (hinge_h - cg_h[rear])
        column += 2 + len(chain) + len(bending)
    return heave, travel, pitch, bend


def _hinge_height(vehicle: Vehicle, body: int, cg_height: np.ndarray) -> float:
    """Height of the hinge in front of a body, its centre of gravity's where none is declared."""
    declared = vehicle.bodies[body].hitch_height_m
    return float(cg_height[body]) if declared is None else declared
