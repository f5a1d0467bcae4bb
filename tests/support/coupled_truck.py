"""A six-axle truck and a simply supported beam in one set of equations, solved by DOP853, apart from the package."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from independent_truck import LOWBOY, Equations
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline

TRUCK = replace(LOWBOY, bending=(), load_cases={"laden": LOWBOY.load_cases["laden"]})
EXPONENT = 1.25


@dataclass(frozen=True)
class Beam:
    """A simply supported beam: length [m], EI [N m2], mass [kg/m], damping ratio of all modes, number of modes."""

    length_m: float
    stiffness_N_m2: float
    mass_kg_m: float
    damping_ratio: float
    modes: int

    @property
    def omega(self) -> np.ndarray:
        """Angular frequencies [rad/s]."""
        n = np.arange(1, self.modes + 1)
        return (n * np.pi / self.length_m) ** 2 * np.sqrt(self.stiffness_N_m2 / self.mass_kg_m)

    def shapes(self, s: np.ndarray, order: int = 0) -> np.ndarray:
        """sin(n pi s / L) or its slope, (..., modes), zero off the beam."""
        wave = np.arange(1, self.modes + 1) * np.pi / self.length_m
        on = ((s > 0) & (s < self.length_m))[..., None]
        inside = np.multiply.outer(s, wave)
        return np.where(on, wave * np.cos(inside) if order else np.sin(inside), 0.0)


def crossing(
    beam: Beam,
    station_m: np.ndarray,
    height_m: np.ndarray,
    speed_m_s: float,
    start_m: float,
    time_s: np.ndarray,
    *,
    feels_deck: bool = True,
) -> dict[str, np.ndarray]:
    """Tire forces (T, 6) [N]; deflection [m], moment [N m] and shear [N] at mid-span; times from axle 1 at support 1.

    Heights (n,) at stations; the truck is at rest with axle 1 at `start_m` before.
    """  # fmt: skip
    e = Equations(TRUCK, "laden")
    x, tire, damper = (np.array(v) for v in (TRUCK.x_m, TRUCK.tire_N_per_m, TRUCK.tire_N_s_per_m))
    rest = EXPONENT * e.static / tire
    spring, damping = np.array(TRUCK.stiffness), np.array(TRUCK.damping)
    road = make_interp_spline(station_m, height_m, 5)
    slope = road.derivative()
    count, n = e.push.shape[0], beam.modes
    modal = 0.5 * beam.mass_kg_m * beam.length_m

    def forces(t: float, y: np.ndarray) -> tuple[np.ndarray, ...]:
        q, v, a, b = np.split(y, [count, 2 * count, 2 * count + n])
        s = speed_m_s * t - x + e.forward @ q
        rate = speed_m_s + e.forward @ v
        at = np.clip(s, station_m[0], station_m[-1])
        inside = (s > station_m[0]) & (s < station_m[-1])
        phi, phi_slope = beam.shapes(s), beam.shapes(s, 1)
        deck = phi @ a * feels_deck
        deck_rate = (phi @ b + rate * (phi_slope @ a)) * feels_deck
        h, dh = np.where(inside, road(at), 0.0), np.where(inside, slope(at), 0.0)
        u = h - deck - e.wheel @ q
        u_rate = dh * rate - deck_rate - e.wheel @ v
        r = np.maximum((rest + u) / rest, 0.0)
        force = e.static * r**EXPONENT + damper * r * np.sqrt(1.1 / (r + 0.1)) * u_rate
        vertical = np.maximum(force, 0.0)
        return q, v, a, b, phi, vertical, -dh * vertical

    def derivative(t: float, y: np.ndarray) -> np.ndarray:
        q, v, a, b, phi, vertical, along = forces(t, y)
        pull = spring * (e.extension @ q) + damping * (e.extension @ v)
        motion = -e.stiffness @ q - e.damping @ v - e.push @ pull + e.lift @ (vertical - e.static) + e.drive @ along
        push = phi.T @ vertical / modal
        return np.concatenate([v, motion, b, push - 2 * beam.damping_ratio * beam.omega * b - beam.omega**2 * a])

    found = solve_ivp(
        derivative, (start_m / speed_m_s, time_s[-1]), np.zeros(2 * count + 2 * n), "DOP853",
        time_s, rtol=1e-6, atol=1e-9, max_step=0.01,
    )  # fmt: skip
    tires, moment, shear, deflection = [], [], [], []
    wave = np.arange(1, n + 1) * np.pi / beam.length_m
    middle = np.sin(0.5 * wave * beam.length_m)
    for t, y in zip(time_s, found.y.T, strict=True):
        _, _, a, _, phi, vertical, _ = forces(t, y)
        tires.append(vertical)
        # Forces along the influence line, and the inertia and damping of the modes.
        s = np.clip(speed_m_s * t - x, 0.0, beam.length_m)
        static = (np.minimum(s, beam.length_m - s) / 2) @ vertical
        beyond = a - phi.T @ vertical / (modal * beam.omega**2)
        moment.append(static + (beam.stiffness_N_m2 * wave**2 * middle) @ beyond)
        line = np.where(s > 0.5 * beam.length_m, 1.0, 0.0) - s / beam.length_m
        shear.append(line @ vertical + (beam.stiffness_N_m2 * wave**3 * np.cos(0.5 * wave * beam.length_m)) @ beyond)
        deflection.append(middle @ a)
    effects = {"moment": moment, "shear": shear, "deflection": deflection}
    return {"tire": np.array(tires)} | {name: np.array(values) for name, values in effects.items()}
