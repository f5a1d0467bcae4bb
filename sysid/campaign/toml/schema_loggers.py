"""Tables of how logs are written, and of loggers with a clock of their own."""

from typing import Annotated, Literal

from pydantic import Field, StrictBool

from sysid.campaign.toml.schema_fields import LogFormatName, Name, PathText, Table

#: Loggers of one campaign.
LOGGERS = 20


class LogTable(Table):
    """How logs are written; what a test says counts before what [acquisition] says for all."""

    time: Name | None = None
    units_row: StrictBool | None = None
    format: LogFormatName | None = None
    can_database: PathText | None = None


class LoggerTable(LogTable):
    """One [[logger]]; the clock of the first one is the reference."""

    name: Name
    clock: Literal["per_log", "continuous", "shared"] = "per_log"
    offset_s: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e10, le=1e10)] = 0.0
    offset_within_s: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=3600.0)] = 10.0
    rate_ppm: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1000.0, le=1000.0)] = 0.0
    rate_within_ppm: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=1000.0)] = 300.0
    sync: Name | None = None
    sample_interval_s: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=1e-6, le=10.0)] | None = None
