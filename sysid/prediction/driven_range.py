"""What the driven runs reached: every run simulated once more at the optimum of the fit."""

from __future__ import annotations

import numpy as np

from sysid.arrays import Parameters
from sysid.campaign.requests import driven_speeds
from sysid.estimation.fit.state import FitState
from sysid.estimation.parameters.axle_laws import LawInputs, axle_laws
from sysid.prediction.measures import extremes
from sysid.prediction.trust import DrivenRange
from sysid.vehicle_model.contact import TireLaw
from sysid.vehicle_model.device_arrays import HostOrDevice
from sysid.vehicle_model.engine import Timing, WheelRoad, wheel_road
from sysid.vehicle_model.stacked_matrices import StackedMatrices

_AXLEWISE = ("tire_deflection_m", "jounce_m", "rebound_m", "damper_speed_m_s", "lift_off_s")


def spring_deflection(tire: TireLaw, force: HostOrDevice) -> HostOrDevice:
    """Deflection u = u_ref (F / F_ref)^(1/n) of the free tire at which its spring alone carries the force F [m].

    Of the largest force it is no less than the largest deflection: at that instant the damping carries nothing.

    Parameters
    ----------
    force : (..., R, na, S) vertical tire force [N].
    """
    return tire.reference_deflection * (force / tire.reference_load) ** (1.0 / tire.exponent)


def _histories(
    matrices: StackedMatrices, laws: LawInputs, road: WheelRoad, log_parameters: Parameters, timing: Timing
) -> tuple[HostOrDevice, HostOrDevice, HostOrDevice]:
    suspension, tire = axle_laws(laws, log_parameters[:, None])
    histories = road.engine.histories(matrices, suspension, tire, road, timing)
    force = histories.tire_force
    return force[..., 0], spring_deflection(tire, force)[..., 0], histories.deflection[..., 0]


def driven_range(state: FitState) -> DrivenRange:
    """Extremes of all runs of a fit at its optimum, each in its own motion, at every integration step."""
    model, point = state.model, state.point
    axles = len(state.campaign.vehicle.axles)
    most = {name: np.zeros(axles) for name in _AXLEWISE}
    for group, arrays, road, shape in zip(model.groups, model.arrays, model.roads, model.shapes, strict=True):
        runs = list(group.runs)
        step_s = shape.interval_s / shape.substeps
        timing = Timing(shape.samples * shape.substeps, step_s, 1)
        motion = point.motion.of(runs).along_road(arrays.axle_x)
        wheels = wheel_road(arrays.matrices, road, arrays.axle_x, motion, timing)
        histories = _histories(arrays.matrices, arrays.laws, wheels, point.log_parameters, timing)
        force, sunk, extension = (np.asarray(h) for h in histories)
        reached = extremes(sunk, extension, force, step_s)
        most = {name: np.maximum(most[name], values.max(axis=0)) for name, values in reached.items()}
    cases = dict.fromkeys(run.load_case for run in state.campaign.bump_runs)
    speeds = {case: max(driven_speeds(state.campaign, case)) for case in cases}
    return DrivenRange(speeds, **most)
