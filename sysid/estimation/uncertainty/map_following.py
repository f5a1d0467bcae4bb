"""What it means for an optimum that its footprint maps follow its tires."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.arrays import Parameters
from sysid.estimation.parameters.parameter_set import ParameterSet
from sysid.estimation.uncertainty.departures import FOOTPRINT, SPOKES, Departure


def map_following(
    information: np.ndarray,
    parameters: ParameterSet,
    log_parameters: Parameters,
    directions: Sequence[Departure],
    loads: np.ndarray | None = None,
) -> np.ndarray:
    """D (p, p): an optimum whose maps follow its tires moves by D^-1 of what it would under maps that stay.

    At the optimum the score J' r(x, a) of the parameters vanishes, a the tires of the maps.  They follow, a = a(x), so
    near an optimum x_d of the data it is -H D (x - x_d) with D = I + H_xx^-1 H_xa da/dx: log tire stiffness and n.

    Parameters
    ----------
    information : (p + n, p + n) data information of parameters and of the n `directions`.
    log_parameters : (p,).
    loads : (n, p) how footprints go with the parameters by way of the axle loads, None for loads that stay.
    """
    count = len(parameters.names)
    change = footprints_by_tires(parameters, log_parameters, directions)
    if loads is not None:
        change = change + loads
    cross = information[:count, count:] @ change
    about_parameters = information[:count, :count]
    return np.asarray(
        np.eye(count) - shift_of_optimum(np.block([[about_parameters, cross], [cross.T, about_parameters]]), count)
    )


def footprints_by_tires(
    parameters: ParameterSet, log_parameters: Parameters, directions: Sequence[Departure]
) -> np.ndarray:
    """Amplitudes (n, p) of the `directions` by which footprints of other tires differ, per log parameter (p,)."""
    change = np.zeros((len(directions), len(parameters.names)))
    for k, p in enumerate(parameters.parameters):
        for j, d in enumerate(directions):
            if p.quantity == "tire_stiffness" and d.kind == FOOTPRINT and d.axle is not None and d.axle == p.axle:
                change[j, k] = 1.0
            if p.quantity == "tire_exponent" and d.kind == SPOKES and d.axle is not None:
                change[j, k] = np.exp(log_parameters[k])
    return change


def shift_of_optimum(information: np.ndarray, count: int) -> np.ndarray:
    """-H_xx^-1 H_xa (p, n): how far the optimum of the data alone moves per unit of further unknowns a.

    Parameters
    ----------
    information : (p + n, p + n) data information H; `count` p.
    """
    # Scaled, so that a parameter without data stays where it is.
    scale = np.sqrt(np.diag(information)[:count])
    scale = np.where(scale > 0.0, scale, 1.0)
    scaled = information[:count, :count] / np.outer(scale, scale) + 1e-10 * np.eye(count)
    return -np.linalg.solve(scaled, information[:count, count:] / scale[:, None]) / scale[:, None]
