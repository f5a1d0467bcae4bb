"""Results of the force balance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: Widest 90 % interval of a value that counts as determined, upper over lower end (an assumption): a factor of 1.5.
DETERMINED = 1.5


@dataclass(frozen=True)
class BalanceEstimate:
    """k or c of one suspension: `name` like ``k_1`` or ``k_2[loaded]``, `quantity` ``stiffness`` or ``damping``.

    `value` in `unit`, `low` and `high` the ends of its 90 % interval, `log_sd` the standard deviation of its logarithm;
    `axle` is an index, `load_case` None where it is shared.
    """

    name: str
    quantity: str
    axle: int
    load_case: str | None
    unit: str
    value: float
    low: float
    high: float
    log_sd: float

    @property
    def determined(self) -> bool:
        """Whether the records tell it within a factor of 1.5."""
        return self.high < DETERMINED * self.low


@dataclass(frozen=True)
class LawEstimate:
    """One departure from a linear spring and damper: `value` and `sd` in `unit`; `axle` None for all axles."""

    quantity: str
    axle: int | None
    unit: str
    value: float
    sd: float


@dataclass(frozen=True)
class BalancedRecord:
    """One log: seconds that are used, and forces that no law explains over the inertia forces (RMS, 0.7 to 15 Hz)."""

    file: str
    load_case: str
    used_s: float
    unexplained: float


@dataclass(frozen=True)
class AxleLoads:
    """Axle loads in one log, from `used_s` seconds of it; `static_N` (na,) is the load at rest.

    - `coefficient` (na,): load coefficient, the standard deviation of the load over that at rest, to 25 Hz; `low` and
      `high` the ends of 90 % intervals;
    - `density` (na, m): one-sided power spectral density [N2/Hz] at `frequency_hz` (m,), with `density_low` and
      `density_high`.
    """

    file: str
    load_case: str
    used_s: float
    static_N: np.ndarray
    coefficient: np.ndarray
    low: np.ndarray
    high: np.ndarray
    frequency_hz: np.ndarray
    density: np.ndarray
    density_low: np.ndarray
    density_high: np.ndarray


@dataclass(frozen=True)
class DrivenRoad:
    """Speed and road of one drive, from the delays between its axles and from what its wheels felt.

    - `speed_m_s` with the ends of its 90 % interval;
    - `density_m3`: G_d(n_0) of ISO 8608 at 0.1 cycles/m, with the ends of its 90 % interval, and `waviness` w of
      G_d(n_0) (n / n_0)^-w; `road_class` is the nearest class;
    - `apart`: power that differs from axle to axle over that of the road, at 4 Hz.
    """

    file: str
    load_case: str
    speed_m_s: float
    speed_low: float
    speed_high: float
    density_m3: float
    density_low: float
    density_high: float
    waviness: float
    road_class: str
    apart: float


@dataclass(frozen=True)
class ForceBalance:
    """k and c of all suspensions from the balance of forces on the bodies.

    `sentences` say what is missing or not determined; without `estimates` they say why. `converged` is about the
    search, which took `rounds`. `loads`, `tires` and `roads` are of road drives.
    """

    estimates: tuple[BalanceEstimate, ...]
    laws: tuple[LawEstimate, ...]
    records: tuple[BalancedRecord, ...]
    sentences: tuple[str, ...]
    converged: bool
    rounds: int
    loads: tuple[AxleLoads, ...] = ()
    tires: tuple[BalanceEstimate, ...] = ()
    roads: tuple[DrivenRoad, ...] = ()
