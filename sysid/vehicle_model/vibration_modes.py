"""Natural modes of the planar vehicle standing on its tires: frequencies, damping ratios and mode shapes.

With every wheel on the ground and small motions x = (q, u) about static equilibrium the vehicle obeys

    M x'' + C x' + K x = 0,
    K = sum_i (k_i e_i' e_i + kt_i w_i' w_i) + T,    C = sum_i (c_i e_i' e_i + ct_i w_i' w_i),

with e_i the row of the extension of suspension i, w_i that of the rise of wheel i, M and T the mass matrix and the tilt
stiffness of :mod:`sysid.vehicle_model.assembly`.  Where a rocker shares spring forces, k_j e_j acts on the row
(1 - s) e_j + s mean e instead, the mean over the rocker's axles; springs that are not equally stiff then make K
unsymmetric.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import block_diag, eig, eigh
from scipy.optimize import linear_sum_assignment

from sysid.arrays import Axles
from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.errors import SysidError
from sysid.tabular import Tabular
from sysid.vehicle_model.assembly import PlanarMatrices, assemble, coordinate_names
from sysid.vehicle_model.bending import frame_ends

if TYPE_CHECKING:
    import pandas as pd

#: An eigenvalue below this fraction of the largest one is a rounded zero; below its negative the vehicle tips over.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class NaturalModes(Tabular):
    """Modes of a vehicle in one load case, n modes in the order of their undamped frequency.

    - `frequency_hz` (n,) without damping;
    - `damping_ratio` (n,): zeta = -Re(s)/|s| of the damped pole s, above 1 where the mode does not oscillate;
    - `damped_frequency_hz` (n,): |Im(s)|/2 pi, zero for a mode that does not oscillate;
    - `pole` (n,): the damped pole s [1/s] (of an overdamped pair the slower one).

    `coordinates` (c,) names the rows of `shape` (c, n): undamped mode shapes, real, without fore-aft momentum, scaled
    so that the largest of shape * `scale_m` is 1. `scale_m` (c,) makes coordinates comparable: 1 for travel and heave,
    half the distance between the outermost supports for a pitch [m]. `body_motion` (bodies, 3, n): fore-aft travel [m],
    heave [m] and pitch [rad] of each centre of gravity; `wheel_rise` (axles, n) [m]; `cg_x_m` (bodies,). `frame_x_m`
    (bodies, 25) stations along every body, and `frame_rise` (bodies, 25, n) what bending adds to their rise [m], zero
    for rigid bodies.
    """

    vehicle: Vehicle
    load_case: LoadCase
    frequency_hz: np.ndarray
    damping_ratio: np.ndarray
    damped_frequency_hz: np.ndarray
    pole: np.ndarray
    coordinates: tuple[str, ...]
    shape: np.ndarray
    scale_m: np.ndarray
    body_motion: np.ndarray
    wheel_rise: np.ndarray
    cg_x_m: np.ndarray
    frame_x_m: np.ndarray
    frame_rise: np.ndarray

    @property
    def dominant(self) -> tuple[str, ...]:
        """Per mode the coordinate that moves most."""
        size = np.abs(self.shape) * self.scale_m[:, None]
        return tuple(self.coordinates[k] for k in np.argmax(size, axis=0))

    def summary(self) -> pd.DataFrame:
        """One row per mode: frequencies [Hz], damping ratio, and the coordinate that moves most."""
        import pandas as pd

        return pd.DataFrame(
            {
                "mode": np.arange(1, self.frequency_hz.size + 1),
                "frequency_hz": self.frequency_hz,
                "damping_ratio": self.damping_ratio,
                "damped_frequency_hz": self.damped_frequency_hz,
                "moves_most": self.dominant,
            }
        )


@dataclass(frozen=True)
class SmallMotion:
    """M x'' + C x' + K x = 0 in r coordinates x without fore-aft momentum, about static equilibrium.

    - `mass`, `damping`, `stiffness` (r, r); rows (axles, r) of the `extension` of each suspension, the rise of each
      `wheel`, and of the body `above` each suspension;
    - `tire_stiffness` (axles,): [N/m];
    - `back` (c, r) to all coordinates of `matrices`.
    """

    matrices: PlanarMatrices
    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    extension: np.ndarray
    wheel: np.ndarray
    above: np.ndarray
    tire_stiffness: Axles
    back: np.ndarray


def natural_modes(
    vehicle: Vehicle,
    load_case: LoadCase,
    stiffness: Axles,
    damping: Axles | None = None,
    tire_stiffness: Axles | None = None,
    tire_damping: Axles | None = None,
    load_share: Axles | None = None,
    first: LoadCase | None = None,
    bending: Mapping[str, tuple[float, float]] | None = None,
) -> NaturalModes:
    """Natural frequencies, damping ratios and mode shapes of a vehicle on its tires.

    Undamped: K phi = omega^2 M phi. Damped: s v = [0 1; -M^-1 K, -M^-1 C] v, each pole paired with the undamped mode
    whose shape it is nearest to. Nothing holds a vehicle fore and aft, so the rigid fore-aft motion of each chain, with
    frequency zero, is not a mode: it is removed exactly, and the modes have no fore-aft momentum. The force that holds
    the speed of a simulated vehicle is not part of them.

    Parameters
    ----------
    stiffness, damping : (axles,) of each suspension [N/m, N s/m], damping zero if None.  A group of axles has one
        suspension, whose values stand at its first axle; those of its other axles are not used.
    tire_stiffness, tire_damping : (axles,) tangent values at the static load [N/m, N s/m]; the declared stiffness and
        no damping if None.
    load_share : (axles,) share s of each axle's rocker, 0 without; the declared ones if None.
    first : the load case that frequencies of bending frames belong to, this one if None.
    bending : frequency [Hz] and damping ratio of frames by the name of their body, in place of the declared ones.

    Raises
    ------
    SysidError
        If an array has another length or a negative value, a rocker's share is not known, or the vehicle does not
        stand stably (a stiffness missing, or a centre of gravity so high that it tips over).
    CampaignError
        If axle loads and masses do not add up.
    """
    rates = (stiffness, damping, tire_stiffness, tire_damping, load_share)
    motion = small_motion(vehicle, load_case, *rates, first=first, bending=bending)
    m, c, k, matrices, back = motion.mass, motion.damping, motion.stiffness, motion.matrices, motion.back
    square, shapes = _undamped(k, m)
    limit = _ROUNDING * square[-1]
    if square[0] < -limit:
        raise SysidError(
            f"The vehicle '{vehicle.name}' does not stand stably in load case '{load_case.name}': with these "
            "stiffnesses it tips over; check cg_height_m and the stiffnesses."
        )
    if square[0] <= limit:
        raise SysidError(
            f"The vehicle '{vehicle.name}' can move without any restoring force in load case '{load_case.name}': a "
            "stiffness is zero or nearly so."
        )
    omega = np.sqrt(square)
    # C of the modes' own coordinates: shapes' C shapes where K is symmetric and modal masses are 1.
    ratio, pole = _damped(omega, np.linalg.solve(m @ shapes, c @ shapes))
    return _result(vehicle, load_case, matrices, omega, ratio, pole, back @ shapes)


def small_motion(
    vehicle: Vehicle,
    load_case: LoadCase,
    stiffness: Axles,
    damping: Axles | None = None,
    tire_stiffness: Axles | None = None,
    tire_damping: Axles | None = None,
    load_share: Axles | None = None,
    *,
    first: LoadCase | None = None,
    bending: Mapping[str, tuple[float, float]] | None = None,
) -> SmallMotion:
    """Equations of small motions of a vehicle on its tires; arguments and errors as :func:`natural_modes`."""
    declared = np.array([a.tire_stiffness_N_per_m for a in vehicle.axles])
    rates = {
        "stiffness": stiffness,
        "damping": 0.0 * declared if damping is None else damping,
        "tire_stiffness": declared if tire_stiffness is None else tire_stiffness,
        "tire_damping": 0.0 * declared if tire_damping is None else tire_damping,
    }
    used = {name: _per_axle(name, values, vehicle) for name, values in rates.items()}
    matrices = assemble(vehicle, load_case, first)
    extension, wheel, mass = _rows(matrices)
    body_count = matrices.mass.shape[0]
    acting = extension
    if matrices.sharing is not None:
        share = _declared_share(vehicle) if load_share is None else np.asarray(load_share, float)
        acting = extension + (share[:, None] * (matrices.sharing - np.eye(share.size))).T @ extension
    k = acting.T @ (used["stiffness"][:, None] * extension) + wheel.T @ (used["tire_stiffness"][:, None] * wheel)
    c = extension.T @ (used["damping"][:, None] * extension) + wheel.T @ (used["tire_damping"][:, None] * wheel)
    k[:body_count, :body_count] += matrices.tilt
    for frame, column in zip(matrices.frames, matrices.frame_columns, strict=True):
        body = vehicle.bodies[frame.body]
        assert body.bending is not None
        declared_as = (body.bending.frequency_hz, body.bending.damping_ratio)
        frequency, ratio_of = (bending or {}).get(body.name, declared_as)
        turn = 2.0 * np.pi * frequency
        k[column, column] += frame.stiffness_mass * turn**2
        c[column, column] += frame.stiffness_mass * 2.0 * ratio_of * turn
    back = _without_fore_aft(mass, coordinate_names(vehicle))
    above = np.zeros_like(extension)
    above[:, :body_count] = matrices.attachment
    m, k, c = (back.T @ a @ back for a in (mass, k, c))
    return SmallMotion(matrices, m, c, k, extension @ back, wheel @ back, above @ back, used["tire_stiffness"], back)


def _undamped(k: np.ndarray, m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Squares of the undamped frequencies (n,), rising, and mode shapes (n, n)."""
    if np.allclose(k, k.T, rtol=0.0, atol=1e-10 * np.abs(k).max()):
        return tuple(eigh(k, m))
    # Springs over a rocker that differ make K a little unsymmetric; its eigenvalues stay real.
    square, shapes = eig(k, m)
    order = np.argsort(square.real)
    return square.real[order], shapes.real[:, order]


