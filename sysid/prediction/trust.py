"""How far a predicted pass goes beyond what the driven runs reached: there the calibrated laws are extrapolated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from sysid.arrays import AxlesBySamples, SamplesByAxlesBySets
from sysid.campaign.requests import MARGIN
from sysid.tabular import Tabular

if TYPE_CHECKING:
    import pandas as pd

Quantity = Literal["speed", "tire_deflection", "travel", "damper_speed", "lift_off"]


@dataclass(frozen=True)
class DrivenRange(Tabular):
    """What the driven runs reached, simulated at the least-squares optimum: the largest value of all runs.

    - `speed_m_s`: highest nominal speed by load case;
    - `tire_deflection_m` (axles,): from the free tire, the deflection at which the spring of the tire alone carries the
      force;
    - `jounce_m`, `rebound_m` (axles,): compression and extension of the suspension from rest;
    - `damper_speed_m_s` (axles,): rate of its extension, either sign;
    - `lift_off_s` (axles,): longest time off the ground in one run.
    """

    speed_m_s: Mapping[str, float]
    tire_deflection_m: np.ndarray
    jounce_m: np.ndarray
    rebound_m: np.ndarray
    damper_speed_m_s: np.ndarray
    lift_off_s: np.ndarray

    def summary(self) -> pd.DataFrame:
        """One row per axle, in SI units."""
        import pandas as pd

        names = ("tire_deflection_m", "jounce_m", "rebound_m", "damper_speed_m_s", "lift_off_s")
        axle = np.arange(len(self.jounce_m)) + 1
        return pd.DataFrame({"axle": axle, **{name: getattr(self, name) for name in names}})


@dataclass(frozen=True)
class Reached:
    """What a pass reaches, median over the draws, (axles,) each; the same quantities as in :class:`DrivenRange`."""

    speed_m_s: float
    tire_deflection_m: np.ndarray
    jounce_m: np.ndarray
    rebound_m: np.ndarray
    damper_speed_m_s: np.ndarray
    lift_off_s: np.ndarray


@dataclass(frozen=True)
class Extrapolation:
    """One quantity of one axle (index) that goes beyond the driven runs; `reached` and `driven` in m/s, m or s.

    `assumed` is the travel [m] of an undeclared bump stop that acts there, None without one.
    """

    what: Quantity
    axle: int
    reached: float
    driven: float
    assumed: float | None = None


def extrapolations(
    reached: Reached, driven: DrivenRange, load_case: str, acting: Mapping[int, tuple[str, float]] | None = None
) -> tuple[Extrapolation, ...]:
    """What of a pass goes beyond the driven runs, axle by axle; empty where nothing does.

    Beyond is more than :data:`sysid.campaign.requests.MARGIN` times as far.

    The speed counts against the runs of the same load case, 0 without any.  Of both directions of travel the one that
    goes further beyond is named.  A wheel that leaves the road counts where it did so in no driven run.
    `acting` are assumed bump stops that act, by axle: direction and travel [m].
    """
    beyond: list[Extrapolation] = []
    assumed = acting or {}

    def compare(what: Quantity, axle: int, value: float, limit: float) -> None:
        if value > MARGIN * limit:
            stop = assumed[axle][1] if what == "travel" and axle in assumed else None
            # The direction that is named need not be the one in which a stop acts.
            beyond.append(Extrapolation(what, axle, value, limit, stop if stop is None or value > stop else None))

    for i in range(len(reached.jounce_m)):
        compare("speed", i, reached.speed_m_s, driven.speed_m_s.get(load_case, 0.0))
        compare("tire_deflection", i, float(reached.tire_deflection_m[i]), float(driven.tire_deflection_m[i]))
        jounce = float(reached.jounce_m[i]), float(driven.jounce_m[i])
        rebound = float(reached.rebound_m[i]), float(driven.rebound_m[i])
        # Compared as products: a run that never extended has a limit of zero.
        compare("travel", i, *(rebound if rebound[0] * jounce[1] > jounce[0] * rebound[1] else jounce))
        compare("damper_speed", i, float(reached.damper_speed_m_s[i]), float(driven.damper_speed_m_s[i]))
        if driven.lift_off_s[i] == 0.0:
            compare("lift_off", i, float(reached.lift_off_s[i]), 0.0)
    return tuple(beyond)


def beyond_driven(
    driven: DrivenRange,
    tire_deflection_m: SamplesByAxlesBySets,
    extension_m: SamplesByAxlesBySets,
    rate_m_s: SamplesByAxlesBySets,
    tire_force_N: SamplesByAxlesBySets,
) -> AxlesBySamples:
    """Instants at which an axle is beyond the driven runs in at least half of the draws, (axles, T) bool.

    Parameters
    ----------
    tire_deflection_m, extension_m, rate_m_s, tire_force_N : histories (T, axles, S) [m, m, m/s, N].
    """
    limits = {name: MARGIN * getattr(driven, name)[:, None] for name in ("tire_deflection_m", "jounce_m", "rebound_m")}
    beyond = tire_deflection_m > limits["tire_deflection_m"]
    beyond |= (-extension_m > limits["jounce_m"]) | (extension_m > limits["rebound_m"])
    beyond |= np.abs(rate_m_s) > MARGIN * driven.damper_speed_m_s[:, None]
    beyond |= (tire_force_N <= 0.0) & (driven.lift_off_s == 0.0)[:, None]
    return np.asarray(beyond.mean(axis=-1) >= 0.5).T
