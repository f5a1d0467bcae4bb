"""How residuals move with the factors on mass properties: forward differences of the simulation, assembled again.

The sensors' offset and gain are eliminated and the weights applied as everywhere else, so the columns stand beside
those of the parameters.  A step of 1e-4 of a mass is far above rounding and far too small to bend the simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from sysid.estimation.bump_model import BumpModel, GroupArrays, group_residuals
from sysid.estimation.objective import Linearisation, RunMotion, Weights, simulate_runs

STEP = 1e-4


class MassColumns(NamedTuple):
    """Derivatives of the residuals (T, R, C, m) and gain residuals (R, C, m) of a group by the log factors."""

    residual: np.ndarray
    gain: np.ndarray


@jax.jit
def _residuals(arrays: GroupArrays, noise_sd, tempering, signals: jax.Array) -> tuple[jax.Array, jax.Array]:
    residual, gain = group_residuals(arrays, noise_sd, tempering, signals[..., None])
    return residual[..., 0], gain[..., 0]


def mass_columns(
    model: BumpModel, weights: Weights, log_parameters: np.ndarray, motion: RunMotion
) -> tuple[MassColumns, ...]:
    """Columns of every group about the declared masses, at log parameters (p,) and run motions."""
    count = len(model.masses.factors)
    shapes = [group.value.shape for group in model.groups]
    columns = tuple(MassColumns(np.zeros((*s, count)), np.zeros((*s[1:], count))) for s in shapes)
    if count == 0:
        return columns

    def residuals(trial: BumpModel) -> list[tuple[np.ndarray, np.ndarray]]:
        signals = simulate_runs(trial, log_parameters, motion)
        weighted = zip(model.arrays, weights.noise_sd, weights.tempering, signals, strict=True)
        found = [_residuals(arrays, noise, temper, jnp.asarray(shown)) for arrays, noise, temper, shown in weighted]
        return [(np.asarray(residual), np.asarray(gain)) for residual, gain in found]

    base = residuals(model)
    for k in range(count):
        moved = residuals(model.with_masses(STEP * np.eye(count)[k]))
        for column, (residual, gain), (here, gain_here) in zip(columns, moved, base, strict=True):
            column.residual[..., k] = (residual - here) / STEP
            column.gain[..., k] = (gain - gain_here) / STEP
    return columns


def with_columns(linearisations: Sequence[Linearisation], columns: Sequence[MassColumns]) -> tuple[Linearisation, ...]:
    """Linearisations whose derivatives by the masses stand between those by parameters and by a run's own unknowns."""

    def widened(derivatives: jax.Array, by_masses: np.ndarray) -> np.ndarray:
        old = np.asarray(derivatives)
        return np.concatenate([old[..., :-2], by_masses, old[..., -2:]], axis=-1)

    return tuple(
        lin._replace(
            residual_jacobian=widened(lin.residual_jacobian, one.residual),
            gain_jacobian=widened(lin.gain_jacobian, one.gain),
        )
        for lin, one in zip(linearisations, columns, strict=True)
    )


@dataclass(frozen=True)
class MassEffect:
    """What tolerances of masses do to the optimum of p parameters.

    `sensitivity` K (p, m): how far the optimum moves per log factor, and `by_data` how far without priors; `scatter`
    (p, p): by how much they scatter the scores, H_xm B B' H_mx; `asked` (m,): the log factors that the data would
    take, by one Gauss-Newton step; `spread` (m, m + 1) B = [Sigma^1/2, asked]: the tolerances and, since the optimum
    is not corrected for what the data ask for, that as well, as in a mean squared error.
    """

    sensitivity: np.ndarray
    by_data: np.ndarray
    scatter: np.ndarray
    asked: np.ndarray
    spread: np.ndarray


def mass_effect(information: np.ndarray, score: np.ndarray, prior: np.ndarray, sd: np.ndarray) -> MassEffect:
    """Effect of masses that have not been estimated.

    With P the prior precision, K = -(H_xx + P)^-1 H_xm and, since the score of the parameters vanishes at the optimum,
    asked = -(H_mm + Sigma^-1 + H_mx K)^-1 g_m.

    Parameters
    ----------
    information : (p + m, p + m) data information H of parameters and masses, the runs' own unknowns eliminated.
    score : (p + m,) gradient of the data at the optimum.
    prior : (p, p) prior precision P of the parameters.
    sd : (m,) tolerances.
    """
    count = prior.shape[0]
    cross = information[:count, count:]
    sensitivity = -np.linalg.solve(information[:count, :count] + prior, cross)
    left = information[count:, count:] + np.diag(sd**-2.0) + cross.T @ sensitivity
    by_data = shift_by_masses(information, count)
    asked = -np.linalg.solve(left, score[count:])
    spread = np.concatenate([np.diag(sd), asked[:, None]], axis=1)
    moved = cross @ spread
    return MassEffect(sensitivity, by_data, moved @ moved.T, asked, spread)


def shift_by_masses(information: np.ndarray, count: int) -> np.ndarray:
    """K = -H_xx^-1 H_xm (p, m): how far the optimum of the data alone moves per log mass factor.

    Parameters
    ----------
    information : (p + m, p + m) data information H; `count` p.
    """
    # Scaled, so that a parameter without data stays where it is.
    scale = np.sqrt(np.diag(information)[:count])
    scale = np.where(scale > 0.0, scale, 1.0)
    scaled = information[:count, :count] / np.outer(scale, scale) + 1e-10 * np.eye(count)
    return -np.linalg.solve(scaled, information[:count, count:] / scale[:, None]) / scale[:, None]
