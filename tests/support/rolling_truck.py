"""A truck on two axles in three dimensions, written wheel by wheel and integrated by SciPy: no code of the product."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

#: Height of the road under a wheel and its rate, at a time: axle, side (+1 left) -> (h, h').
Road = Callable[[int, float, float], tuple[float, float]]


@dataclass(frozen=True)
class RollingTruck:
    """Body with heave, pitch and roll on two axles with heave and roll; k and c of both sides together.

    `left` (2, 3): how much of the springs, dampers and tires of each axle is on the left beyond on the right.
    """

    mass: float = 8000.0
    pitch_inertia: float = 29000.0
    roll_inertia: float = 5600.0
    axle_x: tuple[float, float] = (-2.1, 2.6)
    axle_mass: tuple[float, float] = (560.0, 1080.0)
    axle_inertia: tuple[float, float] = (330.0, 600.0)
    k: tuple[float, float] = (4.3e5, 7.6e5)
    c: tuple[float, float] = (1.1e4, 1.3e4)
    kt: tuple[float, float] = (1.65e6, 2.9e6)
    ct: tuple[float, float] = (3e3, 3.4e3)
    spring_y: tuple[float, float] = (0.41, 0.485)
    damper_y: tuple[float, float] = (0.45, 0.45)
    tire_y: tuple[float, float] = (1.015, 0.915)
    auxiliary: tuple[float, float] = (6e4, 2e5)
    left: tuple[tuple[float, float, float], tuple[float, float, float]] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

    def accelerations(self, time: float, q: np.ndarray, v: np.ndarray, road: Road) -> np.ndarray:
        """Of body heave, pitch, roll, then heave and roll of the axles; every spring, damper and tire on its own."""
        force, pitch_moment, roll_moment = 0.0, 0.0, 0.0
        axles = np.zeros(4)
        for i in range(2):
            at, heave, roll = self.axle_x[i], 3 + 2 * i, 4 + 2 * i
            up, turn = 0.0, 0.0
            for side in (1.0, -1.0):
                share = [0.5 * (1.0 + side * e) for e in self.left[i]]
                for y, stiffness, damping in (
                    (side * self.spring_y[i], share[0] * self.k[i], 0.0),
                    (side * self.damper_y[i], 0.0, share[1] * self.c[i]),
                ):
                    gap = q[0] - at * q[1] + y * q[2] - q[heave] - y * q[roll]
                    rate = v[0] - at * v[1] + y * v[2] - v[heave] - y * v[roll]
                    pull = stiffness * gap + damping * rate
                    force -= pull
                    pitch_moment += at * pull
                    roll_moment -= y * pull
                    up += pull
                    turn += y * pull
                y = side * self.tire_y[i]
                height, slope = road(i, side, time)
                push = share[2] * (
                    self.kt[i] * (height - q[heave] - y * q[roll]) + self.ct[i] * (slope - v[heave] - y * v[roll])
                )
                up += push
                turn += y * push
            twist = self.auxiliary[i] * (q[2] - q[roll])
            roll_moment -= twist
            turn += twist
            axles[2 * i], axles[2 * i + 1] = up / self.axle_mass[i], turn / self.axle_inertia[i]
        body = [force / self.mass, pitch_moment / self.pitch_inertia, roll_moment / self.roll_inertia]
        return np.concatenate([body, axles])

    def drive(self, road: Road, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates and accelerations (T, 7) at times [s], from rest."""

        def rates(time: float, state: np.ndarray) -> np.ndarray:
            return np.concatenate([state[7:], self.accelerations(time, state[:7], state[7:], road)])

        span = (float(times[0]), float(times[-1]))
        found = solve_ivp(rates, span, np.zeros(14), "DOP853", t_eval=times, rtol=1e-10, atol=1e-13, max_step=0.005).y.T
        return found[:, :7], np.array([rates(t, s)[7:] for t, s in zip(times, found, strict=True)])


def skew_bump(speed: float, skew: float, tire_y: tuple[float, float], axle_x: tuple[float, float]) -> Road:
    """A raised-cosine bump, 30 mm high and 1.2 m long, that axle 1 meets at 0.5 s, and its left wheels first."""

    def road(axle: int, side: float, time: float) -> tuple[float, float]:
        along = speed * (time - 0.5) - (axle_x[axle] - axle_x[0]) + side * tire_y[axle] * np.tan(skew)
        if not 0.0 < along < 1.2:
            return 0.0, 0.0
        turn = 2.0 * np.pi * along / 1.2
        return 0.015 * (1.0 - np.cos(turn)), 0.015 * np.sin(turn) * 2.0 * np.pi / 1.2 * speed

    return road
