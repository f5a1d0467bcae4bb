"""Tables of the user's own priors: of one axle, and of any parameter by its name."""

import math
from typing import Annotated, Self

from pydantic import Field, model_validator

from sysid.campaign.toml.schema_fields import Positive, Table
from sysid.display import Z90


class PriorTable(Table):
    """One prior: median in the unit of its key and multiplicative standard deviation."""

    median: Positive
    log_sd: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=20.0)]


class PriorsTable(Table):
    """priors = {...}: the user's own priors of one axle."""

    stiffness_N_per_m: PriorTable | None = None
    damping_N_s_per_m: PriorTable | None = None
    tire_stiffness_N_per_m: PriorTable | None = None
    tire_damping_N_s_per_m: PriorTable | None = None


Interval = Annotated[list[Positive], Field(min_length=2, max_length=2)]
#: Units of parameters by what their key ends in.
PRIOR_UNITS = {"": "1", "N_per_m": "N/m", "N_s_per_m": "N s/m", "N": "N", "m": "m", "m_per_s": "m/s", "Hz": "Hz"}


class NamedPriorTable(Table):
    """One entry of [priors]: a median with `log_sd`, or a 90 % interval, in the unit of the key."""

    median: Positive | None = None
    median_N_per_m: Positive | None = None
    median_N_s_per_m: Positive | None = None
    median_N: Positive | None = None
    median_m: Positive | None = None
    median_m_per_s: Positive | None = None
    median_Hz: Positive | None = None
    interval90: Interval | None = None
    interval90_N_per_m: Interval | None = None
    interval90_N_s_per_m: Interval | None = None
    interval90_N: Interval | None = None
    interval90_m: Interval | None = None
    interval90_m_per_s: Interval | None = None
    interval90_Hz: Interval | None = None
    log_sd: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=20.0)] | None = None

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        given = [name for name in type(self).model_fields if getattr(self, name) is not None and name != "log_sd"]
        if len(given) != 1:
            raise ValueError("needs either a median with log_sd or a 90 % interval, once; for example median_N_per_m")
        (name,) = given
        if name.startswith("median") and self.log_sd is None:
            raise ValueError(f"has {name} without log_sd; add it, 0.2 means about 20 %")
        if name.startswith("interval"):
            if self.log_sd is not None:
                raise ValueError(f"has both {name} and log_sd; the interval says how wide the prior is")
            low, high = getattr(self, name)
            if not low < high:
                raise ValueError(f"has {name} = [{low:g}, {high:g}]; give the lower end first")
        return self

    def lognormal(self) -> tuple[float, float, str]:
        """Median, standard deviation of the logarithm, and unit."""
        (name,) = [n for n in type(self).model_fields if getattr(self, n) is not None and n != "log_sd"]
        kind, _, unit = name.partition("_")
        if kind == "median":
            return getattr(self, name), float(self.log_sd or 0.0), PRIOR_UNITS[unit]
        low, high = getattr(self, name)
        return math.sqrt(low * high), math.log(high / low) / (2.0 * Z90), PRIOR_UNITS[unit]
