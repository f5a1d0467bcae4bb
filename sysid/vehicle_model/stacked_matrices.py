"""Matrices of several runs, stacked for the integrator: what does not depend on the state or the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sysid.campaign.records import HOLD_S
from sysid.vehicle_model.assembly import PlanarMatrices

#: The driving force holds the nominal speed like F = (chain mass / T) (v_ref - v); T unless a run says otherwise.
SPEED_HOLD_S = HOLD_S["servo"]


class StackedBeams(NamedTuple):
    """Unsprung coordinates of R runs of a vehicle with axle groups, see :class:`sysid.vehicle_model.beams.Beams`.

    - `wheel` (R, na, na) turns coordinates into the rise of the wheels, and extensions at the coordinates into those
      above the wheels;
    - `tire`, `pull` (R, na, na) give the coordinates' accelerations from vertical tire forces and from suspension pull;
    - `carries` (R, na, 1) is 0 where no suspension stands.
    """

    wheel: np.ndarray
    tire: np.ndarray
    pull: np.ndarray
    carries: np.ndarray


class StackedFrames(NamedTuple):
    """Bending modes of the frames of R runs, nf of them.

    `select` (R, nf, nb) picks their amplitudes from the body coordinates, `push` (R, nb, nf) gives body accelerations
    from the restoring forces of the frames, in units of their amplitude [m/s2]: -M^-1 times the modal mass of their
    stiffness.
    """

    select: np.ndarray
    push: np.ndarray


class StackedMatrices(NamedTuple):
    """Matrices of R runs for the integrator; nb body coordinates, na axles, nr body sensors.

    - `position` (R, 2 na + nb, nb) turns body coordinates into attachment heights, wheel travel and the body
      acceleration from static loads that tilt with the body;
    - `rate` (R, 2 na + nb, nb) does the same for body rates, with the acceleration from the driving force;
    - `acceleration` (R, nb, 2 na) gives body accelerations from suspension pull and horizontal tire force;
    - `inverse_unsprung`, `static_load`, `carried_load` (R, na, 1): the last what each suspension carries at rest;
    - `body_rows` (R, nr, nb): vertical motion at the body accelerometers;
    - `beams` for vehicles with axle groups, else None;
    - `sharing` (R, na, na) means over the axles that every rocker joins, None without rockers;
    - `frames` where frames bend, else None;
    - `rate_rows` (R, nv, nb): rotation at the pitch-rate sensors, None without them.
    """

    position: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    inverse_unsprung: np.ndarray
    static_load: np.ndarray
    carried_load: np.ndarray
    body_rows: np.ndarray
    beams: StackedBeams | None = None
    sharing: np.ndarray | None = None
    frames: StackedFrames | None = None
    rate_rows: np.ndarray | None = None


def stack_matrices(
    matrices: list[PlanarMatrices],
    body_sensors: list[tuple[int, float]],
    hold_s: Sequence[float] | None = None,
    rate_sensors: Sequence[tuple[int, float | None]] = (),
) -> StackedMatrices:
    """Stack the matrices of R runs, with one row per body accelerometer, and per sensor of pitch rate, as (body, x_m).

    `hold_s` is the time constant T [s] with which each run's driving force holds the speed, infinite for none; None
    takes :data:`SPEED_HOLD_S` for all.
    """
    position, rate, acceleration, rows = [], [], [], []
    for m, hold_time in zip(matrices, hold_s or [SPEED_HOLD_S] * len(matrices), strict=True):
        inverse = np.linalg.inv(m.mass)
        hold = m.drive.T @ ((m.chain_mass / hold_time)[:, None] * m.drive)
        position.append(np.concatenate([m.attachment, m.travel, -inverse @ m.tilt]))
        rate.append(np.concatenate([m.attachment, m.travel, -inverse @ hold]))
        acceleration.append(inverse @ np.concatenate([-m.attachment.T, m.travel.T], axis=1))
        rows.append(np.array([m.body_point(body, x) for body, x in body_sensors]).reshape(-1, inverse.shape[0]))
    return StackedMatrices(
        position=np.stack(position),
        rate=np.stack(rate),
        acceleration=np.stack(acceleration),
        inverse_unsprung=np.stack([1.0 / m.unsprung_mass for m in matrices])[..., None],
        static_load=np.stack([m.static_load for m in matrices])[..., None],
        carried_load=np.stack([m.carried_load for m in matrices])[..., None],
        body_rows=np.stack(rows),
        beams=_stack_beams(matrices),
        sharing=_stack_sharing(matrices),
        frames=_stack_frames(matrices),
        rate_rows=np.array([[m.body_turn(*sensor) for sensor in rate_sensors] for m in matrices])
        if rate_sensors
        else None,
    )


def _stack_frames(matrices: list[PlanarMatrices]) -> StackedFrames | None:
    if not any(m.frames for m in matrices):
        return None
    select, push = [], []
    for m in matrices:
        unit = np.eye(m.mass.shape[0])[list(m.frame_columns)]
        select.append(unit)
        push.append(-np.linalg.solve(m.mass, unit.T * [f.stiffness_mass for f in m.frames]))
    return StackedFrames(np.stack(select), np.stack(push))


def _stack_sharing(matrices: list[PlanarMatrices]) -> np.ndarray | None:
    means = [m.sharing for m in matrices if m.sharing is not None]
    return np.stack(means) if means else None


def _stack_beams(matrices: list[PlanarMatrices]) -> StackedBeams | None:
    beams = [m.beams for m in matrices if m.beams is not None]
    if not beams:
        return None
    inverse = [np.linalg.inv(b.mass) for b in beams]
    return StackedBeams(
        wheel=np.stack([b.wheel for b in beams]),
        tire=np.stack([i @ b.wheel.T for i, b in zip(inverse, beams, strict=True)]),
        pull=np.stack(inverse),
        carries=np.stack([b.carries for b in beams])[..., None],
    )


def runs_side_by_side(arrays: Sequence[np.ndarray], axis: int = 0) -> np.ndarray:
    """Arrays of K models as one: runs lie along `axis`, and every run of the result is followed by its K - 1 twins."""
    shape = list(arrays[0].shape)
    shape[axis] *= len(arrays)
    return np.stack(arrays, axis=axis if axis < 0 else axis + 1).reshape(shape)
