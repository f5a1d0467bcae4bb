"""The campaign file, schema 1: every key with its type and range; unknown keys are errors."""

import datetime
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, StrictBool, StrictStr, model_validator

from sysid import limits
from sysid.campaign.bump_shapes import BumpShape
from sysid.campaign.requests import shape_fault
from sysid.campaign.roads import RoadClass
from sysid.campaign.sensor_kinds import KIND_DIMENSION, DeclaredKind
from sysid.campaign.toml.schema_bridge import BridgeTable
from sysid.campaign.toml.schema_fields import (
    TEXT_LENGTH,
    LengthUnit,
    Name,
    PathText,
    Position,
    Positive,
    SensorUnit,
    SpeedKmH,
    Table,
)
from sysid.campaign.toml.schema_loggers import LOGGERS, LoggerTable, LogTable
from sysid.campaign.toml.schema_priors import NamedPriorTable
from sysid.campaign.toml.schema_vehicle import LoadCaseTable, VehicleTable
from sysid.campaign.units import unit_names
from sysid.wording import nearest


def _date(value: Any) -> Any:
    if isinstance(value, datetime.datetime):
        return value.date()
    if isinstance(value, str):
        try:
            return datetime.date.fromisoformat(value.strip())
        except ValueError:
            pass
    if not isinstance(value, datetime.date | None):
        raise ValueError("is no date; write it as 2026-05-31, without quotes")
    return value


class CampaignTable(Table):
    """[campaign]: what the campaign is called, and when, where, by whom and on which vehicle it was driven."""

    title: Annotated[StrictStr, Field(min_length=1, max_length=TEXT_LENGTH)]
    notes: Annotated[StrictStr, Field(max_length=TEXT_LENGTH)] = ""
    date: Annotated[datetime.date | None, BeforeValidator(_date)] = None
    place: Name | None = None
    operator: Name | None = None
    scale: Name | None = None
    vehicle_id: Name | None = None
    synthetic: StrictBool = False


class FilterTable(Table):
    """filter = {...}: analogue anti-alias low-pass in front of every channel."""

    type: Literal["butterworth", "bessel"]
    order: Annotated[int, Field(strict=True, ge=1, le=12)]
    cutoff_hz: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=1e6)]


class AcquisitionTable(LogTable):
    """[acquisition]: sample interval and filter, and how logs are written."""

    sample_interval_s: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=1e-6, le=10.0)]
    filter: FilterTable | None = None


class _SensorTable(Table):
    kind: DeclaredKind | None = None
    unit: SensorUnit | None = None
    range: Positive | None = None
    side: Literal["left", "right"] | None = None
    y_m: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-3.0, le=3.0)] | None = None
    sign: Literal[1, -1] = 1
    scale: Positive = 1.0
    area_m2: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=2.0)] | None = None
    unused: Annotated[StrictStr, Field(min_length=1, max_length=TEXT_LENGTH)] | None = None

    @model_validator(mode="after")
    def _kind_and_unit(self) -> Self:
        if self.unused is not None:
            return self
        if self.kind is None:
            raise ValueError("has no kind; give kind and unit, or unused = 'the reason'")
        if self.unit is None:
            raise ValueError("has no unit; give the unit of its readings")
        if self.y_m is not None and self.side is not None and (self.y_m > 0.0) != (self.side == "left"):
            raise ValueError(
                f"is on the {self.side} side, but has y_m = {self.y_m:g}; y_m is positive to the left of the middle"
            )
        if self.area_m2 is not None and self.kind != "air_pressure":
            raise ValueError(f"measures {self.kind}; area_m2 belongs to air_pressure, leave it out")
        dimension = KIND_DIMENSION[self.kind]
        if self.unit.strip() not in unit_names(dimension):
            raise ValueError(
                f"has the unit '{self.unit}', which is not a unit of {dimension}; "
                f"{nearest(self.unit, unit_names(dimension))}"
            )
        return self


