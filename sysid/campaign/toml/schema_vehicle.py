"""Tables of the vehicle and of its load cases."""

from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import Field, StrictBool, StrictStr, model_validator

from sysid.campaign.toml.schema_fields import (
    Height,
    Inertia,
    Length,
    Mass,
    Name,
    NotNegative,
    OptionalMass,
    Position,
    Positive,
    Radius,
    Table,
    Travel,
)
from sysid.campaign.toml.schema_priors import PriorsTable
from sysid.campaign.vehicle_records import DrivenAt


class FrameShapeTable(Table):
    """shape = {...}: points of the shape in which a frame bends, from its front end to its rear end."""

    x_m: Annotated[list[Position], Field(min_length=4, max_length=40)]
    rise: Annotated[list[Annotated[float, Field(strict=True, allow_inf_nan=False)]], Field(min_length=4, max_length=40)]

    @model_validator(mode="after")
    def _points(self) -> Self:
        if len(self.x_m) != len(self.rise):
            raise ValueError(f"has {len(self.x_m)} values of x_m and {len(self.rise)} of rise; give pairs")
        if any(b <= a for a, b in pairwise(self.x_m)):
            raise ValueError("has values of x_m that do not increase; sort the points front to rear")
        import numpy as np

        straight = np.polyval(np.polyfit(self.x_m, self.rise, 1), self.x_m)
        if np.ptp(np.array(self.rise) - straight) < 1e-6 * max(1.0, np.ptp(self.rise)):
            raise ValueError("is a straight line; give the shape in which the frame bends")
        return self


class BendingTable(Table):
    """bending = {...}: first bending mode of a free frame."""

    frequency_hz: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=1.0, le=50.0)]
    damping_ratio: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, lt=1.0)] = 0.025
    shape: FrameShapeTable | None = None


class BodyTable(Table):
    """[[vehicle.body]]: one sprung body."""

    name: Name
    hitch_x_m: Position | None = None
    hitch_height_m: Height | None = None
    bending: BendingTable | None = None

    @model_validator(mode="after")
    def _height_needs_hitch(self) -> Self:
        if self.hitch_height_m is not None and self.hitch_x_m is None:
            raise ValueError("has hitch_height_m without hitch_x_m; give both or neither")
        return self


class LeafTable(Table):
    """leaf = {...}: one leaf pack, one side."""

    leaves: Annotated[int, Field(strict=True, ge=1, le=100)]
    width_m: Length
    thickness_m: Length
    length_m: Length


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
    import numpy as np

    at_rest = float(np.interp(0.0, positions, forces))
    if abs(at_rest) > 1e-3 * max(abs(f) for f in forces):
        raise ValueError(f"gives {at_rest:g} N at {what} = 0; subtract the force at static rest from force_N")


class SpringTable(Table):
    """spring_table = {...}: force (positive pulls axle and body together) against extension
    from static rest in the first load case."""

    extension_m: Curve
    force_N: Curve

    @model_validator(mode="after")
    def _curve(self) -> Self:
        _check_curve(self.extension_m, self.force_N, "extension_m", "spring table")
        return self


class DamperTable(Table):
    """damper_table = {...}: force against the rate of extension, rebound positive."""

    rate_m_s: Curve
    force_N: Curve

    @model_validator(mode="after")
    def _curve(self) -> Self:
        _check_curve(self.rate_m_s, self.force_N, "rate_m_s", "damper table")
        return self


Track = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=6.0)]