def _declared_share(vehicle: Vehicle) -> np.ndarray:
    share = np.zeros(len(vehicle.axles))
    for rocker in vehicle.equalisers:
        if rocker.load_share is None:
            raise SysidError(f"The load share of the equaliser '{rocker.name}' is not declared; give `load_share`.")
        share[list(rocker.axles)] = rocker.load_share
    return share


def _per_axle(name: str, values: np.ndarray, vehicle: Vehicle) -> np.ndarray:
    checked = np.array(values, float)
    if checked.shape != (len(vehicle.axles),):
        raise SysidError(
            f"{name} has the shape {checked.shape}, expected one value for each of {len(vehicle.axles)} axles."
        )
    if name in ("stiffness", "damping"):
        checked[np.not_equal(vehicle.suspension_axle, np.arange(len(vehicle.axles)))] = 0.0
    if not np.all(checked >= 0.0):
        worst = int(np.argmin(np.where(np.isfinite(checked), checked, -np.inf)))
        raise SysidError(f"{name} of axle {worst + 1} is {checked[worst]:g}, expected a number of zero or more.")
    return checked


def _rows(m: PlanarMatrices) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows of suspension extension and wheel rise (na, c), and the mass matrix (c, c) of all coordinates in use."""
    count, bodies = m.attachment.shape
    if m.beams is None:
        extension, wheel, mass, used = np.eye(count), np.eye(count), np.diag(m.unsprung_mass), np.ones(count, bool)
    else:
        extension, wheel, mass, used = np.diag(m.beams.carries), m.beams.wheel, m.beams.mass, m.beams.used
    return (
        np.concatenate([extension @ m.attachment, -extension[:, used]], axis=1),
        np.concatenate([np.zeros((count, bodies)), wheel[:, used]], axis=1),
        block_diag(m.mass, mass[np.ix_(used, used)]),
    )


def _without_fore_aft(mass: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """Matrix (c, r) from the other coordinates to all, travel following so that no chain has fore-aft momentum."""
    free = np.array([name.startswith("fore-aft ") for name in names])
    back = np.zeros((free.size, int((~free).sum())))
    back[~free] = np.eye(back.shape[1])
    back[free] = -np.linalg.solve(mass[np.ix_(free, free)], mass[np.ix_(free, ~free)])
    return back


def _damped(omega: np.ndarray, modal_damping: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Damping ratio and pole (n,) of every mode from the state-space matrix in modal coordinates (n, n)."""
    n = omega.size
    state = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(omega**2), -modal_damping]])
    poles, vectors = eig(state)
    share = np.abs(vectors[:n]) * omega[:, None]
    share = share / np.linalg.norm(share, axis=0)
    size = np.abs(poles)
    oscillating = np.flatnonzero(poles.imag > _ROUNDING * size)
    creeping = np.flatnonzero(np.abs(poles.imag) <= _ROUNDING * size)
    ratio, pole = np.ones(n), np.zeros(n, complex)
    modes, columns = linear_sum_assignment(-share[:, oscillating])
    ratio[modes] = -poles.real[oscillating[columns]] / size[oscillating[columns]]
    pole[modes] = poles[oscillating[columns]]
    # Modes that do not oscillate have two real poles each: the slow half and the fast half, paired by shape.
    rest = np.setdiff1d(np.arange(n), modes)
    creeping = creeping[np.argsort(size[creeping])]
    slow, fast = np.split(creeping, [rest.size])
    for chosen, is_slow in ((slow, True), (fast, False)):
        rows, columns = linear_sum_assignment(-share[np.ix_(rest, chosen)])
        if is_slow:
            pole[rest[rows]] = poles[chosen[columns]]
            continue
        first, second = pole[rest[rows]].real, poles.real[chosen[columns]]
        ratio[rest[rows]] = -0.5 * (first + second) / np.sqrt(first * second)
    return ratio, pole