class RunSensorTable(_SensorTable):
    """[sensors.bump_run]: column = { kind, axle, or body and x_m, unit, range, side, sign, scale, ... }."""

    axle: Name | None = None
    body: Name | None = None
    x_m: Position | None = None
    logger: Name | None = None
    column: Name | None = None

    @model_validator(mode="after")
    def _place_of_kind(self) -> Self:
        if self.unused is not None:
            return self
        if self.kind == "speed":
            if not (self.axle is None and self.body is None and self.x_m is None):
                raise ValueError("measures speed, which is that of the truck; leave out axle, body and x_m")
        elif self.kind == "pitch_rate":
            if self.body is None:
                raise ValueError("measures pitch_rate; give the name of its body")
            if self.axle is not None:
                raise ValueError("measures pitch_rate; give its body instead of axle")
        elif self.kind == "body_acceleration":
            at_place = self.body is not None and self.x_m is not None
            if self.axle is None and not at_place:
                raise ValueError("measures body_acceleration; give the axle above which it sits, or its body and x_m")
            if self.axle is not None and (self.body is not None or self.x_m is not None):
                raise ValueError("measures body_acceleration; give the axle above which it sits, or body and x_m")
        elif self.axle is None:
            raise ValueError(f"measures {self.kind}; give the name of its axle")
        elif self.body is not None or self.x_m is not None:
            raise ValueError(f"measures {self.kind}; its axle says where it is, leave out body and x_m")
        return self


class DropSensorTable(_SensorTable):
    """[sensors.plank_drop]: column = { kind, unit, range, sign, scale, axle, ... }; else at the axle under test."""

    axle: Name | None = None


class SensorsTable(Table):
    """[sensors]: columns of bump-run and plank-drop logs."""

    bump_run: Annotated[dict[Name, RunSensorTable], Field(max_length=limits.SENSORS)] = {}
    plank_drop: Annotated[dict[Name, DropSensorTable], Field(max_length=limits.SENSORS)] = {}


class ScanTable(Table):
    """[scan] or [scan.NAME]: laser scan of one bump, or its profile measured along the road."""

    file: PathText | None = None
    heading_deg: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-360.0, le=360.0)] | None = None
    heading_within_deg: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0, le=10.0)] = 0.5
    lateral_m: Position = 0.0
    unit: LengthUnit = "m"
    profile: PathText | None = None

    @model_validator(mode="after")
    def _cloud_or_profile(self) -> Self:
        if self.profile is not None:
            if self.model_fields_set - {"profile"}:
                raise ValueError(
                    "has a profile; leave out file, heading_deg, heading_within_deg, lateral_m and unit, which belong "
                    "to a point cloud"
                )
        elif self.file is None:
            raise ValueError("has no file; give the point cloud as file, or heights along the road as profile")
        elif self.heading_deg is None:
            raise ValueError("has no heading_deg; give the direction of travel in the scanner's x-y plane")
        return self


class PlankDropTable(LogTable):
    """One entry of tests.plank_drop: an axle off a plank, or a body that was lifted above one or more axles."""

    axle: Name | None = None
    axles: Annotated[list[Name], Field(max_length=100)] = []
    file: PathText
    release: Literal["plank", "body"] = "plank"
    plank_height_m: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=1.0)] | None = None
    load_case: Name | None = None
    nominal_speed_km_h: SpeedKmH | None = None
    dampers: StrictBool = True
    towed: StrictBool | None = None
    engine_off: StrictBool | None = None

    @model_validator(mode="after")
    def _keys_of_release(self) -> Self:
        if (self.axle is None) == (not self.axles):
            raise ValueError("needs its axle; give axle, or axles where a body was lifted above several")
        if len(set(self.axles)) < len(self.axles):
            raise ValueError("names an axle twice in axles; name each once")
        if self.release == "plank":
            if self.axles:
                raise ValueError("has several axles on the plank; give one axle, or release = 'body' for a lifted body")
            if self.plank_height_m is None:
                raise ValueError("has no plank_height_m; give it, or release = 'body' for a body that was let go")
        elif self.plank_height_m is not None or self.nominal_speed_km_h is not None:
            raise ValueError("lets a body go; leave out plank_height_m and nominal_speed_km_h, which belong to a plank")
        return self


