"""Sums of squares of many parameter sets, the runs' own unknowns integrated out, without derivatives.

Near a point the motion of a run moves its residuals along the columns J_eta.  Integrating them out with their Gaussian
priors leaves, per run,

    r'r - b' N^-1 b,   b = J_eta' r + prior,   N = J_eta' J_eta + prior precision.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sysid.arrays import RunsByChannels
from sysid.estimation.parameters.axle_laws import axle_laws
from sysid.estimation.residuals.bump_model import BumpModel, GroupArrays, GroupShape
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import MotionPrior, RunMotion
from sysid.estimation.residuals.run_unknowns import run_normal
from sysid.estimation.residuals.signals import wheel_road
from sysid.vehicle_model.device_arrays import HostOrDevice, ParametersBySets
from sysid.vehicle_model.engine import WheelRoad
from sysid.vehicle_model.engines.protocol import Linearisation, LocalColumns


class GroupInputs(NamedTuple):
    """What the sums of squares of one group of runs need beside the parameter sets; noise and tempering (R, C)."""

    arrays: GroupArrays
    road: WheelRoad
    noise_sd: RunsByChannels
    tempering: RunsByChannels
    local: LocalColumns


def group_inputs(
    model: BumpModel, weights: Weights, motion: RunMotion, expected: MotionPrior, position: int, lin: Linearisation
) -> GroupInputs:
    """Inputs of one group near a point.

    Parameters
    ----------
    motion, lin : motions of all runs, and the derivatives of the group, at the point.
    expected : prior of the motions.
    """
    runs = list(model.groups[position].runs)
    residual, gain = np.asarray(lin.residual_jacobian), np.asarray(lin.gain_jacobian)
    count = len(model.parameters.parameters)
    # Copies, which do not keep the columns of the parameters.
    local, local_gain = np.array(residual[..., count:]), np.array(gain[..., count:])
    normal = run_normal(local, local_gain, expected.precision(motion, runs))
    pull = np.einsum("rj,rjk->rk", *expected.rows(motion, runs))
    arrays, shape = weights.on(model.arrays, position), model.shapes[position]
    road = wheel_road(arrays, model.roads[position], motion.of(runs), shape)
    columns = LocalColumns(local, local_gain, pull, np.linalg.inv(np.linalg.cholesky(normal)))
    return GroupInputs(arrays, road, weights.noise_sd[position], weights.tempering[position], columns)


def group_misfits(inputs: GroupInputs, log_parameters: ParametersBySets, *, shape: GroupShape) -> HostOrDevice:
    """Sum over a group's runs of r'r - b' N^-1 b for every set (S,) of log parameters (p, S)."""
    arrays, road = inputs.arrays, inputs.road
    suspension, tire = axle_laws(arrays.laws, log_parameters)
    readings = arrays.readings(inputs.noise_sd, inputs.tempering)
    misfits = road.engine.misfits(
        arrays.matrices, suspension, tire, road, shape.timing, shape.sensors, shape.recursion, readings, inputs.local
    )
    return misfits.sum(axis=0)
