"""Elimination of what belongs to one run only: the last unknowns of its residuals.

These are the three of its motion, in some campaigns followed by the clocks of further loggers.
"""

from __future__ import annotations

import numpy as np

from sysid.arrays import RunsByChannelsByUnknowns, RunsByUnknownsByUnknowns, SamplesByRunsByChannelsByUnknowns


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
    return _never_singular(normal + prior)


def without_runs(normal: RunsByUnknownsByUnknowns, prior: RunsByUnknownsByUnknowns) -> RunsByUnknownsByUnknowns:
    """Information (R, p, p) about p common unknowns, from normal matrices (R, p + l, p + l) of runs.

    Parameters
    ----------
    prior : (R, l, l) prior precision of the runs' own unknowns.
    """
    count = normal.shape[-1] - prior.shape[-1]
    return np.asarray(normal[:, :count, :count] - normal[:, :count, count:] @ response_of_runs(normal, prior))


def response_of_runs(normal: RunsByUnknownsByUnknowns, prior: RunsByUnknownsByUnknowns) -> np.ndarray:
    """How the runs' own unknowns, optimised, follow the common ones: N^-1 J_run' J, (R, l, p); as `without_runs`."""
    count = normal.shape[-1] - prior.shape[-1]
    return np.asarray(np.linalg.solve(own_normal(normal, prior), normal[:, count:, :count]))


def own_normal(normal: RunsByUnknownsByUnknowns, prior: RunsByUnknownsByUnknowns) -> RunsByUnknownsByUnknowns:
    """N (R, l, l) of the runs' own unknowns with their priors; as `without_runs`."""
    count = normal.shape[-1] - prior.shape[-1]
    return _never_singular(normal[:, count:, count:] + prior)


def _never_singular(normal: RunsByUnknownsByUnknowns) -> RunsByUnknownsByUnknowns:
    """Normal matrices of runs, of which one whose data say nothing about its own unknowns must not divide by zero."""
    little = 1e-12 * np.trace(normal, axis1=1, axis2=2)
    return np.asarray(normal + little[:, None, None] * np.eye(normal.shape[-1]))
