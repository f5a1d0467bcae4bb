"""Sums of squares of many parameter sets, with other unknowns integrated out, without derivatives.

Unknowns of a run alone (its motion, the clocks of its loggers) move its residuals r along columns J, unknowns that all
runs share along columns A.  With the precision N of a run's own unknowns and the gradient m of their priors,
integrating them out leaves, per run,

    r'r - b' N^-1 b,    b = J'r + m,    N = J'J + prior precision,

and the shared unknowns act along A - J N^-1 J'A.  The products of r with these are what their integration needs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sysid.arrays import RunsByChannels
from sysid.estimation.parameters.axle_laws import axle_laws
from sysid.estimation.residuals.bump_model import BumpModel, GroupArrays, GroupShape
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.run_unknowns import run_normal
from sysid.estimation.residuals.signals import wheel_road
from sysid.vehicle_model.device_arrays import ParametersBySets
from sysid.vehicle_model.engine import WheelRoad
from sysid.vehicle_model.engines.protocol import Columns


class GroupInputs(NamedTuple):
    """What the sums of squares of one group of runs need beside the parameter sets; noise and tempering (R, C).

    `columns`: those of the l own unknowns of every run, then of the K shared ones, orthogonal to the own ones.
    `offset` (R, l) gradient m of the priors of the own unknowns, `factor` (R, l, l) the inverse Cholesky factor of N,
    `shared` (K,) what these priors add to the products with the shared columns.
    """

    arrays: GroupArrays
    road: WheelRoad
    noise_sd: RunsByChannels
    tempering: RunsByChannels
    columns: Columns
    offset: np.ndarray
    factor: np.ndarray
    shared: np.ndarray


def group_inputs(
    model: BumpModel,
    weights: Weights,
    motion: RunMotion,
    position: int,
    own: Columns,
    prior: tuple[np.ndarray, np.ndarray],
    shared: Columns | None = None,
) -> GroupInputs:
    """Inputs of one group near a point.

    Parameters
    ----------
    motion : of all runs at the point.
    own : columns (T, R, C, l) of the unknowns of every run, and `prior` their gradient (R, l) and precision (R, l, l).
    shared : columns (T, R, C, K) of further unknowns that all runs share, None for none.
    """
    runs = list(model.groups[position].runs)
    offset, precision = prior
    normal = run_normal(np.asarray(own.residual), np.asarray(own.gain), precision)
    residual, gain, constant = own.residual, own.gain, np.zeros(0)
    if shared is not None:
        cross = np.einsum("trcl,trck->rlk", residual, shared.residual, optimize=True)
        cross += np.einsum("rcl,rck->rlk", gain, shared.gain)
        follows = np.linalg.solve(normal, cross)
        constant = -np.einsum("rlk,rl->k", follows, offset)
        left = shared.residual - np.einsum("trcl,rlk->trck", residual, follows, optimize=True)
        residual = np.concatenate([residual, left], axis=-1)
        gain = np.concatenate([gain, shared.gain - np.einsum("rcl,rlk->rck", gain, follows)], axis=-1)
    arrays, shape = weights.on(model.arrays, position), model.shapes[position]
    road = wheel_road(arrays, model.roads[position], motion.of(runs), shape)
    factor = np.linalg.inv(np.linalg.cholesky(normal))
    scales = weights.noise_sd[position], weights.tempering[position]
    # In the order in which the native engine reads them: a copy at every call would take as long as a simulation.
    along = np.ascontiguousarray(residual.transpose(1, 3, 2, 0)).transpose(3, 0, 2, 1)
    columns = Columns(along, np.ascontiguousarray(gain))
    return GroupInputs(arrays, road, *scales, columns, offset, factor, constant)


def group_misfits(
    inputs: GroupInputs, log_parameters: ParametersBySets, *, shape: GroupShape
) -> tuple[np.ndarray, np.ndarray]:
    """Sum over a group's runs of r'r - b' N^-1 b (S,), and products with K shared columns (K, S), of sets (p, S)."""
    arrays, road = inputs.arrays, inputs.road
    suspension, tire = axle_laws(arrays.laws, log_parameters)
    readings = arrays.readings(inputs.noise_sd, inputs.tempering)
    squares, products = map(
        np.asarray,
        road.engine.misfits(
            arrays.matrices, suspension, tire, road, shape.timing, shape.sensors, shape.recursion, readings,
            inputs.columns,
        ),
    )  # fmt: skip
    own = inputs.offset.shape[1]
    # Not by matrix products, whose rounding depends on how many sets there are.
    b = products[:, :own] + inputs.offset[:, :, None]
    white = (inputs.factor[..., None] * b[:, None]).sum(axis=2)
    return squares.sum(axis=0) - (white**2).sum(axis=(0, 1)), products[:, own:].sum(axis=0) + inputs.shared[:, None]
