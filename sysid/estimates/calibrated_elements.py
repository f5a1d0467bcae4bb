"""Calibrated suspensions and tires as numbers and curves, for other programs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.arrays import Axles
from sysid.estimation.parameters.rockers import LoadShare
from sysid.tabular import Tabular

if TYPE_CHECKING:
    import pandas as pd

#: Rate within which friction changes its sign in a damper curve [m/s].
SLIDING_M_S = 0.01


@dataclass(frozen=True)
class CalibratedSuspension:
    """One suspension, both sides together, in one load case.

    - `axle`: index of its axle (of an axle group the first);
    - `law` in words;
    - `static_load_N`: load carried at rest;
    - `stiffness_N_per_m`: tangent at rest;
    - `damping_N_s_per_m`: secant at 0.5 m/s, mean of both directions;
    - `spring_force_N` over `extension_m` and `damper_force_N` over `rate_m_s`, each (n,), positive when they pull axle
      and body together, static load not included;
    - `friction_N`: Coulomb force, zero without.
    """

    axle: int
    name: str
    law: str
    static_load_N: float
    stiffness_N_per_m: float
    damping_N_s_per_m: float
    extension_m: np.ndarray
    spring_force_N: np.ndarray
    rate_m_s: np.ndarray
    damper_force_N: np.ndarray
    friction_N: float

    @property
    def linear(self) -> bool:
        """Whether stiffness and damping say everything about the suspension."""
        spring = self.stiffness_N_per_m * self.extension_m
        damper = self.damping_N_s_per_m * self.rate_m_s
        return (
            self.friction_N == 0.0
            and np.allclose(self.spring_force_N, spring, rtol=1e-6, atol=1e-3)
            and np.allclose(self.damper_force_N, damper, rtol=1e-6, atol=1e-3)
        )

    def damper_with_friction(self) -> tuple[np.ndarray, np.ndarray]:
        """Rates [m/s] and forces [N] of damper and Coulomb friction together, the friction ramped over +-0.01 m/s."""
        rate = self.rate_m_s
        if self.friction_N > 0.0:
            rate = np.unique(np.round(np.concatenate([rate, [-SLIDING_M_S, 0.0, SLIDING_M_S]]), 9))
        force = np.interp(rate, self.rate_m_s, self.damper_force_N)
        return rate, force + self.friction_N * np.clip(rate / SLIDING_M_S, -1.0, 1.0)


@dataclass(frozen=True)
class CalibratedFrame:
    """A body (index) whose frame bends, and the `axles` (indices) that carry it.

    `frequency_hz`, `damping_ratio` and modal mass are those of its first free mode in the load case, for a shape whose
    mean square along a uniform beam is 1.
    """

    body: int
    name: str
    axles: tuple[int, ...]
    frequency_hz: float
    damping_ratio: float
    modal_mass_kg: float

    @property
    def of_other_programs(self) -> str:
        """Note for a program that has rigid bodies only."""
        return (
            f"The frame of body {self.body + 1} ({self.name}) bends: first free mode {self.frequency_hz:.3f} Hz, "
            f"damping ratio {self.damping_ratio:.4f}, modal mass {self.modal_mass_kg:.0f} kg in this load case. This "
            "file holds no frame: give yours that mode, or motions above its axles will differ."
        )


@dataclass(frozen=True)
class CalibratedVehicle(Tabular):
    """All suspensions and tires in one load case.

    - `source` is ``posterior median`` or ``least squares``;
    - `tire_stiffness_N_per_m`, `tire_damping_N_s_per_m` (axles,) of all tires of an axle, tangents at its static load
      in this load case;
    - `rockers`: between springs, with their load shares; the suspensions are given as they are without rockers;
    - `frames`: those that bend.
    """

    load_case: str
    source: str
    suspensions: tuple[CalibratedSuspension, ...]
    tire_stiffness_N_per_m: Axles
    tire_damping_N_s_per_m: Axles
    rockers: tuple[LoadShare, ...] = ()
    frames: tuple[CalibratedFrame, ...] = ()

    def remarks(self, axle: int | None = None) -> tuple[str, ...]:
        """What programs that know springs and rigid bodies only have to be told, of one axle (index) or of all."""
        rockers = [(r.axles, r.of_other_programs) for r in self.rockers]
        frames = [(f.axles, f.of_other_programs) for f in self.frames]
        return tuple(words for axles, words in (*rockers, *frames) if axle is None or axle in axles)

    def summary(self) -> pd.DataFrame:
        """One row per axle, in SI units; in an axle group the suspension is listed at the first axle."""
        import pandas as pd

        of_axle = {s.axle: s for s in self.suspensions}
        rows = []
        for i, (stiffness, damping) in enumerate(
            zip(self.tire_stiffness_N_per_m, self.tire_damping_N_s_per_m, strict=True)
        ):
            s = of_axle.get(i)
            rows.append(
                {
                    "load_case": self.load_case,
                    "axle": i + 1,
                    "law": "" if s is None else s.law,
                    "stiffness_N_per_m": np.nan if s is None else s.stiffness_N_per_m,
                    "damping_N_s_per_m": np.nan if s is None else s.damping_N_s_per_m,
                    "friction_N": np.nan if s is None else s.friction_N,
                    "tire_stiffness_N_per_m": stiffness,
                    "tire_damping_N_s_per_m": damping,
                }
            )
        return pd.DataFrame(rows)