class AxleTable(Table):
    """[[vehicle.axle]]: one axle, both sides and all its tires together."""

    name: Name
    body: Name
    x_m: Position
    unsprung_mass_kg: OptionalMass
    tire_stiffness_N_per_m: Positive
    tire_damping_N_s_per_m: NotNegative
    tire_radius_m: Radius
    suspension: Literal["leaf", "air", "other"]
    suspension_law: Annotated[StrictStr, Field(min_length=1, max_length=200)] | None = None
    spring_table: SpringTable | None = None
    damper_table: DamperTable | None = None
    hanger_lash_m: Length | None = None
    load_dependent: StrictBool | None = None
    inflation_pressure_kPa: Positive | None = None
    tire_stiffness_pressure_kPa: Positive | None = None
    jounce_travel_m: Travel | None = None
    rebound_travel_m: Travel | None = None
    leaf: LeafTable | None = None
    track_m: Track | None = None
    dual_spacing_m: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0, le=1.0)] | None = None
    spring_track_m: Track | None = None
    damper_track_m: Track | None = None
    priors: PriorsTable | None = None

    @model_validator(mode="after")
    def _twins_within_track(self) -> Self:
        if self.track_m is not None and self.dual_spacing_m is not None and self.dual_spacing_m >= self.track_m:
            raise ValueError(
                f"has a dual_spacing_m of {self.dual_spacing_m:g} and a track_m of {self.track_m:g}; the first is the "
                "distance between the twin tires of one side"
            )
        return self


class GroupTable(Table):
    """[[vehicle.group]]: axles on a common beam, or a rocker between the springs of neighbouring axles."""

    name: Name
    axles: Annotated[list[Name], Field(min_length=1, max_length=20)]
    kind: Literal["beam", "equaliser"] = "beam"
    mass_kg: OptionalMass | None = None
    pitch_inertia_kg_m2: NotNegative | None = None
    load_share: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0, le=1.0)] | None = None

    @model_validator(mode="after")
    def _keys_of_kind(self) -> Self:
        of_beam = {"mass_kg": self.mass_kg, "pitch_inertia_kg_m2": self.pitch_inertia_kg_m2}
        if self.kind == "beam":
            missing = [key for key, value in of_beam.items() if value is None]
            if missing:
                raise ValueError(
                    f'lacks {" and ".join(missing)} of its beam; give them, or kind = "equaliser" for a rocker '
                    "between springs"
                )
            if self.load_share is not None:
                raise ValueError('has a load_share, which belongs to kind = "equaliser"; leave it out for a beam')
        else:
            given = [key for key, value in of_beam.items() if value is not None]
            if given:
                raise ValueError(f"has {' and '.join(given)}, but an equaliser is a rocker without mass; leave it out")
            if len(self.axles) < 2:
                raise ValueError("joins one axle; an equaliser needs two or more")
        return self


Tolerance = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0, le=0.5)]


class TolerancesTable(Table):
    """tolerances = {...}: relative standard deviations of declared mass properties, 0 for exact ones."""

    unsprung_mass: Tolerance = 0.08
    pitch_inertia: Tolerance = 0.25
    cg_height: Tolerance = 0.10
    hitch_height: Tolerance = 0.03
    axle_load: Tolerance = 0.005
    axle_load_scale: Tolerance = 0.005


class VehicleTable(Table):
    """[vehicle]: bodies and axles, front to rear."""

    name: Name
    wheelbase_m: Length | None = None
    gravity_m_s2: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=9.0, le=10.0)] = 9.81
    driven_at: DrivenAt | None = None
    tolerances: TolerancesTable = Field(default_factory=TolerancesTable)
    body: Annotated[list[BodyTable], Field(min_length=1, max_length=20)]
    axle: Annotated[list[AxleTable], Field(min_length=1, max_length=40)]
    group: Annotated[list[GroupTable], Field(max_length=40)] = []


class LoadCaseTable(Table):
    """[load_case.NAME]: scale readings and mass properties."""

    cargo_mass_kg: OptionalMass | None = None
    axle_loads_kg: Annotated[list[Mass], Field(min_length=1, max_length=40)]
    sprung_mass_kg: Annotated[list[Mass], Field(min_length=1, max_length=20)] | None = None
    pitch_inertia_kg_m2: Annotated[list[Inertia], Field(min_length=1, max_length=20)]
    cg_height_m: Annotated[list[Height], Field(min_length=1, max_length=20)]
