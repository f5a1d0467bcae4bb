"""The planar vehicle: bodies, hitches, axles, tires over an effective road, and its simulation (JAX)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sysid.lazy_names import lazy_names

if TYPE_CHECKING:
    from sysid.vehicle_model.assembly import PlanarMatrices, assemble, coordinate_names
    from sysid.vehicle_model.contact import EffectiveRoad, RoadInput, TireLaw, effective_road, road_input, tire_law
    from sysid.vehicle_model.filters import FilterRecursion, discretise
    from sysid.vehicle_model.motion import Motion
    from sysid.vehicle_model.passes import EffectiveRoads, Pass, PassBatch, make_pass_batch
    from sysid.vehicle_model.point_contact import measured_road
    from sysid.vehicle_model.simulation import (
        Histories,
        SensorLayout,
        simulate_histories,
        simulate_sensors,
        stage_times,
    )
    from sysid.vehicle_model.stacked_matrices import StackedMatrices, stack_matrices
    from sysid.vehicle_model.suspension import SuspensionLaw
    from sysid.vehicle_model.vibration_modes import NaturalModes, natural_modes

_HOMES = {
    "EffectiveRoad": "sysid.vehicle_model.contact",
    "EffectiveRoads": "sysid.vehicle_model.passes",
    "FilterRecursion": "sysid.vehicle_model.filters",
    "Histories": "sysid.vehicle_model.simulation",
    "Motion": "sysid.vehicle_model.motion",
    "NaturalModes": "sysid.vehicle_model.vibration_modes",
    "Pass": "sysid.vehicle_model.passes",
    "PassBatch": "sysid.vehicle_model.passes",
    "PlanarMatrices": "sysid.vehicle_model.assembly",
    "RoadInput": "sysid.vehicle_model.contact",
    "SensorLayout": "sysid.vehicle_model.simulation",
    "StackedMatrices": "sysid.vehicle_model.stacked_matrices",
    "SuspensionLaw": "sysid.vehicle_model.suspension",
    "TireLaw": "sysid.vehicle_model.contact",
    "assemble": "sysid.vehicle_model.assembly",
    "coordinate_names": "sysid.vehicle_model.assembly",
    "discretise": "sysid.vehicle_model.filters",
    "effective_road": "sysid.vehicle_model.contact",
    "make_pass_batch": "sysid.vehicle_model.passes",
    "measured_road": "sysid.vehicle_model.point_contact",
    "natural_modes": "sysid.vehicle_model.vibration_modes",
    "road_input": "sysid.vehicle_model.contact",
    "simulate_histories": "sysid.vehicle_model.simulation",
    "simulate_sensors": "sysid.vehicle_model.simulation",
    "stack_matrices": "sysid.vehicle_model.stacked_matrices",
    "stage_times": "sysid.vehicle_model.simulation",
    "tire_law": "sysid.vehicle_model.contact",
}

__all__ = [
    "EffectiveRoad",
    "EffectiveRoads",
    "FilterRecursion",
    "Histories",
    "Motion",
    "NaturalModes",
    "Pass",
    "PassBatch",
    "PlanarMatrices",
    "RoadInput",
    "SensorLayout",
    "StackedMatrices",
    "SuspensionLaw",
    "TireLaw",
    "assemble",
    "coordinate_names",
    "discretise",
    "effective_road",
    "make_pass_batch",
    "measured_road",
    "natural_modes",
    "road_input",
    "simulate_histories",
    "simulate_sensors",
    "stack_matrices",
    "stage_times",
    "tire_law",
]

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
