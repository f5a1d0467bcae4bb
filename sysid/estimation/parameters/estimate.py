"""Result of a fit for one parameter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sysid.tabular import Tabular, records_table

if TYPE_CHECKING:
    import pandas as pd

_COLUMNS = (
    "name",
    "axle",
    "quantity",
    "load_case",
    "unit",
    "value",
    "sd",
    "start",
    "prior_median",
    "prior_sd",
    "identified",
)


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


class ParameterEstimates(tuple[ParameterEstimate, ...], Tabular):
    """Estimates one behind the other, which show themselves as a table."""

    __slots__ = ()
    _in_row_unit = ("value", "sd", "start", "prior_median")

    def summary(self) -> pd.DataFrame:
        """One row per parameter, in SI units."""
        return records_table(self, _COLUMNS)

    def to_pandas(self) -> pd.DataFrame:
        """The same with the run and the law of each."""
        return records_table(self, ("run", "law", *_COLUMNS))
