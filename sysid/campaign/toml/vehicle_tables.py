"""From the validated tables of vehicle and load cases to records: names become indices, axles front to rear."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import pairwise

from sysid.campaign.priors import PriorOverride
from sysid.campaign.statics import chains
from sysid.campaign.toml.groups import check_groups
from sysid.campaign.toml.schema import CampaignFile
from sysid.campaign.toml.schema_vehicle import AxleTable, BodyTable, GroupTable, LoadCaseTable
from sysid.campaign.units import pressure_pa
from sysid.campaign.vehicle_records import (
    Axle,
    AxleGroup,
    Body,
    Equaliser,
    ForceTable,
    FrameBending,
    LeafDimensions,
    LoadCase,
    MassTolerances,
    Vehicle,
)
from sysid.errors import CampaignError
from sysid.wording import finish, nearest, shorten

_PRIOR_QUANTITIES = {
    "stiffness_N_per_m": "stiffness",
    "damping_N_s_per_m": "damping",
    "tire_stiffness_N_per_m": "tire_stiffness",
    "tire_damping_N_s_per_m": "tire_damping",
}
#: Positions that differ by less are the same but for rounding.
_SAME_PLACE_M = 1e-6
#: Share of a tire's vertical stiffness that its structure keeps without pressure: an assumption, general knowledge of
#: truck tires, whose load is carried by the air almost alone.
TIRE_STRUCTURE_SHARE = 0.04


def nominal_tire_stiffness(table: AxleTable) -> float:
    """Declared tire stiffness [N/m], carried over to the pressure that the tire had.

    k(p) = k(p_0) (s + (1 - s) p / p_0) with the structure's share s: affine in pressure, as measured on belted radial
    tires (T. B. Rhyne, Development of a vertical stiffness relationship for belted radial tires, Tire Science and
    Technology 33 (2005), doi:10.2346/1.2174340); unchanged unless both pressures are declared.
    """
    had, declared_at = table.inflation_pressure_kPa, table.tire_stiffness_pressure_kPa
    if had is None or declared_at is None:
        return table.tire_stiffness_N_per_m
    return table.tire_stiffness_N_per_m * (TIRE_STRUCTURE_SHARE + (1.0 - TIRE_STRUCTURE_SHARE) * had / declared_at)


def _bending(table: BodyTable) -> FrameBending | None:
    bent = table.bending
    if bent is None:
        return None
    points = ((), ()) if bent.shape is None else (tuple(bent.shape.x_m), tuple(bent.shape.rise))
    return FrameBending(bent.frequency_hz, bent.damping_ratio, *points)


class VehicleReader:
    """Vehicle and load cases of one campaign file, and its names.

    Axles are sorted by `x_m`, and the axle loads of every load case with them, so that the order in the file does not
    matter.

    Raises
    ------
    CampaignError
        If names are unknown or used twice, positions contradict each other, or a list has the wrong length.
    """

    def __init__(self, tables: CampaignFile, label: str) -> None:
        self._label = label
        table = tables.vehicle
        self._unique([b.name for b in table.body], "vehicle.body")
        self._unique([a.name for a in table.axle], "vehicle.axle")
        self._unique([g.name for g in table.group], "vehicle.group")
        self._bodies = [b.name for b in table.body]
        order = sorted(range(len(table.axle)), key=lambda i: table.axle[i].x_m)
        self._axles = [table.axle[i].name for i in order]
        self._check_positions([table.axle[i] for i in order], table.body)
        several = len(tables.load_case) > 1
        self.vehicle = Vehicle(
            name=table.name,
            bodies=tuple(Body(b.name, b.hitch_x_m, b.hitch_height_m, _bending(b)) for b in table.body),
            axles=tuple(self._axle(table.axle[i], i, several) for i in order),
            gravity_m_s2=table.gravity_m_s2,
            wheelbase_m=table.wheelbase_m,
            driven_at=table.driven_at,
            groups=tuple(
                AxleGroup(g.name, self._members(g, i), g.mass_kg or 0.0, g.pitch_inertia_kg_m2 or 0.0)
                for i, g in enumerate(table.group)
                if g.kind == "beam"
            ),
            equalisers=tuple(
                Equaliser(g.name, self._members(g, i), g.load_share)
                for i, g in enumerate(table.group)
                if g.kind == "equaliser"
            ),
            tolerances=MassTolerances(**table.tolerances.model_dump()),
        )
        check_groups(self.vehicle, label)
        self.load_cases = {n: self._load_case(n, t, order) for n, t in tables.load_case.items()}

    def axle(self, name: str, key: str) -> int:
        """Index of an axle by name."""
        return self._axles.index(self.pick(name, self._axles, key, "axle"))

    def body(self, name: str, key: str) -> int:
        """Index of a body by name."""
        return self._bodies.index(self.pick(name, self._bodies, key, "body"))

    def pick(self, name: str, names: Sequence[str], key: str, what: str) -> str:
        """The name itself if it is one of the names, else a CampaignError that suggests the nearest."""
        if name not in names:
            article = "an" if what[0] in "aeiou" else "a"
            raise CampaignError(
                finish(
                    f"{self._label}: {key} is '{shorten(name)}', which is not the name of {article} {what}; "
                    f"{nearest(name, names)}"
                )
            )
        return name

    def _unique(self, names: Iterable[str], key: str) -> None:
        double = next((n for n, count in Counter(names).items() if count > 1), None)
        if double is not None:
            raise CampaignError(f"{self._label}: two entries of {key} have the name '{shorten(double)}'; rename one.")

    def _check_positions(self, axles: Sequence[AxleTable], bodies: Sequence[BodyTable]) -> None:
        if abs(axles[0].x_m) > _SAME_PLACE_M:
            raise CampaignError(
                f"{self._label}: the foremost axle '{shorten(axles[0].name)}' has x_m = {axles[0].x_m:g}, expected 0; "
                "measure every x_m from axle 1, rearward positive."
            )
        for front, rear in pairwise(axles):
            if rear.x_m - front.x_m <= _SAME_PLACE_M:
                raise CampaignError(
                    f"{self._label}: the axles '{shorten(front.name)}' and '{shorten(rear.name)}' have the same x_m = "
                    f"{rear.x_m:g}; correct one, or enter them as one axle."
                )
        if bodies[0].hitch_x_m is not None:
            raise CampaignError(
                f"{self._label}: vehicle.body[1] ('{shorten(bodies[0].name)}') has hitch_x_m, but no body stands in "
                "front of it; enter bodies front to rear and give the hitch keys to the rear one."
            )

    def _axle(self, table: AxleTable, index: int, several_load_cases: bool) -> Axle:
        key = f"vehicle.axle[{index + 1}] ('{shorten(table.name)}')"
        leaf = table.leaf
        if leaf is not None and table.suspension != "leaf":
            raise CampaignError(f"{self._label}: {key} has leaf dimensions, but suspension = '{table.suspension}'.")
        by_load = table.suspension == "air" and several_load_cases
        self._check_law(table, key)
        priors = {}
        for name, quantity in _PRIOR_QUANTITIES.items():
            prior = None if table.priors is None else getattr(table.priors, name)
            if prior is not None:
                priors[quantity] = PriorOverride(prior.median, prior.log_sd)
        pressure, measured_at = table.inflation_pressure_kPa, table.tire_stiffness_pressure_kPa
        return Axle(
            name=table.name,
            body=self.body(table.body, f"{key}.body"),
            x_m=table.x_m,
            unsprung_mass_kg=table.unsprung_mass_kg,
            tire_stiffness_N_per_m=nominal_tire_stiffness(table),
            tire_damping_N_s_per_m=table.tire_damping_N_s_per_m,
            tire_radius_m=table.tire_radius_m,
            suspension=table.suspension,
            suspension_law=table.suspension_law,
            spring_table=None
            if table.spring_table is None
            else ForceTable(tuple(table.spring_table.extension_m), tuple(table.spring_table.force_N)),
            damper_table=None
            if table.damper_table is None
            else ForceTable(tuple(table.damper_table.rate_m_s), tuple(table.damper_table.force_N)),
            hanger_lash_m=table.hanger_lash_m,
            load_dependent=by_load if table.load_dependent is None else table.load_dependent,
            inflation_pressure_Pa=None if pressure is None else pressure_pa(pressure),
            tire_stiffness_pressure_Pa=None if measured_at is None else pressure_pa(measured_at),
            jounce_travel_m=table.jounce_travel_m,
            rebound_travel_m=table.rebound_travel_m,
            leaf=None if leaf is None else LeafDimensions(leaf.leaves, leaf.width_m, leaf.thickness_m, leaf.length_m),
            track_m=table.track_m,
            dual_spacing_m=table.dual_spacing_m,
            spring_track_m=table.spring_track_m,
            damper_track_m=table.damper_track_m,
            priors=priors,
        )

    def _check_law(self, table: AxleTable, key: str) -> None:
        elements = {part.strip() for part in (table.suspension_law or "").split("+")}
        for element, needed in (
            ("spring_table", "spring_table"),
            ("damper_table", "damper_table"),
            ("hanger_lash", "hanger_lash_m"),
        ):
            if element in elements and getattr(table, needed) is None:
                raise CampaignError(
                    f"{self._label}: {key} has suspension_law = '{shorten(table.suspension_law)}', but no {needed}; "
                    f"add it, or leave {element} out."
                )
        if {"spring_table", "hanger_lash"} <= elements:
            raise CampaignError(
                f"{self._label}: {key} has both spring_table and hanger_lash in its suspension_law; leave hanger_lash "
                "out and give the table a level piece where the leaf pack carries no load."
            )

    def _members(self, table: GroupTable, index: int) -> tuple[int, ...]:
        return tuple(sorted(self.axle(n, f"vehicle.group[{index + 1}].axles") for n in table.axles))

    def _load_case(self, name: str, table: LoadCaseTable, order: Sequence[int]) -> LoadCase:
        bodies = len(self.vehicle.bodies)
        counts = {
            "axle_loads_kg": (len(order), "axle"),
            "sprung_mass_kg": (bodies, "body"),
            "pitch_inertia_kg_m2": (bodies, "body"),
            "cg_height_m": (bodies, "body"),
        }
        for key, (count, what) in counts.items():
            given = len(getattr(table, key) or [])
            if given != count and not (key == "sprung_mass_kg" and table.sprung_mass_kg is None):
                raise CampaignError(
                    f"{self._label}: load_case.{shorten(name)}.{key} has {given} numbers, expected {count}, "
                    f"one per {what}."
                )
        loads = tuple(table.axle_loads_kg[i] for i in order)
        return LoadCase(
            name=name,
            axle_loads_kg=loads,
            sprung_mass_kg=tuple(table.sprung_mass_kg or self._sprung_masses(name, loads)),
            pitch_inertia_kg_m2=tuple(table.pitch_inertia_kg_m2),
            cg_height_m=tuple(table.cg_height_m),
            cargo_mass_kg=table.cargo_mass_kg,
        )

    def _sprung_masses(self, name: str, axle_loads_kg: Sequence[float]) -> tuple[float, ...]:
        """What stands on the axles of each body, less their unsprung masses, where no bodies are coupled."""
        vehicle = self.vehicle
        if any(len(chain) > 1 for chain in chains(vehicle)):
            raise CampaignError(
                f"{self._label}: load_case.{shorten(name)} has no sprung_mass_kg; give one number per body: with "
                "coupled bodies, axle loads do not say it."
            )
        carried = [load - mass for load, mass in zip(axle_loads_kg, vehicle.unsprung_mass_kg, strict=True)]
        bodies = range(len(vehicle.bodies))
        return tuple(sum(m for m, a in zip(carried, vehicle.axles, strict=True) if a.body == b) for b in bodies)
