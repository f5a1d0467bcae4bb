"""The campaign file, schema 1: every key with its type and range; unknown keys are errors."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StrictBool, StrictStr, model_validator

from sysid.campaign.units import unit_names
from sysid.campaign.wording import nearest

NAME_LENGTH = 200
TEXT_LENGTH = 20_000


def _length_unit(unit: str) -> str:
    if unit.strip() not in unit_names("length"):
        raise ValueError(f"is '{unit}', which is not a unit of length; {nearest(unit, unit_names('length'))}")
    return unit.strip()


# Bounds are far outside anything a road vehicle has: they catch slipped decimals and NaN, they do not judge.
Position = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-200.0, le=200.0)]
Length = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=200.0)]
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
LengthUnit = Annotated[StrictStr, Field(max_length=40), AfterValidator(_length_unit)]


class Table(BaseModel):
    """A table of the campaign file: no other keys than its own."""

    model_config = ConfigDict(extra="forbid", frozen=True, protected_namespaces=())


class CampaignTable(Table):
    """[campaign]: what the campaign is called."""

    title: Annotated[StrictStr, Field(min_length=1, max_length=TEXT_LENGTH)]
    notes: Annotated[StrictStr, Field(max_length=TEXT_LENGTH)] = ""


class BodyTable(Table):
    """[[vehicle.body]]: one rigid sprung body."""

    name: Name
    hitch_x_m: Position | None = None
    hitch_height_m: Height | None = None

    @model_validator(mode="after")
    def _height_needs_hitch(self) -> BodyTable:
        if self.hitch_height_m is not None and self.hitch_x_m is None:
            raise ValueError("has hitch_height_m without hitch_x_m; give both or neither")
        return self


class LeafTable(Table):
    """leaf = {...}: one leaf pack, one side."""

    leaves: Annotated[int, Field(strict=True, ge=1, le=100)]
    width_m: Length
    thickness_m: Length
    length_m: Length


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
PRIOR_UNITS = {"": "1", "N_per_m": "N/m", "N_s_per_m": "N s/m", "N": "N", "m": "m", "m_per_s": "m/s"}


class NamedPriorTable(Table):
    """One entry of [priors]: a median with `log_sd`, or a 90 % interval, in the unit of the key."""

    median: Positive | None = None
    median_N_per_m: Positive | None = None
    median_N_s_per_m: Positive | None = None
    median_N: Positive | None = None
    median_m: Positive | None = None
    median_m_per_s: Positive | None = None
    interval90: Interval | None = None
    interval90_N_per_m: Interval | None = None
    interval90_N_s_per_m: Interval | None = None
    interval90_N: Interval | None = None
    interval90_m: Interval | None = None
    interval90_m_per_s: Interval | None = None
    log_sd: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=20.0)] | None = None

    @model_validator(mode="after")
    def _one_way(self) -> NamedPriorTable:
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
        # The normal distribution has 90 % within 1.645 standard deviations.
        return math.sqrt(low * high), math.log(high / low) / (2.0 * 1.6448536269514722), PRIOR_UNITS[unit]


Curve = Annotated[list[Annotated[float, Field(strict=True, allow_inf_nan=False)]], Field(min_length=2, max_length=40)]


def _check_curve(positions: list[float], forces: list[float], what: str, name: str) -> None:
    if len(positions) != len(forces):
        raise ValueError(f"has {len(positions)} values of {what} and {len(forces)} of force_N; give pairs")
    if any(b <= a for a, b in pairwise(positions)):
        raise ValueError(f"has values of {what} that do not increase; sort the {name}")
    if any(b < a for a, b in pairwise(forces)):
        raise ValueError(f"has a force_N that falls with {what}; positive force pulls axle and body together")
    if not positions[0] < 0.0 < positions[-1]:
        raise ValueError(f"does not reach to both sides of {what} = 0, static rest; extend the {name}")
    at_rest = float(np.interp(0.0, positions, forces))
    if abs(at_rest) > 1e-3 * max(abs(f) for f in forces):
        raise ValueError(f"gives {at_rest:g} N at {what} = 0; subtract the force at static rest from force_N")


class SpringTable(Table):
    """spring_table = {...}: force (positive pulls axle and body together) against extension
    from static rest in the first load case."""

    extension_m: Curve
    force_N: Curve

    @model_validator(mode="after")
    def _curve(self) -> SpringTable:
        _check_curve(self.extension_m, self.force_N, "extension_m", "spring table")
        return self


class DamperTable(Table):
    """damper_table = {...}: force against the rate of extension, rebound positive."""

    rate_m_s: Curve
    force_N: Curve

    @model_validator(mode="after")
    def _curve(self) -> DamperTable:
        _check_curve(self.rate_m_s, self.force_N, "rate_m_s", "damper table")
        return self


class AxleTable(Table):
    """[[vehicle.axle]]: one axle, both sides and all its tires together."""

    name: Name
    body: Name
    x_m: Position
    unsprung_mass_kg: OptionalMass
    tire_stiffness_N_per_m: Positive
    tire_damping_N_s_per_m: NotNegative
    tire_radius_m: Length
    suspension: Literal["leaf", "air", "other"]
    suspension_law: Annotated[StrictStr, Field(min_length=1, max_length=200)] | None = None
    spring_table: SpringTable | None = None
    damper_table: DamperTable | None = None
    hanger_lash_m: Length | None = None
    load_dependent: StrictBool | None = None
    inflation_pressure_kPa: Positive | None = None
    tire_stiffness_pressure_kPa: Positive | None = None
    jounce_travel_m: Length | None = None
    rebound_travel_m: Length | None = None
    leaf: LeafTable | None = None
    priors: PriorsTable | None = None


class GroupTable(Table):
    """[[vehicle.group]]: axles on a common beam."""

    name: Name
    axles: Annotated[list[Name], Field(min_length=1, max_length=20)]
    mass_kg: OptionalMass
    pitch_inertia_kg_m2: NotNegative


Tolerance = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0, le=0.5)]


class TolerancesTable(Table):
    """tolerances = {...}: relative standard deviations of declared mass properties, 0 for exact ones."""

    unsprung_mass: Tolerance = 0.03
    pitch_inertia: Tolerance = 0.05
    cg_height: Tolerance = 0.03
    hitch_height: Tolerance = 0.03


class VehicleTable(Table):
    """[vehicle]: bodies and axles, front to rear."""

    name: Name
    wheelbase_m: Length | None = None
    gravity_m_s2: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=9.0, le=10.0)] = 9.81
    tolerances: TolerancesTable = TolerancesTable()
    body: Annotated[list[BodyTable], Field(min_length=1, max_length=20)]
    axle: Annotated[list[AxleTable], Field(min_length=1, max_length=40)]
    group: Annotated[list[GroupTable], Field(max_length=40)] = []


class LoadCaseTable(Table):
    """[load_case.NAME]: scale readings and mass properties."""

    cargo_mass_kg: OptionalMass | None = None
    axle_loads_kg: Annotated[list[Mass], Field(min_length=1, max_length=40)]
    sprung_mass_kg: Annotated[list[Mass], Field(min_length=1, max_length=20)]
    pitch_inertia_kg_m2: Annotated[list[Inertia], Field(min_length=1, max_length=20)]
    cg_height_m: Annotated[list[Height], Field(min_length=1, max_length=20)]


class FilterTable(Table):
    """filter = {...}: analogue anti-alias low-pass in front of every channel."""

    type: Literal["butterworth", "bessel"]
    order: Annotated[int, Field(strict=True, ge=1, le=12)]
    cutoff_hz: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=1e6)]


class AcquisitionTable(Table):
    """[acquisition]: sample interval and filter."""

    sample_interval_s: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=1e-6, le=10.0)]
    filter: FilterTable | None = None


class _SensorTable(Table):
    kind: Literal["suspension_deflection", "axle_acceleration", "body_acceleration"]
    unit: SensorUnit
    range: Positive | None = None
    side: Literal["left", "right"] | None = None

    @model_validator(mode="after")
    def _unit_of_kind(self):
        dimension: Literal["length", "acceleration"] = (
            "length" if self.kind == "suspension_deflection" else "acceleration"
        )
        if self.unit.strip() not in unit_names(dimension):
            raise ValueError(
                f"has the unit '{self.unit}', which is not a unit of {dimension}; "
                f"{nearest(self.unit, unit_names(dimension))}"
            )
        return self


class RunSensorTable(_SensorTable):
    """[sensors.bump_run]: column = { kind, axle or body and x_m, unit, range, side }."""

    axle: Name | None = None
    body: Name | None = None
    x_m: Position | None = None

    @model_validator(mode="after")
    def _place_of_kind(self) -> RunSensorTable:
        if self.kind == "body_acceleration":
            if self.body is None or self.x_m is None:
                raise ValueError("measures body_acceleration; give its body and x_m")
            if self.axle is not None:
                raise ValueError("measures body_acceleration; give body and x_m instead of axle")
        elif self.axle is None:
            raise ValueError(f"measures {self.kind}; give the name of its axle")
        elif self.body is not None or self.x_m is not None:
            raise ValueError(f"measures {self.kind}; its axle says where it is, leave out body and x_m")
        return self


class DropSensorTable(_SensorTable):
    """[sensors.plank_drop]: column = { kind, unit, range, side }, mounted at the axle under test."""


class SensorsTable(Table):
    """[sensors]: columns of bump-run and plank-drop logs."""

    bump_run: dict[Name, RunSensorTable] = {}
    plank_drop: dict[Name, DropSensorTable] = {}


class ScanTable(Table):
    """[scan] or [scan.NAME]: laser scan of one bump."""

    file: PathText
    heading_deg: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-360.0, le=360.0)]
    unit: LengthUnit = "m"


class PlankDropTable(Table):
    """One entry of tests.plank_drop."""

    axle: Name
    file: PathText
    plank_height_m: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=1.0)]
    load_case: Name | None = None
    nominal_speed_km_h: SpeedKmH | None = None
    dampers: StrictBool = True
    towed: StrictBool | None = None
    engine_off: StrictBool | None = None


class BumpRunTable(Table):
    """One entry of tests.bump_run."""

    case: Name
    file: PathText
    load_case: Name
    nominal_speed_km_h: SpeedKmH
    repeat: Annotated[int, Field(strict=True, ge=1, le=10_000)] = 1
    bump: Name | None = None
    speed_held: Literal["servo", "towed", "cruise", "free"] = "servo"


class ShapeTable(Table):
    """shape = {...}: a bump by name and size, or by points along the road."""

    name: Literal["watts", "sinusoidal", "half_sine", "parabolic", "trapezoid", "points"]
    height_m: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.001, le=1.0)] | None = None
    length_m: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.01, le=100.0)] | None = None
    top_m: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0, le=100.0)] | None = None
    station_m: Annotated[list[Position], Field(max_length=100_000)] = []
    heights_m: Annotated[list[Position], Field(max_length=100_000)] = []

    @model_validator(mode="after")
    def _size_of_shape(self) -> ShapeTable:
        sized = self.height_m is not None and self.length_m is not None
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
        return self


class PredictionTable(Table):
    """One entry of tests.prediction."""

    load_case: Name
    speed_km_h: SpeedKmH
    bump: Name | None = None
    shape: ShapeTable | None = None

    @model_validator(mode="after")
    def _one_bump(self) -> PredictionTable:
        if self.bump is not None and self.shape is not None:
            raise ValueError("has both bump and shape; a pass crosses one of them")
        return self


class TestsTable(Table):
    """[tests]: plank drops, bump runs and requested predictions."""

    plank_drop: Annotated[list[PlankDropTable], Field(max_length=10_000)] = []
    bump_run: Annotated[list[BumpRunTable], Field(max_length=10_000)] = []
    prediction: Annotated[list[PredictionTable], Field(max_length=1000)] = []


class CampaignFile(Table):
    """The whole campaign file; `[scan]` is turned into one named scan before validation."""

    schema_version: Annotated[Literal[1], Field(alias="schema")]
    campaign: CampaignTable
    vehicle: VehicleTable
    load_case: Annotated[dict[Name, LoadCaseTable], Field(min_length=1, max_length=100)]
    acquisition: AcquisitionTable
    sensors: SensorsTable
    scan: Annotated[dict[Name, ScanTable], Field(max_length=100)] = {}
    tests: TestsTable = TestsTable()
    priors: Annotated[dict[Name, NamedPriorTable], Field(max_length=1000)] = {}
