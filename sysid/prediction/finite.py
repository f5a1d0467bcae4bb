"""No prediction that is not a number: it ends in a sentence with its likely cause instead of a result."""

from __future__ import annotations

import numpy as np

from sysid.arrays import Axles
from sysid.campaign.records import PredictionRequest
from sysid.campaign.requests import pass_fault
from sysid.errors import CampaignError, DataRejectedError
from sysid.estimation.parameters.parameter_set import ParameterSet


def check_duration(request: PredictionRequest, duration_s: float) -> None:
    """Refuse a pass so slow that its record would have no end.

    Raises
    ------
    CampaignError
        If it takes longer than `sysid.limits.PASS_SECONDS`.
    """
    if fault := pass_fault(request.speed_m_s, duration_s):
        raise CampaignError(f"The pass of load case '{request.load_case}' {fault}.")


def check_finite(
    request: PredictionRequest, parameters: ParameterSet, sets: np.ndarray, static_N: Axles, *histories: np.ndarray
) -> None:
    """Refuse a simulated pass with values that are not finite, or without static loads to relate them to.

    Parameters
    ----------
    request : the pass.
    parameters, sets : parameters and their logarithms (p, S) in every one of the S simulations.
    static_N : (axles,) static axle loads [N].
    histories : (T, axles, S) each.

    Raises
    ------
    DataRejectedError
        Names the pass, how many simulations failed, and the parameter that is furthest from what a vehicle has.
    """
    name = f"The pass of load case '{request.load_case}' at {3.6 * request.speed_m_s:g} km/h"
    if not (np.isfinite(static_N).all() and (static_N > 0.0).all()):
        axle = int(np.argmin(np.where(np.isfinite(static_N), static_N, -np.inf))) + 1
        raise DataRejectedError(f"{name} cannot be predicted: axle {axle} carries no load at rest; check the scales.")
    bad = np.zeros(sets.shape[1], bool)
    for history in histories:
        # A sum is not finite where a value is not, and takes no second array of this size.
        with np.errstate(invalid="ignore", over="ignore"):
            total = history.sum()
        if not np.isfinite(total):
            bad |= ~np.isfinite(history).all(axis=(0, 1))
    if not bad.any():
        return
    count = f"{int(bad.sum())} of {bad.size} parameter sets" if bad.size > 1 else "the fitted parameters"
    raise DataRejectedError(
        f"{name} gives no finite axle loads with {count}; likely cause: {_cause(parameters, sets[:, bad])}; look at "
        "the fit and its priors and fit again."
    )


def _cause(parameters: ParameterSet, sets: np.ndarray) -> str:
    missing = np.flatnonzero(~np.isfinite(sets).all(axis=1))
    if missing.size:
        return f"{parameters.names[missing[0]]} is not a number"
    known = parameters.parameters
    away = np.array([np.abs(sets[i] - np.log(p.prior_median)).max() / p.prior_sd for i, p in enumerate(known)])
    worst = int(np.argmax(away))
    log_value = sets[worst, int(np.argmax(np.abs(sets[worst] - np.log(known[worst].prior_median))))]
    with np.errstate(over="ignore"):
        value = np.exp(log_value)
    return (
        f"{known[worst].name} = {value:.3g} {known[worst].unit}, {away[worst]:.1f} standard deviations from its prior "
        f"median {known[worst].prior_median:.3g}"
    )
