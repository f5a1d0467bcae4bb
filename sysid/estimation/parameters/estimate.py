"""Result of a fit for one parameter."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ParameterEstimate:
    """One parameter: what it is, and what least squares found.

    `name` like ``k_1`` or ``k_2[loaded]``; `quantity` ``stiffness``, ``damping``, ``tire_stiffness``, ...; `axle` is
    the axle index or None; `load_case` None means shared; `run` is the file of a run-local parameter or None. `value`
    in `unit`; `sd` its standard deviation; `prior_median`, `prior_log_sd` describe the prior. `identified` is False if
    the data add almost nothing to the prior.
    """

    name: str
    quantity: str
    unit: str
    axle: int | None
    load_case: str | None
    run: str | None
    law: str
    transform: str
    value: float
    sd: float
    start: float
    prior_median: float
    prior_sd: float
    identified: bool
