"""Equations of motion of one rigid body on three axles, written out by hand and solved by DOP853."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from rigid_truck import AXLES, DAMPING, EMPTY, EXPONENT, STIFFNESS
from scipy.integrate import solve_ivp

from sysid.campaign.vehicle_records import LoadCase
from sysid.vehicle_model.stacked_matrices import SPEED_HOLD_S

SPEED_M_S = 8.0  # with steps of 1.25 ms every wheel passes exactly over the 10 mm stations
START_S = 0.25
DURATION_S = 1.5
#: A bump that every axle leaves, and one that none leaves.
HEIGHTS_M = (0.07, 0.006)
WIDTH_M = 0.22
POINTS_M = (0.3, 5.0)
#: Size of the footprint map's departure from a flat road.
ALPHA = 0.15
OUTPUT_S = 0.005
FINE_S = 0.000125
#: Histories that are compared.
CHANNELS = ("deflection", "axle_acceleration", "body_acceleration", "tire_force", "suspension_force")

X = np.array([a.x_m for a in AXLES])
UNSPRUNG = np.array([a.unsprung_mass_kg for a in AXLES])
TIRE_STIFFNESS = np.array([a.tire_stiffness_N_per_m for a in AXLES])
TIRE_DAMPING = np.array([a.tire_damping_N_s_per_m for a in AXLES])


def road(s: np.ndarray, order: int = 0) -> np.ndarray:
    """Gaussian bump of unit height and its slope."""
    t = (s - 0.6) / WIDTH_M
    return np.exp(-(t**2)) * (-2 * t / WIDTH_M if order else 1.0)


def linear(extension: np.ndarray, rate: np.ndarray, slip: np.ndarray) -> np.ndarray:
    """Force of linear springs and dampers [N]."""
    return STIFFNESS * extension + DAMPING * rate


@dataclass(frozen=True)
class Bend:
    """A frame that bends: its rise at the axles and at the points of the accelerometers per amplitude, modal mass [kg],
    angular frequency [rad/s] and damping ratio.
    """

    at_axles: np.ndarray
    at_points: np.ndarray
    modal_mass: float
    turn: float
    ratio: float


@dataclass(frozen=True)
class Truck:
    """Quantities of the hand-written equations: statics, tire law, and the coupled mass of travel and pitch.

    `law` gives the suspension force from extension, rate of the damper and the state of Dahl friction elements with the
    slip length `slip_m`, which goes towards `envelope` of extension and rate; the damper stands in bushings of the
    stiffness `bushing_N_per_m`, or rigidly (None), and `damper_rate` is its rate from its force; `load` is how the
    truck is loaded, its tires as stiff as ever at rest; `bend` its frame; the speed that is held changes by
    `acceleration_m_s2`. Links lead wheels aft by `trailing` times their jounce, None for straight up.
    """

    height_m: float
    law: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray] = linear
    slip_m: float = 1e-3
    envelope: Callable[[np.ndarray, np.ndarray], np.ndarray | float] = lambda extension, rate: 1.0
    load: LoadCase = EMPTY
    bend: Bend | None = None
    acceleration_m_s2: float = 0.0
    bushing_N_per_m: np.ndarray | None = None
    damper_rate: Callable[[np.ndarray], np.ndarray] = lambda force: force / DAMPING
    trailing: np.ndarray | None = None

    def __post_init__(self) -> None:
        static = np.array(self.load.axle_loads_kg) * 9.81
        preload = static - UNSPRUNG * 9.81
        cg_x = float(preload @ X / preload.sum())
        below = np.array([a.tire_radius_m for a in AXLES]) - self.load.cg_height_m[0]
        coupling = float(-(UNSPRUNG * below).sum())
        inertia = self.load.pitch_inertia_kg_m2[0] + float((UNSPRUNG * below**2).sum())
        total = self.load.sprung_mass_kg[0] + UNSPRUNG.sum()
        self.__dict__.update(
            cg_x=cg_x,
            below=below,
            tilt=float((preload * below).sum()),
            mass=np.array([[total, coupling], [coupling, inertia]]),
            total=total,
            static=static,
            rest=EXPONENT * static / TIRE_STIFFNESS,
        )

    def signals(self, t: float, y: np.ndarray) -> dict[str, np.ndarray]:
        """Signals in state y = (xi, z, theta, z_1..3, their rates, phi_1..3, amplitude of bending and its rate,
        yield of the bushings of dampers 1..3).
        """
        (xi, z, theta), axle = y[:3], y[3:6]
        (xi_rate, z_rate, theta_rate), axle_rate, slip = y[6:9], y[9:12], y[12:15]
        arm = X - self.cg_x
        extension = z - theta * arm - axle
        rate = z_rate - theta_rate * arm - axle_rate
        if self.bend is not None:
            extension, rate = extension + self.bend.at_axles * y[15], rate + self.bend.at_axles * y[16]
        damper_rate = rate if self.bushing_N_per_m is None else self.damper_rate(self.bushing_N_per_m * y[17:20])
        pull = self.law(extension, damper_rate, slip)
        tau, a = t - START_S, self.acceleration_m_s2
        s = SPEED_M_S * tau + a * tau**2 / 2.0 - X + xi - theta * self.below
        slope = self.height_m * road(s, 1)
        speed = SPEED_M_S + a * tau + xi_rate - theta_rate * self.below
        if self.trailing is not None:
            s, speed = s + self.trailing * extension, speed + self.trailing * rate
            slope = self.height_m * road(s, 1)
        v, v_rate = self.height_m * road(s) - axle, slope * speed - axle_rate
        a, a_slope = ALPHA * road(s), ALPHA * road(s, 1)
        # Clear of the road, above first contact at v = -rest, the map stays what it was there.
        w = np.maximum(v, -self.rest)
        w_rate = np.where(v > -self.rest, v_rate, 0.0)
        e = self.rest + v + a * w + 2.0 * a * w**2 - 5.0 * a * w**3
        e_rate = v_rate + w_rate * (a + 4.0 * a * w - 15.0 * a * w**2) + speed * a_slope * (w + 2.0 * w**2 - 5.0 * w**3)
        x = e / self.rest
        grip = np.maximum(x, 0.0) * np.sqrt(1.1 / (np.maximum(x, 0.0) + 0.1))  # no damping off the ground
        force = self.static * np.sign(x) * np.abs(x) ** EXPONENT + TIRE_DAMPING * grip * e_rate
        vertical = np.maximum(force, 0.0)
        push = vertical * (-slope + 3.0 * slope * w)
        right = [
            push.sum() - self.total / SPEED_HOLD_S * xi_rate,
            (pull * arm).sum() - (push * self.below).sum() - self.tilt * theta,
        ]
        xi_acceleration, theta_acceleration = np.linalg.solve(self.mass, right)
        z_acceleration = -pull.sum() / self.load.sprung_mass_kg[0]
        axle_acceleration = (vertical - self.static + pull) / UNSPRUNG
        if self.trailing is not None:
            found = self.with_links(pull, push, vertical, right)
            (xi_acceleration, z_acceleration, theta_acceleration), axle_acceleration = found[:3], found[3:]
        points = z_acceleration - theta_acceleration * (np.array(POINTS_M) - self.cg_x)
        bend, bending = self.bend, 0.0
        if bend is not None:
            spring = bend.turn**2 * y[15] + 2.0 * bend.ratio * bend.turn * y[16]
            bending = -spring - float(bend.at_axles @ pull) / bend.modal_mass
            points = points + bend.at_points * bending
        return {
            "bending": np.array([y[16], bending]),
            "body": np.array([xi_acceleration, z_acceleration, theta_acceleration]),
            "axle_acceleration": axle_acceleration,
            "body_acceleration": points,
            "pitch_rate": np.array([theta_rate]),
            "tire_force": vertical,
            "horizontal_force": push,
            "deflection": extension,
            "suspension_force": -pull,
            "slip_rate": (self.envelope(extension, rate) * rate - np.abs(rate) * slip) / self.slip_m,
            "yielding": rate - damper_rate,
        }

    def with_links(self, pull: np.ndarray, push: np.ndarray, vertical: np.ndarray, right: list[float]) -> np.ndarray:
        """Accelerations (6,) of xi, z, theta and the axles; Lagrange's equations with wheels that links lead.

        Without links, wheel i is at xi - theta below_i; now b_i e_i further ahead, e_i = z - theta arm_i - z_i.
        `right` are the forces on xi and theta without links.
        """
        lengthened = np.column_stack([np.zeros(3), np.ones(3), -(X - self.cg_x), -np.eye(3)])
        straight = np.column_stack([np.ones(3), np.zeros(3), -self.below, np.zeros((3, 3))])
        ahead = straight + self.trailing[:, None] * lengthened
        mass = np.zeros((6, 6))
        mass[np.ix_([0, 2], [0, 2])] = self.mass
        mass[[1, 3, 4, 5], [1, 3, 4, 5]] = [self.load.sprung_mass_kg[0], *UNSPRUNG]
        mass += ahead.T @ (UNSPRUNG[:, None] * ahead) - straight.T @ (UNSPRUNG[:, None] * straight)
        force = np.array([right[0], -pull.sum(), right[1], *(vertical - self.static + pull)])
        return np.linalg.solve(mass, force + (ahead - straight).T @ push)

    def rates(self, t: float, y: np.ndarray) -> np.ndarray:
        found = self.signals(t, y)
        rates = [y[6:12], found["body"], found["axle_acceleration"], found["slip_rate"], found["bending"]]
        rates.append(found["yielding"])
        return np.concatenate(rates)

    def histories(self, times: np.ndarray) -> dict[str, np.ndarray]:
        """Signals (n, channels) at `times` [s], from rest."""
        solution = solve_ivp(
            self.rates,
            (0.0, times[-1]),
            np.zeros(20),
            method="DOP853",
            t_eval=times,
            rtol=1e-11,
            atol=1e-13,
            max_step=0.005,
        )
        rows = [self.signals(t, y) for t, y in zip(times, solution.y.T, strict=True)]
        return {q: np.array([r[q] for r in rows]) for q in rows[0]}


def relative_rms(ours: np.ndarray, exact: np.ndarray) -> np.ndarray:
    """Per channel RMS(ours - exact) / RMS(exact - its static value)."""
    return np.sqrt(np.mean((ours - exact) ** 2, axis=0) / np.mean((exact - exact[0]) ** 2, axis=0))


def worst_error(ours: object, oracle: Sequence[Mapping[str, np.ndarray]]) -> float:
    """Largest relative RMS of any channel; `ours` has the axis R for the passes of `oracle`, which is `FINE_S` fine."""
    every = round(OUTPUT_S / FINE_S)
    return max(
        float(relative_rms(np.asarray(getattr(ours, q))[:, number, :, 0], one[q][::every]).max())
        for q in CHANNELS
        for number, one in enumerate(oracle)
    )