class BumpRunTable(LogTable):
    """One entry of tests.bump_run."""

    case: Name
    file: PathText | None = None
    files: Annotated[dict[Name, PathText], Field(max_length=LOGGERS)] = {}
    load_case: Name
    nominal_speed_km_h: SpeedKmH | None = None
    repeat: Annotated[int, Field(strict=True, ge=1, le=10_000)] = 1
    bump: Name | None = None
    speed_held: Literal["servo", "towed", "cruise", "free"] = "servo"
    speed_change_sd: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0, le=0.5)] = 0.02

    @model_validator(mode="after")
    def _one_or_several(self) -> Self:
        if (self.file is None) == (not self.files):
            raise ValueError("needs its log; give file, or files with one log per logger")
        return self


class RoadDriveTable(LogTable):
    """One entry of tests.road_drive: a drive over an ordinary road, with the sensors of the bump runs."""

    file: PathText
    load_case: Name
    nominal_speed_km_h: SpeedKmH | None = None
    speed_held: Literal["servo", "towed", "cruise", "free"] = "servo"


class ShapeTable(Table):
    """shape = {...}: a bump by name and size, by points along the road, or from a file."""

    name: Literal["watts", "sinusoidal", "half_sine", "parabolic", "trapezoid", "points", "file"]
    height_m: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.001, le=1.0)] | None = None
    length_m: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.01, le=100.0)] | None = None
    top_m: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0, le=100.0)] | None = None
    station_m: Annotated[list[Position], Field(max_length=100_000)] = []
    heights_m: Annotated[list[Position], Field(max_length=100_000)] = []
    file: PathText | None = None
    lateral_m: Position | None = None

    @model_validator(mode="after")
    def _size_of_shape(self) -> Self:
        sized = self.height_m is not None and self.length_m is not None
        if self.name == "file":
            others = self.model_fields_set - {"name", "file", "lateral_m"}
            if self.file is None or others:
                raise ValueError(
                    "comes from a file; give file, lateral_m for an OpenCRG surface, and no size or points"
                )
            return self
        if self.file is not None or self.lateral_m is not None:
            raise ValueError(f"is a {self.name} bump; file and lateral_m belong to name = 'file'")
        if self.name == "points":
            if self.height_m is not None or self.length_m is not None or len(self.station_m) < 3:
                raise ValueError("is given by points; give station_m and heights_m, three or more, and no other size")
            if len(self.station_m) != len(self.heights_m):
                raise ValueError(
                    f"has {len(self.station_m)} values in station_m and {len(self.heights_m)} in heights_m; "
                    "give equally many"
                )
        elif not sized or self.station_m or self.heights_m:
            raise ValueError(f"is a {self.name} bump; give its height_m and length_m, and no points")
        if self.top_m is not None and self.name != "trapezoid":
            raise ValueError(f"is a {self.name} bump; only a trapezoid has a top_m, leave it out")
        if fault := shape_fault(self.bump()):
            raise ValueError(fault)
        return self

    def bump(self) -> BumpShape:
        """The bump by name and size, or by points; none from a file."""
        assert self.name != "file"
        points = tuple(self.station_m), tuple(self.heights_m)
        return BumpShape(self.name, self.height_m, self.length_m, self.top_m, *points)


class RoadTable(Table):
    """road = {...}: a rough road of a class by ISO 8608, a measured one, or several one behind the other."""

    roughness: RoadClass | None = Field(default=None, alias="class")
    length_m: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=limits.ROAD_LENGTH_M)] | None = None
    seed: Annotated[int, Field(strict=True, ge=0)] = 0
    realisations: Annotated[int, Field(strict=True, ge=1, le=limits.ROAD_REALISATIONS)] = 1
    file: PathText | None = None
    lateral_m: Position | None = None
    parts: Annotated[list["RoadTable"], Field(max_length=20)] = []
    shape: ShapeTable | None = None
    at_m: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0, le=limits.ROAD_LENGTH_M)] | None = None
    sunken: bool = False
    stress_exponent: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=1.0, le=12.0)] = 4.0

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        given = [self.roughness is not None, self.file is not None, bool(self.parts)]
        if sum(given) != 1:
            raise ValueError("is of a class, from a file or of parts; give one of class, file and parts")
        if self.file is not None and self.model_fields_set & {"seed", "realisations"}:
            raise ValueError("comes from a file; seed and realisations belong to a class")
        if self.roughness is not None and (self.lateral_m is not None or self.length_m is None):
            raise ValueError("is of a class; give length_m, and lateral_m for a file only")
        if self.parts and self.model_fields_set & {"length_m", "seed", "lateral_m"}:
            raise ValueError("is of parts; length_m, seed and lateral_m belong to each of them")
        inner = {"parts", "shape", "at_m", "sunken", "realisations", "stress_exponent"}
        if wrong := next((sorted(p.model_fields_set & inner) for p in self.parts if p.model_fields_set & inner), None):
            raise ValueError(f"has {wrong[0]} in one of its parts; it belongs to the whole road")
        if (self.shape is None) != (self.at_m is None) or (self.sunken and self.shape is None):
            raise ValueError("has a bump or a hole; give its shape and at_m, the station where it begins")
        return self


