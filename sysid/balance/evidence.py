"""How far the force balance and a calibration over bumps disagree: they share sensors and masses, but no road."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sysid.balance.records import ForceBalance

if TYPE_CHECKING:
    from sysid.estimation.fit.fit_result import FitResult


@dataclass(frozen=True)
class Disagreement:
    """One k or c by both: values in SI, and `in_sd`, the difference of their logarithms in its standard deviations.

    Positive where the balance finds more. Tolerances that both share are in both standard deviations, so that the
    true figure is rather larger.
    """

    name: str
    quantity: str
    axle: int
    load_case: str | None
    balance: float
    fit: float
    in_sd: float


def disagreement(balance: ForceBalance, fit: FitResult) -> tuple[Disagreement, ...]:
    """Compare every k and c that both have.

        d = ln(k_balance / k_fit) / sqrt(s_balance^2 + s_fit^2),    s_fit = sd / value

    Parameters
    ----------
    balance, fit
        Of the same campaign; values in SI.

    Returns
    -------
    tuple of Disagreement
        Front to rear, stiffness first; empty where the balance tells nothing.
    """
    fitted = {(p.quantity, p.axle, p.load_case): p for p in fit.parameters}
    found = []
    for e in balance.estimates:
        p = fitted.get((e.quantity, e.axle, e.load_case))
        if p is None or not (p.value > 0.0 and math.isfinite(p.sd)):
            continue
        spread = math.hypot(e.log_sd, p.sd / p.value)
        in_sd = math.log(e.value / p.value) / spread
        found.append(Disagreement(e.name, e.quantity, e.axle, e.load_case, e.value, p.value, in_sd))
    return tuple(sorted(found, key=lambda d: (d.quantity != "stiffness", d.axle)))
