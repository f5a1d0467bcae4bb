"""The residuals of a campaign as a small problem with the same squares and products."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from sysid.arrays import Parameters, Residuals, ResidualsByUnknowns
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.residuals.run_motion import RUN_UNKNOWNS, MotionPrior, RunMotion
from sysid.vehicle_model.engines.protocol import Linearisation


class Compressed(NamedTuple):
    """Residual vector (m,) and Jacobian (m, p + 3 runs) with the squares and products of the full problem.

    The residuals of each run are replaced by a square factor F with F'F = [J r]'[J r]: it carries the same r'r, J'r and
    J'J, so Gauss-Newton and Levenberg-Marquardt steps are unchanged.  Run-local columns follow the global ones:
    the motion of the first run of the first group, and so on.
    """

    residual: Residuals
    jacobian: ResidualsByUnknowns


def run_order(model: BumpModel) -> list[int]:
    """Campaign indices of the runs in the order of their local columns."""
    return [run for group in model.groups for run in group.runs]


def run_blocks(linearisation: Linearisation) -> Iterator[np.ndarray]:
    """Per run, one at a time, the matrix [J r] (rows, p + 4) of all its residuals, sensor gains included."""
    residual, jacobian = np.asarray(linearisation.residual), np.asarray(linearisation.residual_jacobian)
    gain, gain_jacobian = np.asarray(linearisation.gain_residual), np.asarray(linearisation.gain_jacobian)
    samples, _, channels, width = jacobian.shape
    for r in range(residual.shape[1]):
        block = np.empty((samples + 1, channels, width + 1))
        block[:-1, :, :-1], block[:-1, :, -1] = jacobian[:, r], residual[:, r]
        block[-1, :, :-1], block[-1, :, -1] = gain_jacobian[r], gain[r]
        yield block.reshape(-1, width + 1)


def square_factor(block: np.ndarray) -> np.ndarray:
    """F (n, n) with F'F = B'B for a tall block B (m, n), columns of zeros allowed.

    From the eigenvalues of the normal matrix with columns scaled to unit length: for thousands of rows and tens of
    columns a small part of the time of an orthogonal factorisation, and exact enough for scaled condition numbers far
    below 1e8.  Of a block that is not finite it is NaN: a trial of a search, which is rejected for that.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        normal = block.T @ block
    if not np.isfinite(normal).all():
        return np.full_like(normal, np.nan)
    length = np.sqrt(np.diag(normal))
    scale = np.where(length > 0.0, length, 1.0)
    values, vectors = np.linalg.eigh(normal / scale[:, None] / scale)
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * scale)


def compress(
    model: BumpModel,
    linearisations: Sequence[Linearisation],
    log_parameters: Parameters,
    motion: RunMotion,
    expected: MotionPrior,
) -> Compressed:
    """Assemble the compressed problem: data, sensor gains, global priors and the priors of the runs' motions."""
    count = log_parameters.shape[0]
    order = run_order(model)
    width = count + RUN_UNKNOWNS * len(order)
    factors = (square_factor(block) for lin in linearisations for block in run_blocks(lin))
    residuals, jacobians = [], []
    for position, factor in enumerate(factors):
        wide = np.zeros((factor.shape[0], width))
        wide[:, :count] = factor[:, :count]
        begin = count + RUN_UNKNOWNS * position
        wide[:, begin : begin + RUN_UNKNOWNS] = factor[:, count : count + RUN_UNKNOWNS]
        residuals.append(factor[:, -1])
        jacobians.append(wide)
    rows, targets = model.parameters.prior_rows()
    residuals.append(rows @ log_parameters - targets)
    jacobians.append(np.concatenate([rows, np.zeros((len(targets), width - count))], axis=1))
    for position, (residual, derivative) in enumerate(zip(*expected.rows(motion, order), strict=True)):
        residuals.append(residual)
        wide = np.zeros((residual.size, width))
        wide[:, count + RUN_UNKNOWNS * position : count + RUN_UNKNOWNS * (position + 1)] = derivative
        jacobians.append(wide)
    return Compressed(np.concatenate(residuals), np.concatenate(jacobians))
