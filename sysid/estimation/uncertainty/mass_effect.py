"""What tolerances of declared masses do to the optimum, from forward differences with the matrices assembled again.

A step of 1e-4 of a mass is far above rounding and far too small to bend the simulation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.arrays import Masses, Parameters, ParametersByMasses, ParametersByParameters
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.uncertainty.residual_columns import ResidualColumns, difference_columns
from sysid.estimation.uncertainty.uncertain_masses import UncertainMasses

STEP = 1e-4


def mass_columns(
    model: BumpModel, masses: UncertainMasses, weights: Weights, log_parameters: Parameters, motion: RunMotion
) -> tuple[ResidualColumns, ...]:
    """Columns of every group about the declared masses, at log parameters (p,) and run motions."""
    moved = STEP * np.eye(len(masses.factors))
    trials = [(model.with_vehicle(*masses.applied(by)), STEP) for by in moved]
    return difference_columns(model, weights, log_parameters, motion, trials)


@dataclass(frozen=True)
class MassEffect:
    """What tolerances of masses do to the optimum of p parameters.

    `sensitivity` K (p, m): how far the optimum moves per log factor, and `by_data` how far without priors; `scatter`
    (p, p): by how much they scatter the scores, H_xm B B' H_mx; `estimate` (m,): the log factors that the data would
    take, by one Gauss-Newton step; `spread` (m, m + 1) B = [Sigma^1/2, estimate]: the tolerances and, since the optimum
    is not corrected for what the data ask for, that as well, as in a mean squared error.
    """

    sensitivity: ParametersByMasses
    by_data: ParametersByMasses
    scatter: ParametersByParameters
    estimate: Masses
    spread: np.ndarray


def mass_effect(information: np.ndarray, score: np.ndarray, prior: ParametersByParameters, sd: Masses) -> MassEffect:
    """Effect of masses that have not been estimated.

    With P the prior precision, K = -(H_xx + P)^-1 H_xm and, since the score of the parameters vanishes at the optimum,
    estimate = -(H_mm + Sigma^-1 + H_mx K)^-1 g_m.

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
    estimate = -np.linalg.solve(left, score[count:])
    spread = np.concatenate([np.diag(sd), estimate[:, None]], axis=1)
    moved = cross @ spread
    return MassEffect(sensitivity, by_data, moved @ moved.T, estimate, spread)


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
