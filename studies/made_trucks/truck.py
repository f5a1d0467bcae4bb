"""What a made truck is: geometry, masses and laws, SI, axles front to rear, wheels as left and right of each axle."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

GRAVITY = 9.81


@dataclass(frozen=True)
class LoadCase:
    """The truck with a certain cargo; inertias about the centre of gravity of each body, cargo included."""

    name: str
    axle_load_kg: Array
    body_mass_kg: Array
    pitch_inertia_kg_m2: Array
    roll_inertia_kg_m2: Array
    cg_height_m: Array
    stiffness_n_per_m: Array  # tangent at rest, per axle


@dataclass(frozen=True)
class OwnSprings:
    """A mass on springs of its own inside a body; what is declared counts it to that body."""

    body: int
    x_m: float
    height_m: float
    mass_kg: tuple[float, ...]  # per load case
    frequency_hz: float
    damping_ratio: float


@dataclass(frozen=True)
class Truck:
    """A truck; `hitch_*` join a second body to the first one."""

    axle_x_m: Array
    axle_body: tuple[int, ...]
    suspension: tuple[str, ...]
    unsprung_kg: Array
    axle_roll_inertia_kg_m2: Array
    track_m: Array
    spring_track_m: Array
    damper_track_m: Array
    auxiliary_roll_n_m: Array
    radius_m: float
    tire_exponent: float
    tire_stiffness_n_per_m: Array  # tangent at the load of the first load case
    tire_damping_n_s_per_m: Array
    load_cases: tuple[LoadCase, ...]
    damper_rebound_n_s_per_m: Array  # slope at small rates
    damper_jounce_n_s_per_m: Array
    hitch_x_m: float = 0.0
    hitch_height_m: float = 0.0
    hitch_roll_n_m: float = 3e6  # fifth wheels hold roll nearly rigidly
    left_spring_share: float = 0.5
    left_damper_share: Array = field(default_factory=lambda: np.array(0.5))
    left_load_share: float = 0.5
    friction_share: Array = field(default_factory=lambda: np.array(0.0))  # of the spring's load
    friction_stroke_m: float = 2e-3
    friction_rate_loss: float = 0.0  # share of the friction lost at high rates
    friction_rate_m_s: float = 0.05
    damper_saturation_m_s: Array = field(default_factory=lambda: np.array(np.inf))
    bushing_n_per_m: Array = field(default_factory=lambda: np.array(np.inf))
    helper_ratio: Array = field(default_factory=lambda: np.array(0.0))  # helper over main rate
    helper_knee_n: Array = field(default_factory=lambda: np.array(0.0))  # axle's spring load at the knee
    bellows_m: Array = field(default_factory=lambda: np.array(np.inf))  # effective height of a bellows
    jounce_m: Array = field(default_factory=lambda: np.array(0.1))
    rebound_m: Array = field(default_factory=lambda: np.array(0.1))
    stop_n_per_m: float = 2e6
    own_springs: tuple[OwnSprings, ...] = ()
    frame_hinge_hz: float = 0.0  # bending frequency of the last body as two halves, 0: rigid
    link_slope: Array = field(default_factory=lambda: np.array(0.0))  # aft travel of the wheel over jounce
    rocker_share: float = 0.0  # of the difference of the last two axles of a leaf tandem
    lash_m: float = 0.0  # free travel of dampers in their eyes
    speed_hold_s: float = np.inf  # time constant of what holds the speed
    speed_hold_height_m: float | None = None  # of its force: 0 by wheels on the road; None: at the centre of gravity

    @property
    def axles(self) -> int:
        """Number of axles."""
        return int(self.axle_x_m.size)

    def wheels(self, values: Array, left_share: float | Array = 0.5) -> Array:
        """Values of axles as those of left and right (..., 2 axles)."""
        share = np.broadcast_to(np.asarray(left_share, dtype=float), (self.axles,))
        axle = (
            np.broadcast_to(values, (*np.shape(values)[:-1], self.axles))
            if np.ndim(values)
            else np.full(self.axles, values)
        )
        return np.stack([axle * share, axle * (1.0 - share)], axis=-1).reshape(*np.shape(axle)[:-1], 2 * self.axles)

    def each(self, values: Array) -> Array:
        """Values of axles, the same on both sides (2 axles)."""
        return np.repeat(np.broadcast_to(values, (self.axles,)), 2).astype(float)

    def spring_load_n(self, case: int) -> Array:
        """Static load that the springs of each axle carry [N]."""
        return np.asarray(GRAVITY * (self.load_cases[case].axle_load_kg - self.unsprung_kg))

    def hitch_load_kg(self, case: int) -> float:
        """Mass that rests on the hitch."""
        of = self.load_cases[case]
        front = np.array(self.axle_body) == 0
        return float(np.sum((of.axle_load_kg - self.unsprung_kg)[front]) - of.body_mass_kg[0])

    def cg_x_m(self, case: int) -> Array:
        """Centres of gravity of the bodies behind axle 1, from the balance of moments [m]."""
        of = self.load_cases[case]
        carried = of.axle_load_kg - self.unsprung_kg
        hitch = self.hitch_load_kg(case)
        moments = np.zeros(of.body_mass_kg.size)
        for body in range(moments.size):
            on = np.array(self.axle_body) == body
            moments[body] = np.sum((carried * self.axle_x_m)[on])
        if moments.size > 1:
            moments[0] -= hitch * self.hitch_x_m
            moments[1] += hitch * self.hitch_x_m
        return np.asarray(moments / of.body_mass_kg)

    def damping_n_s_per_m(self) -> Array:
        """c of each axle: secant at 0.5 m/s, mean of both directions."""
        mean = 0.5 * (self.damper_rebound_n_s_per_m + self.damper_jounce_n_s_per_m)
        return np.asarray(mean / (1.0 + 0.5 / self.damper_saturation_m_s))
