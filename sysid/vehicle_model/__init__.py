"""The planar vehicle: bodies, hitches, axles, tires over an effective road, and its simulation (JAX)."""

from sysid.vehicle_model.assembly import PlanarMatrices, assemble, coordinate_names
from sysid.vehicle_model.contact import EffectiveRoad, RoadInput, TireLaw, effective_road, road_input, tire_law
from sysid.vehicle_model.filters import FilterRecursion, discretise
from sysid.vehicle_model.measured_road import measured_road
from sysid.vehicle_model.motion import Motion
from sysid.vehicle_model.passes import EffectiveRoads, Pass, PassBatch, make_pass_batch
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
