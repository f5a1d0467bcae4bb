"""[bridge.NAME]: spans and supports, or influence lines and modes from files; and its surface."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from sysid import limits
from sysid.campaign.roads import RoadClass
from sysid.campaign.toml.schema_fields import PathText, Position, Table

Span = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.5, le=1000.0)]
Stiffness = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=1e16)]
MassPerLength = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=1e6)]
Ratio = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0, le=0.3)]
Frequency = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=1000.0)]
ModalMass = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=1e9)]
Station = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0, le=20_000.0)]
#: Spans and modes of one bridge.
_SPANS, _MODES = 50, 60


class SurfaceTable(Table):
    """surface = {...}: of a class by ISO 8608 with some road before the bridge, or from a file."""

    roughness: RoadClass | None = Field(default=None, alias="class")
    seed: Annotated[int, Field(strict=True, ge=0)] = 0
    realisations: Annotated[int, Field(strict=True, ge=1, le=limits.ROAD_REALISATIONS)] = 1
    file: PathText | None = None
    lateral_m: Position | None = None
    bridge_at_m: Station | None = None

    @model_validator(mode="after")
    def _class_or_file(self) -> Self:
        if (self.roughness is None) == (self.file is None):
            raise ValueError("is of a class or from a file; give class or file")
        if self.file is not None:
            if self.model_fields_set & {"seed", "realisations"}:
                raise ValueError("comes from a file; seed and realisations belong to a class")
            if self.bridge_at_m is None:
                raise ValueError("comes from a file; give bridge_at_m, the station of the file at the first support")
        elif self.bridge_at_m is not None or self.lateral_m is not None:
            raise ValueError("is of a class; bridge_at_m and lateral_m belong to a file")
        return self


class BridgeTable(Table):
    """[bridge.NAME], or a TOML file of its own with the same keys."""

    spans_m: Annotated[list[Span], Field(max_length=_SPANS)] = []
    supports: Annotated[list[Literal["pinned", "fixed", "free"]], Field(max_length=_SPANS + 1)] = []
    bending_stiffness_N_m2: Stiffness | Annotated[list[Stiffness], Field(max_length=_SPANS)] | None = None
    mass_kg_m: MassPerLength | Annotated[list[MassPerLength], Field(max_length=_SPANS)] | None = None
    damping_ratio: Ratio | Annotated[list[Ratio], Field(min_length=1, max_length=_MODES)] | None = None
    modes: Annotated[int, Field(strict=True, ge=1, le=_MODES)] | None = None
    sections_m: Annotated[list[Station], Field(max_length=100)] | None = None
    influence_lines: PathText | None = None
    mode_shapes: PathText | None = None
    frequencies_hz: Annotated[list[Frequency], Field(max_length=_MODES)] = []
    modal_masses_kg: Annotated[list[ModalMass], Field(max_length=_MODES)] = []
    surface: SurfaceTable | None = None

    @model_validator(mode="after")
    def _spans_or_files(self) -> Self:
        if self.spans_m:
            self._check_spans()
        else:
            self._check_files()
        if (self.spans_m or self.mode_shapes is not None) and self.damping_ratio is None:
            raise ValueError("has no damping_ratio of its modes; give it, 0.005 to 0.02 for most road bridges")
        return self

    def _check_spans(self) -> None:
        given = {"influence_lines", "mode_shapes", "frequencies_hz", "modal_masses_kg"} & self.model_fields_set
        if given:
            raise ValueError(f"has spans_m and {sorted(given)[0]}; a bridge is given by one or the other")
        for name in ("bending_stiffness_N_m2", "mass_kg_m"):
            value = getattr(self, name)
            if value is None:
                raise ValueError(f"has no {name}; give one value, or one for every span")
            if isinstance(value, list) and len(value) != len(self.spans_m):
                raise ValueError(f"has {len(value)} values of {name} for {len(self.spans_m)} spans; give one for each")
        if isinstance(self.damping_ratio, list) and len(self.damping_ratio) != self.followed:
            raise ValueError(
                f"has {len(self.damping_ratio)} damping ratios for {self.followed} modes; give one for all"
            )
        supports = self.supports
        if supports and len(supports) != len(self.spans_m) + 1:
            raise ValueError(
                f"has {len(supports)} supports and {len(self.spans_m)} spans; give one support more than spans"
            )
        if "free" in supports[1:-1]:
            raise ValueError("has a free support between spans; only an end can be free")
        if supports and "fixed" not in supports and sum(one != "free" for one in supports) < 2:
            raise ValueError("stands on one pinned support and falls; fix that support or add another one")
        beyond = [x for x in self.sections_m or () if x > sum(self.spans_m) + 1e-9]
        if beyond:
            raise ValueError(f"has a section at {beyond[0]:g} m on a length of {sum(self.spans_m):g} m")

    def _check_files(self) -> None:
        spans = {"supports", "bending_stiffness_N_m2", "sections_m", "modes"} & self.model_fields_set
        if spans:
            raise ValueError(f"has {sorted(spans)[0]} and no spans_m; give spans_m")
        if self.influence_lines is None and self.mode_shapes is None:
            raise ValueError("has neither spans_m nor influence_lines nor mode_shapes; give one of them")
        if self.mode_shapes is not None and not (
            self.frequencies_hz and len(self.frequencies_hz) == len(self.modal_masses_kg)
        ):
            raise ValueError(
                "has mode_shapes; give as many frequencies_hz as modal_masses_kg, one per column of shapes"
            )
        if self.mode_shapes is None and (self.frequencies_hz or self.modal_masses_kg):
            raise ValueError("has modes without mode_shapes; name the file with their shapes at stations")
        if isinstance(self.mass_kg_m, list):
            raise ValueError("has several values of mass_kg_m and no spans_m; give one")
        if self.influence_lines is not None and self.mode_shapes is not None and self.mass_kg_m is None:
            raise ValueError(
                "has influence_lines and mode_shapes; give mass_kg_m, which says what inertia adds to them"
            )
        ratios = self.damping_ratio
        if isinstance(ratios, list) and len(ratios) not in (1, len(self.frequencies_hz)):
            raise ValueError(
                f"has {len(ratios)} damping ratios for {len(self.frequencies_hz)} modes; give one for all or for each"
            )

    @property
    def followed(self) -> int:
        """How many modes of a beam are followed."""
        return self.modes or min(max(10, 4 * len(self.spans_m)), _MODES)


class BridgeFile(Table):
    """A TOML file with one bridge."""

    bridge: BridgeTable
