"""All residuals of a campaign and their exact Jacobian.

The unknowns are the global log parameters x (p,), and per run those of its motion in scaled units. A run's motion
affects that run only, so p + 3 forward-mode tangents give the Jacobian of all runs.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from jax.tree_util import Partial

from sysid.arrays import Parameters
from sysid.estimation.parameters.axle_laws import axle_laws
from sysid.estimation.residuals.bump_model import BumpModel, GroupArrays, GroupShape
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RUN_UNKNOWNS, RunMotion
from sysid.estimation.residuals.signals import wheel_road
from sysid.threads import side_by_side
from sysid.vehicle_model.contact import EffectiveRoad
from sysid.vehicle_model.device_arrays import HostOrDevice
from sysid.vehicle_model.engines.protocol import Linearisation, Unknowns
from sysid.vehicle_model.motion import MotionChange


def linearise_group(
    arrays: GroupArrays,
    road: EffectiveRoad,
    noise_sd: HostOrDevice,
    tempering: HostOrDevice,
    log_parameters: HostOrDevice,
    motion: RunMotion,
    *,
    shape: GroupShape,
) -> Linearisation:
    """Residuals of one group and their derivatives at x (p,) and the motion of its runs.

    The last three columns belong to each run's own motion in scaled units.
    """
    wheels = wheel_road(arrays, road, motion, shape)
    of_motion, count = motion.per_unit(arrays.axle_x, arrays.change_unit), log_parameters.shape[0]
    unknowns = Unknowns(
        log_parameters,
        np.eye(count, count + RUN_UNKNOWNS),
        # Parameters come first, then the unknowns of a run's own motion.
        MotionChange(*(np.pad(columns, ((0, 0), (count, 0))) for columns in of_motion)),
    )
    return wheels.engine.linearise(
        arrays.matrices,
        Partial(axle_laws, arrays.laws),
        unknowns,
        wheels,
        shape.timing,
        shape.sensors,
        shape.recursion,
        arrays.readings(noise_sd, tempering),
    )


def linearise(
    model: BumpModel, weights: Weights, log_parameters: Parameters, motion: RunMotion
) -> tuple[Linearisation, ...]:
    """Linearisation of every group at global log parameters (p,) and run motions."""
    one = partial(linearise_one, model, weights, log_parameters, motion)
    # A group of few runs keeps one core busy; threads let the groups share the cores.
    return side_by_side(one, range(len(model.groups)))


def linearise_one(
    model: BumpModel, weights: Weights, log_parameters: Parameters, motion: RunMotion, position: int
) -> Linearisation:
    """Linearisation of one group, as :func:`linearise`, for cases in which derivatives of all take too much memory."""
    linearised = linearise_group(
        weights.on(model.arrays, position),
        model.roads[position],
        weights.noise_sd[position],
        weights.tempering[position],
        log_parameters,
        motion.of(list(model.groups[position].runs)),
        shape=model.shapes[position],
    )
    return Linearisation(*map(np.asarray, linearised))
