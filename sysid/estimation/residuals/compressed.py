"""The residuals of a campaign as a small problem with the same squares and products."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sysid.arrays import Parameters, Residuals, ResidualsByUnknowns
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.residuals.by_group import ByGroup, each_group
from sysid.estimation.residuals.run_motion import RUN_UNKNOWNS, MotionPrior, RunMotion
from sysid.threads import side_by_side
from sysid.vehicle_model.engines.protocol import Linearisation

#: Samples whose rows are multiplied together: a megabyte or so, which stays in the processor's cache.
_STRETCH = 128


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


def run_normals(linearisation: Linearisation) -> tuple[np.ndarray, ...]:
    """Per run the normal matrix B'B (p + 4, p + 4) of B = [J r], all its residuals, sensor gains included."""
    residual, jacobian, gain, gain_jacobian, _ = (np.asarray(array) for array in linearisation)

    def normal(r: int) -> np.ndarray:
        gains = np.concatenate([gain_jacobian[r], gain[r][:, None]], axis=1)
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(gains.T @ gains + _normal(jacobian[:, r], residual[:, r]))

    return side_by_side(normal, range(residual.shape[1]))


def _normal(jacobian: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """B'B (p + 4, p + 4) of the samples of one run, `jacobian` (T, C, p + 3) and `residual` (T, C).

    A stretch of samples at a time goes through one small block: copies of whole runs would be as large as J.
    """
    samples, channels, width = jacobian.shape
    room = np.empty((min(_STRETCH, samples), channels, width + 1))
    normal = np.zeros((width + 1, width + 1))
    for begin in range(0, samples, _STRETCH):
        stretch = slice(begin, min(begin + _STRETCH, samples))
        block = room[: stretch.stop - begin]
        block[..., :-1], block[..., -1] = jacobian[stretch], residual[stretch]
        flat = block.reshape(-1, width + 1)
        normal += flat.T @ flat
    return normal


def square_factor(normal: np.ndarray) -> np.ndarray:
    """F (n, n) with F'F = N for a normal matrix N (n, n), columns of zeros allowed.

    From the eigenvalues of the matrix with columns scaled to unit length: for thousands of rows and tens of columns a
    small part of the time of an orthogonal factorisation, and exact enough for scaled condition numbers far below 1e8.
    Of a matrix that is not finite it is NaN: a trial of a search, which is rejected for that.
    """
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
    if isinstance(linearisations, ByGroup):
        normals = each_group(lambda k: run_normals(linearisations[k]), len(linearisations))
    else:
        normals = tuple(map(run_normals, linearisations))
    factors = (square_factor(normal) for of_group in normals for normal in of_group)
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
