"""Derivatives of the residuals by the clocks of further loggers."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from sysid.estimation.residuals.problem import Problem
from sysid.estimation.residuals.run_clocks import RunClocks
from sysid.estimation.uncertainty.residual_columns import ResidualColumns, residuals_of_group
from sysid.vehicle_model.engines.protocol import Linearisation

#: Step of the derivative by a clock [s].
_STEP_S = 1e-4


def clock_columns(problem: Problem, position: int, here: Linearisation, clocks: RunClocks) -> ResidualColumns:
    """Derivatives of a group's residuals by offset and rate of each logger's clock, per standard deviation of those.

    Parameters
    ----------
    here : linearisation of the group, at which they are taken.
    """
    model, group = problem.model, problem.model.groups[position]
    shown = np.asarray(here.simulated)
    time, runs = model.shapes[position].interval_s * np.arange(shown.shape[0]), list(group.runs)
    # Differences of samples would miss a tenth of the slope at 25 Hz.
    slope = CubicSpline(time, shown, axis=0)(time, 1)
    residual, gain = [], []
    for k, logger in enumerate(clocks.loggers):
        of_logger = np.array([s.logger == logger for s in model.layout.sensors])
        late = (np.ones((time.size, len(runs))), time[:, None] - clocks.about_s[runs, k])
        for share, sd in zip(late, clocks.sd[runs, k].T, strict=True):
            moved = shown + _STEP_S * share[..., None] * slope * of_logger
            by_residual, by_gain = residuals_of_group(model, problem.weights, position, moved)
            residual.append((by_residual - np.asarray(here.residual)) / _STEP_S * sd[:, None])
            gain.append((by_gain - np.asarray(here.gain_residual)) / _STEP_S * sd[:, None])
    return ResidualColumns(np.stack(residual, axis=-1), np.stack(gain, axis=-1))
