"""Ring-downs of known damping, integrated apart from the toolkit, with readings as a logger gives them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

TERMS = ("viscous", "friction", "quadratic")
KINDS = (
    ("viscous",),
    ("friction",),
    ("quadratic",),
    ("viscous", "friction"),
    ("viscous", "quadratic"),
    ("friction", "quadratic"),
    ("viscous", "friction", "quadratic"),
)
INTERVAL_S, SECONDS, NOISE_M = 0.005, 6.0, 2.5e-4
PLANK_M = 0.075
#: Swings that count stand above this many standard deviations of the noise, and terms above this share of the decay.
CLEAR, SHARE = 8.0, 0.10


@dataclass(frozen=True)
class Oscillator:
    """m x'' + c x' + F sign(x') + Q |x'| x' + k x = 0, all in SI units."""

    mass: float
    stiffness: float
    damping: float = 0.0
    friction: float = 0.0
    quadratic: float = 0.0

    @property
    def damped_period(self) -> float:
        """Period of the linear part [s]."""
        return 2.0 * np.pi / np.sqrt(self.stiffness / self.mass - (0.5 * self.damping / self.mass) ** 2)


def ring(oscillator: Oscillator, released_m: float, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places (n,) at times from the release from rest, and all turning points (the release first).

    DOP853 from turning point to turning point, so that the friction never changes its sign inside a step; the mass
    sticks at a turning point where the spring force is within the friction.
    """
    o = oscillator
    place, begin, turns = float(released_m), 0.0, [float(released_m)]
    result = np.full(time_s.size, place)
    while begin < time_s[-1] and o.stiffness * abs(place) > o.friction:
        way = -np.sign(place)
        pull = -(o.stiffness * place + way * o.friction) / o.mass
        # A first step off the turning point, where the event would be found at once.
        short = 1e-7 * np.sqrt(o.mass / o.stiffness)

        def motion(t, s, way=way):
            drag = o.damping * s[1] + o.quadratic * abs(s[1]) * s[1]
            return [s[1], -(o.stiffness * s[0] + way * o.friction + drag) / o.mass]

        def turning(t, s):
            return s[1]

        # Attributes by which solve_ivp knows what to do at an event.
        vars(turning).update(terminal=True, direction=-way)
        span = (begin + short, begin + 10.0 * np.sqrt(o.mass / o.stiffness))
        run = solve_ivp(
            motion,
            span,
            [place + 0.5 * pull * short**2, pull * short],
            "DOP853",
            events=turning,
            rtol=1e-10,
            atol=1e-13,
            dense_output=True,
        )
        end = float(run.t_events[0][0])
        inside = (time_s > begin) & (time_s <= end)
        if inside.any():
            result[inside] = run.sol(time_s[inside])[0]
        place, begin = float(run.y_events[0][0][0]), end
        turns.append(place)
        result[time_s > begin] = place
    return result, np.array(turns)


@dataclass(frozen=True)
class Record:
    """A logged ring-down: times [s], readings [m], the oscillator, its kind, and whether its kind can be seen.

    `clear` counts the half cycles whose half range is above 8 standard deviations of the noise; `shares` are the work
    of every term over them in the work of all.
    """

    time_s: np.ndarray
    value_m: np.ndarray
    oscillator: Oscillator
    kind: tuple[str, ...]
    clear: int
    shares: dict[str, float]

    @property
    def visible(self) -> bool:
        """At least 1 + 2 clear half cycles per term, and no term below a tenth of the decay."""
        return self.clear >= 1 + 2 * len(self.kind) and min(self.shares.values()) > SHARE


def draw(seed: int, number: int) -> Record:
    """Ring-down of one replicate; the kinds take turns.

    A body on one axle after a 75 mm plank less 9 to 24 mm of tire deflection, or after a lift down to 0.4 of that;
    1.3 to 3.3 Hz; 10 to 45 % of the amplitude lost in the first half cycle, in random parts by the terms of its kind.
    """
    random = np.random.default_rng([seed, number])
    kind = KINDS[number % len(KINDS)]
    mass, period = random.uniform(2500.0, 5000.0), random.uniform(0.3, 0.75)
    omega = 2.0 * np.pi / period
    released = (PLANK_M - random.uniform(0.009, 0.024)) * random.uniform(0.4, 1.0)
    loss = random.uniform(0.10, 0.45)
    part = dict(zip(kind, random.dirichlet(np.full(len(kind), 2.0)), strict=True))
    oscillator = Oscillator(
        mass,
        mass * omega**2,
        part.get("viscous", 0.0) * loss * 2.0 * mass * omega / np.pi,
        part.get("friction", 0.0) * loss * released * mass * omega**2 / 2.0,
        part.get("quadratic", 0.0) * loss * 0.75 * mass / released,
    )
    time = np.arange(round(SECONDS / INTERVAL_S)) * INTERVAL_S
    begin = 0.6 + random.uniform(0.0, 0.4)
    moved, turns = ring(oscillator, released * random.choice([-1.0, 1.0]), np.maximum(time - begin, 0.0))
    value = moved + random.uniform(-0.03, 0.03) + NOISE_M * random.standard_normal(time.size)
    half_range = 0.5 * np.abs(np.diff(turns))
    clear = half_range > CLEAR * NOISE_M
    return Record(time, value, oscillator, kind, int(clear.sum()), _shares(oscillator, half_range[clear], kind))


def _shares(o: Oscillator, amplitude: np.ndarray, kind: tuple[str, ...]) -> dict[str, float]:
    """Work of every term over half cycles of these amplitudes, as of a harmonic motion, in the work of all."""
    omega = np.sqrt(o.stiffness / o.mass)
    work = {
        "viscous": float(np.sum(0.5 * np.pi * o.damping * omega * amplitude**2)),
        "friction": float(np.sum(2.0 * o.friction * amplitude)),
        "quadratic": float(np.sum(4.0 / 3.0 * o.quadratic * omega**2 * amplitude**3)),
    }
    total = max(sum(work.values()), 1e-300)
    return {term: work[term] / total for term in kind}