def _result(
    vehicle: Vehicle,
    load_case: LoadCase,
    matrices: PlanarMatrices,
    omega: np.ndarray,
    ratio: np.ndarray,
    pole: np.ndarray,
    shapes: np.ndarray,
) -> NaturalModes:
    names = coordinate_names(vehicle)
    scale = _lengths(vehicle, names)
    size = np.abs(shapes) * scale[:, None]
    largest = np.argmax(size, axis=0)
    columns = np.arange(omega.size)
    shapes = shapes / (np.sign(shapes[largest, columns]) * size[largest, columns])
    bodies = matrices.mass.shape[0]
    body, unsprung = shapes[:bodies], shapes[bodies:]
    _, wheel, _ = _rows(matrices)
    motion = np.stack(
        [rows @ body for rows in (matrices.travel_rows, matrices.heave_rows, matrices.pitch_rows)], axis=1
    )
    stations = np.array([np.linspace(*frame_ends(vehicle, b), 25) for b in range(len(vehicle.bodies))])
    bent = np.zeros((*stations.shape, omega.size))
    for frame, column in zip(matrices.frames, matrices.frame_columns, strict=True):
        bent[frame.body] = np.outer([frame.rise(x) for x in stations[frame.body]], body[column])
    return NaturalModes(
        vehicle=vehicle,
        load_case=load_case,
        frequency_hz=omega / (2 * np.pi),
        damping_ratio=ratio,
        damped_frequency_hz=np.abs(pole.imag) / (2 * np.pi),
        pole=pole,
        coordinates=names,
        shape=shapes,
        scale_m=scale,
        body_motion=motion,
        wheel_rise=wheel[:, bodies:] @ unsprung,
        cg_x_m=matrices.cg_x,
        frame_x_m=stations,
        frame_rise=bent,
    )


def _lengths(vehicle: Vehicle, names: tuple[str, ...]) -> np.ndarray:
    """Length (c,) that makes a pitch comparable with a heave: half the distance between the outermost supports."""
    spans = {}
    for b, body in enumerate(vehicle.bodies):
        next_hitch_m = vehicle.bodies[b + 1].hitch_x_m if b + 1 < len(vehicle.bodies) else None
        supports = [a.x_m for a in vehicle.axles if a.body == b]
        supports += [x for x in (body.hitch_x_m, next_hitch_m) if x is not None]
        spans[f"pitch {body.name}"] = 0.5 * (max(supports) - min(supports))
    for group in vehicle.groups:
        spans[f"pitch {group.name}"] = 0.5 * (vehicle.axles[group.axles[-1]].x_m - vehicle.axles[group.axles[0]].x_m)
    return np.array([spans.get(name, 1.0) or 1.0 for name in names])
