"""All residuals of a campaign and their exact Jacobian.

The unknowns are the global log parameters x (p,), and per run a relative speed change and a start shift in scaled
units.  A run's speed and start touch that run only, so p + 2 forward-mode tangents give the Jacobian of all runs.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp

from sysid.arrays import Parameters
from sysid.estimation.parameters.lane_laws import lane_laws
from sysid.estimation.residuals.bump_model import BumpModel, GroupArrays, GroupShape
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import SHIFT_UNIT_M, SPEED_UNIT, RunMotion
from sysid.estimation.residuals.signals import wheel_road
from sysid.threads import side_by_side
from sysid.vehicle_model.contact import EffectiveRoad
from sysid.vehicle_model.engine import WheelRoad
from sysid.vehicle_model.engines.protocol import Linearisation, Unknowns
from sysid.vehicle_model.lane_arrays import HostOrDevice


def linearise_group(
    arrays: GroupArrays,
    road: EffectiveRoad,
    noise_sd: HostOrDevice,
    tempering: HostOrDevice,
    log_parameters: jax.Array,
    speed: jax.Array,
    start: jax.Array,
    *,
    shape: GroupShape,
) -> Linearisation:
    """Residuals of one group and their derivatives at x (p,), speed and start (R,).

    The last two columns belong to each run's own speed and start in scaled units.
    """
    inputs = wheel_road(arrays, road, speed[:, None], start[:, None], shape)
    linearised: Linearisation = _linearise(arrays, inputs, noise_sd, tempering, log_parameters, speed, shape=shape)
    return linearised


@partial(jax.jit, static_argnames=("shape",))
def _linearise(
    arrays: GroupArrays,
    road: WheelRoad,
    noise_sd: HostOrDevice,
    tempering: HostOrDevice,
    log_parameters: jax.Array,
    speed: jax.Array,
    *,
    shape: GroupShape,
) -> Linearisation:
    count = log_parameters.shape[0]
    columns = jnp.eye(count + 2)
    run_columns = jnp.broadcast_to(columns[count:, None, :], (2, speed.shape[0], count + 2))
    unknowns = Unknowns(
        log_parameters,
        columns[:count],
        # Local unknowns are displacements along the road.
        speed=run_columns[0] * SPEED_UNIT * speed[:, None],
        start_s=run_columns[1] * SHIFT_UNIT_M / speed[:, None],
    )
    return road.engine.linearise(
        arrays.matrices,
        partial(lane_laws, arrays.laws),
        unknowns,
        road,
        shape.timing,
        shape.sensors,
        shape.recursion,
        arrays.readings(noise_sd, tempering),
    )


def linearise(
    model: BumpModel, weights: Weights, log_parameters: Parameters, motion: RunMotion
) -> tuple[Linearisation, ...]:
    """Linearisation of every group at global log parameters (p,) and run motions."""

    weighted = weights.on(model.arrays)

    def one(position: int) -> Linearisation:
        runs = list(model.groups[position].runs)
        linearised: Linearisation = jax.block_until_ready(
            linearise_group(
                weighted[position],
                model.roads[position],
                weights.noise_sd[position],
                weights.tempering[position],
                jnp.asarray(log_parameters),
                jnp.asarray(motion.speed_m_s[runs]),
                jnp.asarray(motion.start_s[runs]),
                shape=model.shapes[position],
            )
        )
        return linearised

    # A compiled loop keeps one core busy; threads let the groups share the cores.
    return side_by_side(one, range(len(model.groups)))
