"""Departures that the residuals show and no law or declaration has: bushings, bumps unlike their scans, links."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sysid.arrays import ParametersByParameters
from sysid.estimation.fit.causes import Cause
from sysid.estimation.uncertainty.allowances import Allowances
from sysid.estimation.uncertainty.departures import BUMP, BUSHING, TRAILING
from sysid.estimation.uncertainty.mass_response import MassResponse
from sysid.numbers import listing

#: A departure is named where it is this many standard deviations from none, and larger than this: bushings stiffer than
#: 20 MN/m [mm/kN] change little, scans of bumps are known to some 2 % of their height, and wheels that go 2 % of their
#: jounce aft are led straight (assumptions).
CLEAR_SD, LEAST = 3.0, {BUSHING: 0.05, BUMP: 0.02, TRAILING: 0.02}


def found_departures(
    allowances: Allowances, response: MassResponse, covariance: ParametersByParameters
) -> tuple[Cause, ...]:
    """A cause with the values of all axles for every kind that the data show.

    Parameters
    ----------
    response : masses and departures given the parameters; covariance : (p, p) of the log parameters.
    """
    causes = []
    if bushings := [
        f"{1.0 / a:.2g} ± {sd / a**2:.1g} MN/m (axle {axle + 1})"
        for axle, a, sd in _clear(BUSHING, allowances, response, covariance)
    ]:
        sentence = (
            f"The dampers give way in their rubber bushings, which nobody declared: {listing(bushings)}. The "
            "calibrated model has them, and c is that of the dampers alone. To give a stiffness of your own, add "
            "damper_bushing to suspension_law."
        )
        causes.append(Cause("bushing", sentence, modelled=True))
    if bumps := [
        f"{100.0 * abs(a):.2g} ± {100.0 * sd:.1g} % {'higher' if a > 0.0 else 'lower'} (axle {axle + 1})"
        for axle, a, sd in _clear(BUMP, allowances, response, covariance)
    ]:
        sentence = (
            f"Under the wheels the bump is not as high as its scan says: {listing(bumps)}. It gives way, or the scan "
            "is of another place. The calibrated model has it as the wheels felt it; look whether it moves under a "
            "wheel, and measure its height where the wheels went."
        )
        causes.append(Cause("bump", sentence, modelled=True))
    if links := [
        f"{100.0 * abs(a):.2g} ± {100.0 * sd:.1g} % {'aft' if a > 0.0 else 'forward'} (axle {axle + 1})"
        for axle, a, sd in _clear(TRAILING, allowances, response, covariance)
    ]:
        sentence = (
            "Links or leaf packs lead wheels fore or aft as they rise, by a share of their jounce: "
            f"{listing(links)}. The calibrated model has it; look whether the links slope by as much."
        )
        causes.append(Cause("links", sentence, modelled=True))
    return tuple(causes)


def _clear(
    kind: str, allowances: Allowances, response: MassResponse, covariance: ParametersByParameters
) -> Iterator[tuple[int, float, float]]:
    """Axle (index), amplitude and its standard deviation of the axles that clearly depart."""
    directions, masses = allowances.departures.directions, len(allowances.masses.factors)
    common = [j for j, d in enumerate(directions) if d.kind == kind and d.axle is None]
    for j, d in enumerate(directions):
        if d.kind != kind or d.axle is None:
            continue
        row = np.zeros(response.amounts.size)
        row[[masses + k for k in (j, *common)]] = 1.0
        amount, by_parameters = float(row @ response.amounts), row @ response.response
        sd = float(np.sqrt(np.sum((row @ response.factor) ** 2) + by_parameters @ covariance @ by_parameters))
        if abs(amount) > max(LEAST[kind], CLEAR_SD * sd):
            yield d.axle, amount, sd
