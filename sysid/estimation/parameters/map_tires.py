"""The tires that footprint maps belong to, from the parameters of a fit."""

from __future__ import annotations

import numpy as np

from sysid.arrays import Parameters
from sysid.estimation.parameters.parameter_set import ParameterSet
from sysid.vehicle_model.passes import MapTires

#: Exponents of a radial spring that maps are made for.
SPOKE_EXPONENTS = (0.3, 1.5)


def map_tires(parameters: ParameterSet, log_parameters: Parameters) -> MapTires:
    """Tires of the footprint maps that belong to parameters.

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
