"""Types of the entries of a campaign file, and what all of its tables share."""

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StrictStr

from sysid.campaign.units import unit_names
from sysid.wording import nearest

#: Characters of a name, which stands in messages and tables, and of a title or notes.
NAME_LENGTH = 200
TEXT_LENGTH = 20_000


def _length_unit(unit: str) -> str:
    if unit.strip() not in unit_names("length"):
        raise ValueError(f"is '{unit}', which is not a unit of length; {nearest(unit, unit_names('length'))}")
    return unit.strip()


def _log_format(name: str) -> str:
    from sysid.logs.registry import FORMATS

    known = [log_format.name for log_format in FORMATS]
    if name not in known:
        raise ValueError(f"is '{name}', which is no format of a log; {nearest(name, known)}")
    return name


# Bounds are far outside anything a road vehicle has: they catch slipped decimals and NaN, they do not judge.
Position = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-200.0, le=200.0)]
Length = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=200.0)]
Radius = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=2.5)]
Travel = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=2.0)]
Height = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0, le=20.0)]
Mass = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=1e7)]
OptionalMass = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0, le=1e7)]
Inertia = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=1e10)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=1e12)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0, le=1e12)]
SpeedKmH = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=300.0)]
Name = Annotated[StrictStr, Field(min_length=1, max_length=NAME_LENGTH)]
PathText = Annotated[StrictStr, Field(min_length=1, max_length=4096)]
SensorUnit = Annotated[StrictStr, Field(max_length=40)]
LogFormatName = Annotated[StrictStr, Field(max_length=40), AfterValidator(_log_format)]
LengthUnit = Annotated[StrictStr, Field(max_length=40), AfterValidator(_length_unit)]


class Table(BaseModel):
    """A table of the campaign file: no other keys than its own."""

    # One validator for the whole file, built when it is read, instead of one for every table: a quarter of the time of
    # a slip.
    model_config = ConfigDict(extra="forbid", frozen=True, protected_namespaces=(), defer_build=True)
