"""Rubber bushings of dampers that no law declares and the residuals show."""

from __future__ import annotations

import numpy as np

from sysid.arrays import ParametersByParameters
from sysid.estimation.uncertainty.allowances import Allowances
from sysid.estimation.uncertainty.departures import BUSHING
from sysid.estimation.uncertainty.mass_response import MassResponse
from sysid.numbers import listing

#: Bushings are named where their compliance is this many standard deviations above zero, and where they are softer than
#: this [mm/kN]: stiffer ones than 20 MN/m change little.
CLEAR_SD, SOFT = 3.0, 0.05


def found_bushings(
    allowances: Allowances, response: MassResponse, covariance: ParametersByParameters
) -> tuple[str, ...]:
    """A sentence with the stiffness of all bushings that the data show, or none.

    Parameters
    ----------
    response : masses and departures given the parameters; covariance : (p, p) of the log parameters.
    """
    directions, masses = allowances.departures.directions, len(allowances.masses.factors)
    common = [j for j, d in enumerate(directions) if d.kind == BUSHING and d.axle is None]
    said = []
    for j, d in enumerate(directions):
        if d.kind != BUSHING or d.axle is None:
            continue
        row = np.zeros(response.amounts.size)
        row[[masses + k for k in (j, *common)]] = 1.0
        compliance = float(row @ response.amounts)
        by_parameters = row @ response.response
        sd = float(np.sqrt(np.sum((row @ response.factor) ** 2) + by_parameters @ covariance @ by_parameters))
        if compliance > max(SOFT, CLEAR_SD * sd):
            said.append(f"{1.0 / compliance:.2g} ± {sd / compliance**2:.1g} MN/m (axle {d.axle + 1})")
    if not said:
        return ()
    return (
        f"The dampers give way in their rubber bushings, which nobody declared: {listing(said)}. The calibrated model "
        "has them, and c is that of the dampers alone. To give a stiffness of your own, add damper_bushing to "
        "suspension_law.",
    )
