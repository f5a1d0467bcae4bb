"""Decay records from closed forms and from SciPy's integrators, independent of the code under test."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import lsim


def damped_cosine(time_s, period_s, decrement, amplitude=0.04, release_s=0.5, offset=0.0):
    """Single mass released from rest at `amplitude`: constant before the release, exact free decay after it."""
    omega, sigma = 2 * np.pi / period_s, decrement / period_s
    u = np.maximum(time_s - release_s, 0.0)
    return offset + amplitude * np.exp(-sigma * u) * (np.cos(omega * u) + sigma / omega * np.sin(omega * u))


def quarter_car_drop(k, c, m, m_u, kt, ct, *, rate_hz=200.0, duration_s=4.5, release_s=0.8, height_m=0.075, roll_s=0.0):
    """Suspension deflection of a linear quarter car rolling off a plank: the road falls by `height_m` within `roll_s`.

    State-space simulation with scipy.signal.lsim on a grid of a tenth of a millisecond; static level = 0.
    """
    oversampling = round(1e4 / rate_hz)
    time = np.arange(int(duration_s * 1e4) + 1) / 1e4
    road = height_m * np.clip((release_s + roll_s - time) / max(roll_s, 1e-4), 0.0, 1.0)
    road_speed = np.gradient(road, time)
    a = np.array(
        [
            [0, 1, 0, 0],
            [-k / m, -c / m, k / m, c / m],
            [0, 0, 0, 1],
            [k / m_u, c / m_u, -(k + kt) / m_u, -(c + ct) / m_u],
        ]
    )
    b = np.array([[0, 0], [0, 0], [0, 0], [kt / m_u, ct / m_u]])
    out = np.array([[1.0, 0.0, -1.0, 0.0]])
    start = [road[0], 0.0, road[0], 0.0]
    _, y, _ = lsim((a, b, out, np.zeros((1, 2))), np.stack([road, road_speed], axis=1), time, X0=start)
    return time[::oversampling], np.asarray(y)[::oversampling]


def nonlinear_decay(time_s, omega, start, *, linear=0.0, quadratic=0.0, friction=0.0, release_s=0.5):
    """Single mass with x'' + b1 x' + b2 |x'|x' + omega^2 x + friction omega^2 sign(x') = 0 released at `start`.

    Integrated from turning point to turning point (DOP853), so the sign of friction never switches inside a step;
    `friction` is the dead band F/k.
    """
    result = np.full(time_s.shape, start, float)
    x, begin, direction = start, release_s, -np.sign(start)

    def turning(t, s):
        return s[1] - 0.0 * t

    turning.terminal = True
    while begin < time_s[-1]:
        if abs(x) <= friction:
            result[time_s >= begin] = x
            break
        d = direction

        def rhs(t, s, d=d):
            return [s[1], -linear * s[1] - quadratic * abs(s[1]) * s[1] - omega**2 * (s[0] + friction * d)]

        turning.direction = -d
        small = 1e-9 / omega
        first = [x - 0.5 * omega**2 * (x + friction * d) * small**2, -(omega**2) * (x + friction * d) * small]
        end = time_s[-1] + 1.0
        run = solve_ivp(
            rhs, (begin + small, end), first, "DOP853", events=turning, rtol=1e-11, atol=1e-14, dense_output=True
        )
        stop = float(run.t[-1])
        inside = (time_s > begin) & (time_s <= stop)
        if inside.any():
            result[inside] = run.sol(time_s[inside])[0]
        x, begin, direction = float(run.y[0, -1]), stop, -direction
    return result


def quarter_car_with_quadratic_damping(time_s, k, quadratic, on_tire, start=0.05, release_s=0.5):
    """Suspension deflection of a quarter car, F = k s + Q |s'| s' over the tire's spring, released `start` m from rest.

    `on_tire` has the masses and the tire.
    """
    m, m_u, kt, ct = on_tire.mass, on_tire.unsprung_mass, on_tire.tire_stiffness, on_tire.tire_damping

    def rhs(_, y):
        body, body_rate, axle, axle_rate = y
        s, rate = body - axle, body_rate - axle_rate
        force = k * s + quadratic * abs(rate) * rate
        return [body_rate, -force / m, axle_rate, (force - kt * axle - ct * axle_rate) / m_u]

    axle = start * k / kt
    after = time_s[time_s >= release_s] - release_s
    end = max(float(after[-1]), 0.1)
    run = solve_ivp(rhs, (0.0, end), [start + axle, 0.0, axle, 0.0], "DOP853", t_eval=after, rtol=1e-10, atol=1e-13)
    result = np.full(time_s.shape, float(start))
    result[time_s >= release_s] = run.y[0] - run.y[2]
    return result
