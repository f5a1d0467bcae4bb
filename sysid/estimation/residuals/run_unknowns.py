"""What belongs to one run only: the last unknowns of its residuals.

These are the three of its motion, in some campaigns followed by the clocks of further loggers.
"""

from __future__ import annotations

import numpy as np

from sysid.arrays import (
    RunsByChannelsByUnknowns,
    RunsByUnknownsByUnknowns,
    SamplesByRunsByChannelsByUnknowns,
    UnknownsByUnknowns,
)


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


def with_own_priors(normal: UnknownsByUnknowns, prior: UnknownsByUnknowns) -> UnknownsByUnknowns:
    """Normal matrix (p + l, p + l) of one run with the prior precision (l, l) of its own unknowns, the last."""
    count = len(normal) - len(prior)
    whole = normal.copy()
    whole[count:, count:] = _never_singular(normal[None, count:, count:] + prior)[0]
    return whole


def _never_singular(normal: RunsByUnknownsByUnknowns) -> RunsByUnknownsByUnknowns:
    """Normal matrices of runs, of which one whose data say nothing about its own unknowns must not divide by zero."""
    little = 1e-12 * np.trace(normal, axis1=1, axis2=2)
    return np.asarray(normal + little[:, None, None] * np.eye(normal.shape[-1]))
