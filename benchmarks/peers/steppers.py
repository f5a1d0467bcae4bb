"""Runs of the truck by SciPy and SUNDIALS, with the right-hand side in numba."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.peers import equations
from benchmarks.peers.constants import Acquisition, RunConstants

#: An adaptive solver steps over the bump unless its steps are kept below this [s].
MAX_STEP_S = 0.02
#: Positions are hundredths of a metre, rates tenths of a metre per second.
ABSOLUTE = 0.01

Solver = Callable[[RunConstants, np.ndarray, float], np.ndarray]


def _size(constants: RunConstants) -> int:
    return 2 * (constants.position.shape[1] + constants.rest.size)


def scipy_solver(method: str, max_step_s: float = MAX_STEP_S) -> Solver:
    """States (T, n) by `scipy.integrate.solve_ivp`."""

    def solve(constants: RunConstants, times: np.ndarray, tolerance: float) -> np.ndarray:
        extension = np.empty(constants.rest.size)

        def right(t, y):
            out = np.empty_like(y)
            equations.rates(t, y, out, constants, extension)
            return out

        found = solve_ivp(
            right,
            (times[0], times[-1]),
            np.zeros(_size(constants)),
            method=method,
            t_eval=times,
            rtol=tolerance,
            atol=ABSOLUTE * tolerance,
            max_step=max_step_s,
        )
        return np.ascontiguousarray(found.y.T)

    return solve


def sundials_solver(method: str) -> Solver:
    """States (T, n) by SUNDIALS CVODE through scikit-sundae."""
    from sksundae.cvode import CVODE

    def solve(constants: RunConstants, times: np.ndarray, tolerance: float) -> np.ndarray:
        extension = np.empty(constants.rest.size)

        def right(t, y, yp):
            equations.rates(t, y, yp, constants, extension)

        solver = CVODE(
            right,
            method=method,
            rtol=tolerance,
            atol=ABSOLUTE * tolerance,
            max_step=MAX_STEP_S,
            max_num_steps=100_000,
        )
        return np.ascontiguousarray(solver.solve(times, np.zeros(_size(constants))).y)

    return solve


def run_signals(solve: Solver, runs: list[RunConstants], acquisition: Acquisition, tolerance: float) -> np.ndarray:
    """Filtered signals (T, R, C) of all runs."""
    times, layout = acquisition.times, acquisition.layout
    deflection, acceleration = np.array(layout.deflection_axles), np.array(layout.acceleration_axles)
    every = [equations.signals(times, solve(c, times, tolerance), deflection, acceleration, c) for c in runs]
    return acquisition.shown(np.stack(every, axis=1))
