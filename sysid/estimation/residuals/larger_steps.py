"""The runs of a fit with larger integration steps, and the same signals at one parameter set.

A search or a sampler simulates thousands of parameter sets that lie close to each other.  Among them the error of the
integration hardly changes: with the signals y_h(x) of steps h at log parameters x and a set x_0 among them,

    y_h(x) = y_H(x) + [y_h(x_0) - y_H(x_0)] + (rest),    rest = 0 at x_0,

so steps H > h can be used if the records are corrected by the bracket.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.arrays import Parameters
from sysid.estimation.residuals.bump_model import BumpModel, GroupShape
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs

#: Steps [s] that are tried, the largest first.
STEPS_S = (0.005, 0.0025)
#: Largest relative RMS change of a channel by larger steps that is accepted. With a larger one, the remaining error
#: away from x_0 may no longer be small.
MOST_CHANGE = 0.02


def with_larger_steps(
    model: BumpModel, log_parameters: Parameters, motion: RunMotion, steps_s: Sequence[float] = STEPS_S
) -> BumpModel:
    """The same runs with the largest steps that change little, and records corrected by that change at x_0.

    Parameters
    ----------
    model : runs as the fit simulates them.
    log_parameters, motion : x_0, (p,) and of every run.
    steps_s : largest integration steps [s] to try; the steps divide every run's sample interval.

    Returns
    -------
    The model itself if its steps are already as large, or if some channel would change by more than :data:`MOST_CHANGE`
    of its RMS.
    """
    exact: tuple[np.ndarray, ...] | None = None
    for step in steps_s:
        larger = replace(model, shapes=tuple(_stretched(s, step) for s in model.shapes))
        if larger.shapes == model.shapes:
            break
        exact = exact or simulate_runs(model, log_parameters, motion)
        change = [b - a for a, b in zip(exact, simulate_runs(larger, log_parameters, motion), strict=True)]
        if max(map(relative_change, change, exact)) <= MOST_CHANGE:
            moved = [old._replace(value=old.value + d) for old, d in zip(model.arrays, change, strict=True)]
            return replace(larger, arrays=tuple(moved))
    return model


def _stretched(shape: GroupShape, step_s: float) -> GroupShape:
    fewest = max(1, int(np.ceil(shape.interval_s / step_s - 1e-9)))
    return shape._replace(substeps=min(shape.substeps, fewest))


def relative_change(change: np.ndarray, signals: np.ndarray) -> float:
    """Largest RMS of a change over that of its signal; infinite where a simulation breaks down."""
    size = np.sqrt((signals**2).mean(axis=0))
    ratio = np.sqrt((change**2).mean(axis=0)) / np.maximum(size, 1e-12)
    return float(np.nan_to_num(ratio, nan=np.inf).max())
