"""Load shares of rockers between springs, from the odds that are estimated."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sysid.campaign.vehicle_records import Vehicle
from sysid.display import Z90
from sysid.estimation.parameters.estimate import ParameterEstimate
from sysid.wording import joined_words


class _Quantiles(Protocol):
    @property
    def q05(self) -> float: ...
    @property
    def q50(self) -> float: ...
    @property
    def q95(self) -> float: ...


@dataclass(frozen=True)
class LoadShare:
    """Load share s of one rocker, `share` with its 90 % interval `low` to `high`; of a declared one all are the same.

    `name` of the rocker and `axles` (indices) that it joins.
    """

    name: str
    axles: tuple[int, ...]
    share: float
    low: float
    high: float
    declared: bool = False

    @property
    def words(self) -> str:
        """A sentence for the user."""
        axles = joined_words([str(i + 1) for i in self.axles])
        if self.declared:
            return f"The rocker '{self.name}' between axles {axles} shares {100.0 * self.share:.0f} % (declared)."
        return (
            f"The rocker '{self.name}' between axles {axles} shares {100.0 * self.share:.0f} % of their loads (90 % "
            f"interval {100.0 * self.low:.0f} to {100.0 * self.high:.0f} %)."
        )

    @property
    def of_other_programs(self) -> str:
        """Note for a program that has only springs between one axle and the frame."""
        axles = joined_words([str(i + 1) for i in self.axles])
        return (
            f"A rocker joins the springs of axles {axles}, load share {self.share:.3f}: with their forces S_i the "
            "force on each axle and on the frame above it is S_i + share (mean S - S_i); dampers and stops are apart "
            "from it. This file has springs only: add the rocker, or motions of these axles will differ."
        )

    @property
    def proposal(self) -> str:
        """The sentence that asks the user to declare a rocker which the data show."""
        axles = joined_words([str(i + 1) for i in self.axles])
        return (
            f"Axles {axles} behave as if a rocker shared {100.0 * self.share:.0f} % of their load (90 % interval "
            f"{100.0 * self.low:.1f} to {100.0 * self.high:.1f} %): all results include this. If the truck has one, "
            'declare [[vehicle.group]] kind = "equaliser" with these axles; if not, do not use results of these axles.'
        )


def share_of(odds: float) -> float:
    """s = o / (1 + o) of odds o = s / (1 - s)."""
    return float(odds / (1.0 + odds)) if np.isfinite(odds) else 1.0


def share_from_fit(name: str, axles: tuple[int, ...], odds: float, log_sd: float) -> LoadShare:
    """The share whose log odds are normal about ln `odds`."""
    low, high = (share_of(odds * float(np.exp(side * Z90 * log_sd))) for side in (-1.0, 1.0))
    return LoadShare(name, axles, share_of(odds), low, high)


def load_shares(
    vehicle: Vehicle, estimates: Iterable[ParameterEstimate], posterior: Mapping[str, _Quantiles] | None = None
) -> tuple[LoadShare, ...]:
    """Share of every rocker: declared, else posterior median and quantiles, else from least squares."""
    by_name, sampled = {e.name: e for e in estimates}, posterior or {}
    shares = []
    for rocker in vehicle.equalisers:
        if rocker.load_share is not None:
            s = rocker.load_share
            shares.append(LoadShare(rocker.name, rocker.axles, s, s, s, declared=True))
            continue
        name = share_name(rocker.name)
        if name in sampled:
            q05, q50, q95 = (share_of(getattr(sampled[name], q)) for q in ("q05", "q50", "q95"))
            shares.append(LoadShare(rocker.name, rocker.axles, q50, q05, q95))
        elif name in by_name:
            e = by_name[name]
            shares.append(share_from_fit(rocker.name, rocker.axles, e.value, e.sd / e.value))
    return tuple(shares)


def share_name(rocker: str) -> str:
    """Name of the parameter of a rocker."""
    return f"share_odds[{rocker}]"


def shares_by_axle(vehicle: Vehicle, shares: Iterable[LoadShare]) -> np.ndarray:
    """Share s of every axle's rocker (axles,), 0 without."""
    by_axle = np.zeros(len(vehicle.axles))
    for one in shares:
        by_axle[list(one.axles)] = one.share
    return by_axle


def shares_before_data(vehicle: Vehicle) -> np.ndarray:
    """Share s of every axle's rocker (axles,), 0 without: the declared one, else the median of its prior."""
    by_axle = np.zeros(len(vehicle.axles))
    for rocker in vehicle.equalisers:
        by_axle[list(rocker.axles)] = share_of(1.0) if rocker.load_share is None else rocker.load_share
    return by_axle