class PredictionTable(Table):
    """One entry of tests.prediction."""

    load_case: Name
    speed_km_h: SpeedKmH
    bump: Name | None = None
    shape: ShapeTable | None = None
    road: RoadTable | None = None
    bridge: Name | None = None
    vehicles: Annotated[int, Field(strict=True, ge=1, le=limits.BRIDGE_VEHICLES)] = 1
    gap_m: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=1000.0)] = 10.0

    @model_validator(mode="after")
    def _one_bump(self) -> Self:
        given = [name for name in ("bump", "shape", "road", "bridge") if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(f"has both {given[0]} and {given[1]}; a pass goes over one of them")
        if self.bridge is None and self.model_fields_set & {"vehicles", "gap_m"}:
            raise ValueError("has vehicles or gap_m, which belong to a bridge; name it as bridge")
        return self


class TestsTable(Table):
    """[tests]: drops, bump runs, road drives, predictions; `plank_height_m` and `load_case` where they have no own."""

    plank_height_m: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=1.0)] | None = None
    load_case: Name | None = None
    plank_drop: Annotated[list[PlankDropTable], Field(max_length=10_000)] = []
    bump_run: Annotated[list[BumpRunTable], Field(max_length=10_000)] = []
    road_drive: Annotated[list[RoadDriveTable], Field(max_length=10_000)] = []
    prediction: Annotated[list[PredictionTable], Field(max_length=1000)] = []

    @model_validator(mode="before")
    @classmethod
    def _common_values(cls, tables: Any) -> Any:
        if not isinstance(tables, dict):
            return tables
        common = {key: tables[key] for key in ("plank_height_m", "load_case") if key in tables}
        kinds = ("plank_drop", "bump_run", "road_drive")
        of_kinds = {kind: tables[kind] for kind in kinds if isinstance(tables.get(kind), list)}
        return {**tables, **{kind: [_with_common(e, kind, common) for e in of] for kind, of in of_kinds.items()}}


def _with_common(entry: Any, kind: str, common: dict[str, Any]) -> Any:
    """A drop or run with the values of all that do not say their own."""
    if not isinstance(entry, dict):
        return entry
    on_plank = kind == "plank_drop" and entry.get("release", "plank") == "plank"
    return {k: v for k, v in common.items() if k != "plank_height_m" or on_plank} | entry


class CampaignFile(Table):
    """The whole campaign file; `[scan]` is turned into one named scan before validation."""

    schema_version: Annotated[Literal[1], Field(alias="schema")]
    campaign: CampaignTable
    vehicle: VehicleTable
    load_case: Annotated[dict[Name, LoadCaseTable], Field(min_length=1, max_length=100)]
    acquisition: AcquisitionTable
    logger: Annotated[list[LoggerTable], Field(max_length=LOGGERS)] = []
    sensors: SensorsTable
    scan: Annotated[dict[Name, ScanTable], Field(max_length=100)] = {}
    bridge: Annotated[dict[Name, BridgeTable], Field(max_length=100)] = {}
    tests: TestsTable = Field(default_factory=TestsTable)
    priors: Annotated[dict[Name, NamedPriorTable], Field(max_length=1000)] = {}
