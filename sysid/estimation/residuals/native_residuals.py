"""Misfits and linearisations of a group of runs by the native engine: twins of the JAX functions of their callers."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from sysid.estimation.parameters.lane_laws import lane_laws
from sysid.estimation.residuals.bump_model import GroupArrays, GroupShape
from sysid.vehicle_model.engine import LocalColumns, Readings
from sysid.vehicle_model.native import kernel


def _readings(arrays: GroupArrays, weights: tuple[jax.Array, jax.Array]) -> Readings:
    return Readings(arrays.value, arrays.measured, arrays.censored, *weights, arrays.gain_sd)


def native_misfits(
    arrays: GroupArrays,
    shape: GroupShape,
    course: kernel.Course,
    weights: tuple[jax.Array, jax.Array],
    log_parameters: jax.Array,
    local: LocalColumns,
) -> jax.Array:
    """r'r - b' N^-1 b of every run and parameter set (R, S), see :mod:`sysid.posterior.log_density`.

    Parameters
    ----------
    course : road, speeds and starts of the runs.
    weights : residual scale and tempering, each (R, C).
    log_parameters : (p, S).
    """
    return kernel.misfits(
        arrays.matrices,
        kernel.laws(*lane_laws(arrays.laws, log_parameters)),
        course,
        shape.timing,
        shape.sensors,
        shape.recursion,
        _readings(arrays, weights),
        local,
    )


def native_linearisation(
    arrays: GroupArrays,
    shape: GroupShape,
    course: kernel.Course,
    weights: tuple[jax.Array, jax.Array],
    log_parameters: jax.Array,
    parameter_tangents: jax.Array,
    motion_tangents: tuple[jax.Array, jax.Array],
) -> list[jax.Array]:
    """Residuals, gain residuals and signals with derivatives, in the order of the fields of ``Linearisation``.

    Parameters
    ----------
    log_parameters, parameter_tangents : (p, P) the same parameters in every column, and their derivatives.
    motion_tangents : derivatives of speed [m/s] and start [s], each (R, P).
    """

    def rows(x: jax.Array) -> jax.Array:
        return kernel.laws(*lane_laws(arrays.laws, x)).rows

    return kernel.linearise(
        arrays.matrices,
        kernel.laws(*lane_laws(arrays.laws, log_parameters[:, :1])),
        jax.jvp(rows, (log_parameters,), (parameter_tangents,))[1],
        jnp.stack(motion_tangents),
        course,
        shape.timing,
        shape.sensors,
        shape.recursion,
        _readings(arrays, weights),
    )
