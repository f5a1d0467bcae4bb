"""Plank drops of a quarter car, integrated apart from the toolkit, with readings as a logger gives them.

Ranges follow the factbook of Fancher, Ervin, Winkler and Gillespie (UMTRI-86-12, 1986): two or four tires of 0.7 to
0.95 MN/m each, unsprung masses of steer, trailer and drive axles, friction of leaf packs as a share of the load. The
law of friction is Dahl's (1968), which is that of Fancher, Ervin, MacAdam and Winkler (SAE 800905) between two
envelopes a constant distance apart. Everything else is an assumption.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

KINDS = (
    "linear",
    "asymmetric",
    "progressive",
    "beats",
    "friction",
    "friction + asymmetric",
    "friction + progressive",
    "friction + beats",
)
INTERVAL_S, SECONDS, PLANK_M, GRAVITY = 0.005, 5.0, 0.075, 9.81
#: How well a test engineer knows the tributary mass, the unsprung mass and the tire: relative standard deviations.
TOLERANCES = np.array([0.02, 0.05, 0.05, 0.30])


@dataclass(frozen=True)
class QuarterCar:
    """A body on a spring, a damper and dry friction, on a wheel whose tire pushes and never pulls; SI units.

    - `stiffness` is that at rest; `knee_m` the deflection at which a symmetric spring is twice as stiff, `gas_m` the
      height of a gas spring of exponent 1.3, both infinite where the spring is linear;
    - `damping` is the mean of both ways, `in_compression` the share of their sum that compression has;
    - `friction` [N] and the slip length [m] over which it builds up;
    - `beat_hz`, `beat_ratio`, `beat_share`: frequency, damping ratio and share of a further mode of the body that
      moves the same sensor, as an oscillator on the same road.
    """

    mass: float
    unsprung: float
    tire: float
    tire_damping: float
    stiffness: float
    damping: float
    in_compression: float = 0.5
    knee_m: float = np.inf
    gas_m: float = np.inf
    friction: float = 0.0
    slip_m: float = 1.0
    beat_hz: float = 2.0
    beat_ratio: float = 0.05
    beat_share: float = 0.0

    def spring(self, extension: float) -> float:
        """Force that pulls body and wheel together [N], less the static load."""
        if np.isfinite(self.gas_m):
            left = max(1.0 + extension / self.gas_m, 0.1)
            return self.stiffness * self.gas_m / 1.3 * (1.0 - left**-1.3)
        return self.stiffness * extension * (1.0 + (extension / self.knee_m) ** 2)

    def damper(self, rate: float) -> float:
        """Force of the damper [N]; a positive rate is extension."""
        return 2.0 * self.damping * (1.0 - self.in_compression if rate > 0.0 else self.in_compression) * rate


@dataclass(frozen=True)
class Fall:
    """How the road under the wheel falls from the plank: begin [s], duration [s], and whether as a rolling wheel."""

    begin_s: float
    duration_s: float
    rolls: bool

    def __call__(self, time_s: float) -> tuple[float, float]:
        """Height [m] and its rate [m/s]."""
        u = (time_s - self.begin_s) / self.duration_s
        if not 0.0 < u < 1.0:
            return (PLANK_M if u <= 0.0 else 0.0), 0.0
        if self.rolls:
            # A wheel of 0.5 m about the edge, from above it until its foot is down.
            reach2 = 2.0 * 0.5 * PLANK_M - PLANK_M**2
            height = 0.5 - np.sqrt(0.25 - reach2 * u * u)
            return PLANK_M - height, -reach2 * u / (0.5 - height) / self.duration_s
        return (
            0.5 * PLANK_M * (1.0 + np.cos(np.pi * u)),
            -0.5 * np.pi * PLANK_M * np.sin(np.pi * u) / self.duration_s,
        )


def deflection(car: QuarterCar, fall: Fall, time_s: np.ndarray) -> np.ndarray:
    """Change (n,) of the distance from wheel to body [m], extension positive, from rest on the plank."""
    weight = (car.mass + car.unsprung) * GRAVITY
    omega = 2.0 * np.pi * car.beat_hz

    def rates(t: float, s: np.ndarray) -> list[float]:
        body, body_rate, wheel, wheel_rate, stuck, mode, mode_rate = s
        road, road_rate = fall(t)
        extension, rate = body - wheel, body_rate - wheel_rate
        force = car.spring(extension) + car.damper(rate) + car.friction * stuck
        tire = max(weight + car.tire * (road - wheel) + car.tire_damping * (road_rate - wheel_rate), 0.0) - weight
        rubs = (rate - abs(rate) * stuck) / car.slip_m if car.friction else 0.0
        other = -2.0 * car.beat_ratio * omega * mode_rate - omega**2 * (mode - road)
        return [body_rate, -force / car.mass, wheel_rate, (force + tire) / car.unsprung, rubs, mode_rate, other]

    start = [PLANK_M, 0.0, PLANK_M, 0.0, 0.0, PLANK_M, 0.0]
    run = solve_ivp(rates, (0.0, time_s[-1]), start, "LSODA", t_eval=time_s, rtol=1e-7, atol=1e-9, max_step=0.004)
    roads = np.array([fall(t)[0] for t in time_s])
    return np.asarray(run.y[0] - run.y[2] + car.beat_share * (run.y[5] - roads))


@dataclass(frozen=True)
class Record:
    """A logged plank drop: times [s], readings [m], the quarter car, its kind, and what is declared of it.

    `declared` (4,): tributary mass, unsprung mass [kg], tire stiffness [N/m] and damping [N s/m], off by `TOLERANCES`.
    """

    time_s: np.ndarray
    value_m: np.ndarray
    car: QuarterCar
    kind: str
    declared: np.ndarray


def draw(seed: int, number: int) -> Record:
    """One drop; the kinds take turns."""
    random = np.random.default_rng([seed, number])
    kind = KINDS[number % len(KINDS)]
    tires, unsprung = ((2, 540.0), (4, 700.0), (4, 1040.0))[random.integers(3)]
    tire = tires * random.uniform(0.70e6, 0.95e6)
    stiffness = tire * random.uniform(0.12, 0.40)
    series = stiffness * tire / (stiffness + tire)
    mass = series / (2.0 * np.pi * random.uniform(1.2, 2.6)) ** 2
    ratio = random.uniform(0.04, 0.20) if "friction" not in kind else random.uniform(0.02, 0.12)
    car = QuarterCar(
        mass=mass,
        unsprung=unsprung,
        tire=tire,
        tire_damping=random.uniform(1.5e3, 6.0e3),
        stiffness=stiffness,
        damping=2.0 * ratio * np.sqrt(stiffness * mass),
        in_compression=random.uniform(0.15, 0.40) if "asymmetric" in kind else 0.5,
        **_spring(kind, random),
        **({"friction": random.uniform(0.01, 0.10) * mass * GRAVITY} if "friction" in kind else {}),
        slip_m=1e-3 * 6.0 ** random.uniform(0.0, 1.0),
        **_beats(kind, np.sqrt(series / mass) / (2.0 * np.pi), random),
    )
    time = np.arange(round(SECONDS / INTERVAL_S)) * INTERVAL_S
    fall = Fall(random.uniform(0.4, 0.9), random.uniform(0.04, 0.16), bool(random.integers(2)))
    noise, step = random.uniform(0.1e-3, 0.4e-3), random.choice([0.0, 0.1e-3, 0.2e-3])
    value = deflection(car, fall, time) + random.uniform(-0.03, 0.03) + noise * random.standard_normal(time.size)
    value = np.round(value / step) * step if step else value
    true = np.array([car.mass, car.unsprung, car.tire, car.tire_damping])
    return Record(time, value, car, kind, true * np.exp(TOLERANCES * random.standard_normal(4)))


def _spring(kind: str, random: np.random.Generator) -> dict[str, float]:
    if "progressive" not in kind:
        return {}
    return {"knee_m": random.uniform(0.04, 0.10)} if random.integers(2) else {"gas_m": random.uniform(0.15, 0.35)}


def _beats(kind: str, body_hz: float, random: np.random.Generator) -> dict[str, float]:
    if "beats" not in kind:
        return {}
    apart = random.uniform(1.10, 1.60) ** random.choice([-1.0, 1.0])
    return {
        "beat_hz": body_hz * apart,
        "beat_ratio": random.uniform(0.03, 0.15),
        "beat_share": random.uniform(0.1, 0.8),
    }
