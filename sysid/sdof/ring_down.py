"""Motion of one mass on a spring with viscous, dry and quadratic damping, from swing to swing until it sticks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_STEPS = 22  # of a swing: errors below 1e-5 of the amplitude
_REACH = 1.3  # half periods that are integrated of each swing; its turning point lies before that


@dataclass(frozen=True)
class RingDown:
    """A computed ring-down, one row per parameter set.

    `value` (p, n) [m] at the times asked for; `turn_s`, `turn_m` (p, swings) time and place of the turning points, NaN
    after the last; `stick_s` (p,) when the mass sticks, infinite where it does not within the record.
    """

    value: np.ndarray
    turn_s: np.ndarray
    turn_m: np.ndarray
    stick_s: np.ndarray


def ring_down(parameters: np.ndarray, time_s: np.ndarray, direction: float) -> RingDown:
    """Motion after a moment of known position and velocity, for several parameter sets at once.

    x'' + 2 beta x' + q |x'| x' + f omega^2 sign(x') + omega^2 y (1 + e y^2) = 0 with y = x - x0; the mass sticks at the
    turning point where |y| (1 + e y^2) <= f.  Every swing is integrated apart (classical Runge-Kutta, turning points by
    a cubic between the steps), because the friction's sign holds for one swing.

    Parameters
    ----------
    parameters
        (p, 8): omega [rad/s], x0 [m], position [m] and velocity [m/s] at the first time, beta [1/s], f = F/k [m],
        q [1/m], e [1/m^2].
    time_s
        (n,) increasing times [s]; position and velocity are those at the first.
    direction
        Sign of the velocity at the first time, the same in all sets.
    """
    omega, centre, position, x_rate, beta, friction, quadratic, cubic = np.asarray(parameters, float).T
    end = float(time_s[-1] - time_s[0])
    half = np.pi / np.sqrt(np.maximum(omega**2 - beta**2, 0.04 * omega**2))
    step = half * (_REACH / _STEPS)
    x, v, sign = position - centre, x_rate, float(np.sign(direction))
    begin, stick = np.zeros(omega.size), np.full(omega.size, np.inf)
    begins, positions, rates, places = [], [], [], []
    # Swings are shorter than the half period where the spring stiffens: twice as many leave room.
    for _ in range(int(2.0 * end / float(half.min())) + 3):
        at, rate = _swing(x, v, step, (omega**2, 2.0 * beta, friction, quadratic, cubic), sign)
        stuck = np.isfinite(stick)
        at, rate = np.where(stuck, x, at), np.where(stuck, 0.0, rate)
        begins.append(np.where(stuck & (begin > stick), np.inf, begin))
        positions.append(at)
        rates.append(rate)
        places.append(x + centre)
        length, x = _turning_point(at, rate, step, sign)
        begin, v, sign = np.where(stuck, np.inf, begin + length), np.zeros(omega.size), -sign
        stops = ~stuck & (np.abs(x) * (1.0 + cubic * x**2) <= friction)
        stick = np.where(stops, begin, stick)
        if np.all(np.where(np.isfinite(stick) & ~stops, np.inf, begin) > end):
            break
    starts = np.stack(begins)
    value = _at_times(starts, np.stack(positions), np.stack(rates), step, time_s - time_s[0])
    inside = (starts[1:] <= end).T
    return RingDown(
        value + centre[:, None],
        np.where(inside, starts[1:].T + time_s[0], np.nan),
        np.where(inside, np.stack(places)[1:].T, np.nan),
        np.where(stick <= end, stick + time_s[0], np.inf),
    )


def _swing(
    x: np.ndarray, v: np.ndarray, step: np.ndarray, law: Sequence[np.ndarray], sign: float
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (steps + 1, p) of one swing; the law of its direction goes on beyond its end."""
    square, twice_beta, friction, quadratic, cubic = law
    shift, drag = sign * friction * square, sign * quadratic

    def acceleration(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.asarray(-(twice_beta + drag * v) * v - square * x * (1.0 + cubic * x * x) - shift)

    positions, rates = [x], [v]
    for _ in range(_STEPS):
        a1 = acceleration(x, v)
        v2 = v + 0.5 * step * a1
        a2 = acceleration(x + 0.5 * step * v, v2)
        v3 = v + 0.5 * step * a2
        a3 = acceleration(x + 0.5 * step * v2, v3)
        v4 = v + step * a3
        a4 = acceleration(x + step * v3, v4)
        x, v = x + step / 6.0 * (v + 2.0 * (v2 + v3) + v4), v + step / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
        positions.append(x)
        rates.append(v)
    return np.stack(positions), np.stack(rates)


def _turning_point(at: np.ndarray, rate: np.ndarray, step: np.ndarray, sign: float) -> tuple[np.ndarray, np.ndarray]:
    """Time from the start of a swing to its turning point, (p,), and the place of it; its end where there is none."""
    passed = sign * rate[1:] < 0.0
    k = np.where(passed.any(axis=0), np.argmax(passed, axis=0), _STEPS - 1)
    column = np.arange(at.shape[1])
    x0, x1 = at[k, column], at[k + 1, column]
    v0, v1 = rate[k, column] * step, rate[k + 1, column] * step
    # The cubic through places and velocities of both ends: its slope v0 + 2 b u + 3 c u^2 vanishes at u.
    c = 2.0 * (x0 - x1) + v0 + v1
    b = 3.0 * (x1 - x0) - 2.0 * v0 - v1
    u = np.clip(np.where(v0 != v1, v0 / np.where(v0 == v1, 1.0, v0 - v1), 0.0), 0.0, 1.0)
    for _ in range(3):
        bend = 2.0 * b + 6.0 * c * u
        u = np.clip(u - (v0 + (2.0 * b + 3.0 * c * u) * u) / np.where(bend == 0.0, 1.0, bend), 0.0, 1.0)
    return (k + u) * step, x0 + (v0 + (b + c * u) * u) * u


def _at_times(
    begins: np.ndarray, positions: np.ndarray, rates: np.ndarray, step: np.ndarray, time: np.ndarray
) -> np.ndarray:
    """Places (p, n) at times from the start, by the cubic through places and velocities of the steps."""
    result = np.empty((step.size, time.size))
    for p in range(step.size):
        swing = np.clip(np.searchsorted(begins[:, p], time, "right") - 1, 0, None)
        u = (time - begins[swing, p]) / step[p]
        k = np.minimum(u.astype(int), _STEPS - 1)
        u = np.minimum(u - k, 1.0)
        x0, x1 = positions[swing, k, p], positions[swing, k + 1, p]
        v0, v1 = rates[swing, k, p] * step[p], rates[swing, k + 1, p] * step[p]
        c, b = 2.0 * (x0 - x1) + v0 + v1, 3.0 * (x1 - x0) - 2.0 * v0 - v1
        result[p] = x0 + (v0 + (b + c * u) * u) * u
    return result
