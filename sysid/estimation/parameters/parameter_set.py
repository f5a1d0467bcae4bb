"""Named parameters of a calibration: unit, transform, start value and prior, and the links between them.

All global parameters are positive and estimated in log space; priors are Gaussian there.  The transform's Jacobian
belongs to the prior, so a lognormal prior on the natural scale is exactly the Gaussian one on the log scale.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: Quantity of a rocker's load share s: its odds s / (1 - s), positive as all parameters are.
SHARE_ODDS = "load_share_odds"


#: Quantities of a frame that bends: frequency in the first load case, and damping ratio.
BENDING_FREQUENCY, BENDING_DAMPING = "bending_frequency", "bending_damping_ratio"


def bending_names(body: str) -> tuple[str, str]:
    """Names of the parameters of a body's bending frame: frequency and damping ratio."""
    return f"bending_hz[{body}]", f"bending_ratio[{body}]"


@dataclass(frozen=True)
class Parameter:
    """One global parameter: value and description are kept apart.

    - `quantity` is ``stiffness``, ``damping``, ``tire_stiffness``, ``tire_damping``, ``tire_exponent``,
      ``load_share_odds`` of a rocker (at its first axle), ``bending_frequency`` or ``bending_damping_ratio`` of a
      frame, or one of the quantities of :mod:`sysid.estimation.parameters.suspension_elements`;
    - `axle`: its axle index, None for a property of all axles;
    - `load_case`: None means shared by all load cases.

    `start` and `prior_median` in `unit`; `prior_sd` is the standard deviation of the logarithm.
    """

    name: str
    quantity: str
    unit: str
    start: float
    prior_median: float
    prior_sd: float
    axle: int | None = None
    load_case: str | None = None
    law: str = "linear"

    def __post_init__(self) -> None:
        if not (self.start > 0 and self.prior_median > 0 and self.prior_sd > 0):
            raise ValueError(f"Parameter {self.name} needs a positive start, prior median and prior sd.")


@dataclass(frozen=True)
class PriorLink:
    """Gaussian prior on the difference of two log parameters, ``log second - log first ~ N(mean, sd)``."""

    first: str
    second: str
    mean: float
    sd: float


@dataclass(frozen=True)
class ParameterSet:
    """All global parameters of a campaign, with the links between them.

    `suspension_axle` (axles,) says which axle's suspension parameters hold for an axle: the first one's in an axle
    group; empty where every axle has its own.
    """

    parameters: tuple[Parameter, ...]
    links: tuple[PriorLink, ...] = ()
    suspension_axle: tuple[int, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names in the order of the parameter vector."""
        return tuple(p.name for p in self.parameters)

    @property
    def start(self) -> np.ndarray:
        """Start vector (p,) in log space."""
        return np.log([p.start for p in self.parameters])

    def index(self, quantity: str, axle: int | None = None, load_case: str | None = None) -> int:
        """Position of the parameter that gives `quantity` of an axle in a load case; KeyError where there is none."""
        if axle is not None and self.suspension_axle and not quantity.startswith("tire_"):
            axle = self.suspension_axle[axle]
        for position, p in enumerate(self.parameters):
            if p.quantity == quantity and p.axle == axle and p.load_case in (None, load_case):
                return position
        raise KeyError((quantity, axle, load_case))

    def prior_rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Prior as linear residuals: ``rows @ log_parameters - targets`` is standard normal; (m, p) and (m,)."""
        count = len(self.parameters)
        # A linked parameter has its prior from the link alone; its `prior_sd` is the marginal one.
        linked = {link.second for link in self.links}
        unlinked = [(i, p) for i, p in enumerate(self.parameters) if p.name not in linked]
        rows = [np.eye(count)[i] / p.prior_sd for i, p in unlinked]
        targets = [np.log(p.prior_median) / p.prior_sd for _, p in unlinked]
        order = {p.name: i for i, p in enumerate(self.parameters)}
        for link in self.links:
            row = np.zeros(count)
            row[order[link.second]], row[order[link.first]] = 1.0 / link.sd, -1.0 / link.sd
            rows.append(row)
            targets.append(link.mean / link.sd)
        return np.array(rows), np.array(targets)

    def prior_pull(self, log_parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (p,) of half the sum of squares of the priors at log parameters (p,), and their precision (p, p)."""
        rows, targets = self.prior_rows()
        return rows.T @ (rows @ log_parameters - targets), rows.T @ rows
