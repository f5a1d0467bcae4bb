"""The tires that footprint maps belong to, from the parameters of a fit, and what it means that maps follow them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.estimation.departures import FOOTPRINT, SPOKES, Departure
from sysid.estimation.mass_effect import shift_by_masses
from sysid.estimation.parameters import ParameterSet
from sysid.vehicle_model.lanes import MapTires

#: Exponents of a radial spring that maps are made for.
SPOKE_EXPONENTS = (0.3, 1.5)


def map_tires(parameters: ParameterSet, log_parameters: np.ndarray) -> MapTires:
    """Tires of the footprint maps that go with parameters.

    p = n - 1/2: on a flat road the force of radial springs that follow compression^p grows very nearly with
    deflection^(p + 1/2), as the contact's length grows with its square root; n is the tire's exponent.

    Parameters
    ----------
    log_parameters : (p,) with a tire stiffness of every axle and one tire exponent.
    """
    values = dict(zip(parameters.names, np.exp(log_parameters), strict=True))
    tires = [p for p in parameters.parameters if p.quantity == "tire_stiffness"]
    exponent = next(values[p.name] for p in parameters.parameters if p.quantity == "tire_exponent")
    stiffness = tuple(float(values[p.name]) for p in sorted(tires, key=lambda p: p.axle or 0))
    return MapTires(stiffness, float(np.clip(exponent - 0.5, *SPOKE_EXPONENTS)))


def following(
    information: np.ndarray, parameters: ParameterSet, log_parameters: np.ndarray, directions: Sequence[Departure]
) -> np.ndarray:
    """D (p, p): an optimum whose maps follow its tires moves by D^-1 of what it would under maps that stay.

    At the optimum the score J' r(x, a) of the parameters vanishes, a the tires of the maps.  They follow, a = a(x), so
    near an optimum x_d of the data it is -H D (x - x_d) with D = I + H_xx^-1 H_xa da/dx: log tire stiffness and n.

    Parameters
    ----------
    information : (p + n, p + n) data information of parameters and of the n `directions`.
    log_parameters : (p,).
    """
    count = len(parameters.names)
    change = np.zeros((len(directions), count))
    for k, p in enumerate(parameters.parameters):
        for j, d in enumerate(directions):
            if p.quantity == "tire_stiffness" and d.kind == FOOTPRINT and d.axle is not None and d.axle == p.axle:
                change[j, k] = 1.0
            if p.quantity == "tire_exponent" and d.kind == SPOKES and d.axle is not None:
                change[j, k] = np.exp(log_parameters[k])
    cross = information[:count, count:] @ change
    own = information[:count, :count]
    return np.asarray(np.eye(count) - shift_by_masses(np.block([[own, cross], [cross.T, own]]), count))
