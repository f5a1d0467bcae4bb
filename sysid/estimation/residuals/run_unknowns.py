"""Elimination of what belongs to one run only: its motion, the last three unknowns of its residuals."""

from __future__ import annotations

import numpy as np

from sysid.arrays import RunsByChannelsByUnknowns, RunsByUnknownsByUnknowns, SamplesByRunsByChannelsByUnknowns
from sysid.estimation.residuals.run_motion import RUN_UNKNOWNS


def run_normal(
    residual_columns: SamplesByRunsByChannelsByUnknowns,
    gain_columns: RunsByChannelsByUnknowns,
    prior: RunsByUnknownsByUnknowns,
) -> RunsByUnknownsByUnknowns:
    """Normal matrix (R, 3, 3) of the runs' own unknowns, N = J'J + prior precision.

    Parameters
    ----------
    residual_columns, gain_columns : (T, R, C, 3) and (R, C, 3) derivatives by them.
    prior : (R, 3, 3) prior precision, see :meth:`sysid.estimation.residuals.run_motion.MotionPrior.precision`.
    """
    normal = np.einsum("trck,trcl->rkl", residual_columns, residual_columns)
    normal += np.einsum("rck,rcl->rkl", gain_columns, gain_columns)
    return np.asarray(normal + prior)


def without_runs(normal: RunsByUnknownsByUnknowns, prior: RunsByUnknownsByUnknowns) -> RunsByUnknownsByUnknowns:
    """Information (R, p, p) about p common unknowns, from normal matrices (R, p + 3, p + 3) of runs.

    Parameters
    ----------
    prior : (R, 3, 3) prior precision of the runs' own unknowns.
    """
    count = normal.shape[-1] - RUN_UNKNOWNS
    return np.asarray(normal[:, :count, :count] - normal[:, :count, count:] @ response_of_runs(normal, prior))


def response_of_runs(normal: RunsByUnknownsByUnknowns, prior: RunsByUnknownsByUnknowns) -> np.ndarray:
    """How the runs' own unknowns follow the common ones at their best: N^-1 J_run' J, (R, 3, p); as `without_runs`."""
    count = normal.shape[-1] - RUN_UNKNOWNS
    of_runs = normal[:, count:, count:] + prior
    # A run whose data say nothing about its own unknowns must not divide by zero.
    of_runs += 1e-12 * np.trace(of_runs, axis1=1, axis2=2)[:, None, None] * np.eye(RUN_UNKNOWNS)
    return np.asarray(np.linalg.solve(of_runs, normal[:, count:, :count]))
