"""Elimination of what belongs to one run only: its speed and its start, the last two unknowns of its residuals."""

from __future__ import annotations

import numpy as np


def run_normal(residual_columns: np.ndarray, gain_columns: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Normal matrix (R, 2, 2) of the runs' own unknowns, N = J'J + prior precision.

    Parameters
    ----------
    residual_columns, gain_columns : (T, R, C, 2) and (R, C, 2) derivatives by them.
    prior : (R, 2, 2) prior precision, see :meth:`sysid.estimation.residuals.run_motion.SpeedPrior.rows`.
    """
    normal = np.einsum("trck,trcl->rkl", residual_columns, residual_columns)
    normal += np.einsum("rck,rcl->rkl", gain_columns, gain_columns)
    return np.asarray(normal + prior)


def without_runs(normal: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Information (R, p, p) about p common unknowns, from normal matrices (R, p + 2, p + 2) of runs.

    Parameters
    ----------
    prior : (R, 2, 2) prior precision of the runs' own unknowns.
    """
    count = normal.shape[-1] - 2
    return np.asarray(normal[:, :count, :count] - normal[:, :count, count:] @ response_of_runs(normal, prior))


def response_of_runs(normal: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """How the runs' own unknowns go with the common ones at their best: N^-1 J_own' J, (R, 2, p); as `without_runs`."""
    count = normal.shape[-1] - 2
    of_runs = normal[:, count:, count:] + prior
    # A run whose data say nothing about its own unknowns must not divide by zero.
    of_runs += 1e-12 * np.trace(of_runs, axis1=1, axis2=2)[:, None, None] * np.eye(2)
    return np.asarray(np.linalg.solve(of_runs, normal[:, count:, :count]))
