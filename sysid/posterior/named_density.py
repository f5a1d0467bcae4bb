"""The density of a fit as a function of values, for residuals, optimisers and samplers of somebody's own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from sysid.arrays import ParametersByParameters
from sysid.estimation.fit.state import FitState
from sysid.estimation.residuals.histories import shown_signals
from sysid.estimation.residuals.run_history import RunHistory
from sysid.posterior.log_density import LogDensity


class NamedDensity:
    """Log-density of the parameters after the fit, and the readings that they make.

    It is the density that :meth:`sysid.Calibration.sample` draws from (:mod:`sysid.posterior.log_density`): residuals
    of all runs with everything else integrated out, and the priors.

    - `names` and `units` of the parameters, in the order of the values;
    - `optimum` (p,): values at the optimum, SI;
    - `log_covariance` (p, p): covariance of the logarithms in the normal approximation there.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    optimum: np.ndarray
    log_covariance: ParametersByParameters

    def __init__(self, state: FitState, histories: Sequence[RunHistory]):
        """`histories` are the measured ones of the fit, in the order of the campaign."""
        self._state, self._histories = state, tuple(histories)
        self.names = state.parameters.names
        self.units = tuple(p.unit for p in state.parameters.parameters)
        self.optimum = np.exp(np.asarray(state.point.mode, float))
        self.log_covariance = np.asarray(state.point.covariance, float)

    @cached_property
    def _density(self) -> LogDensity:
        return LogDensity(self._state)

    def values(self, changed: Mapping[str, float]) -> np.ndarray:
        """Values (p,) at the optimum, but for those that `changed` names, SI.

        Raises
        ------
        KeyError
            If the fit has no such parameter.
        """
        values = self.optimum.copy()
        for name, value in changed.items():
            if name not in self.names:
                raise KeyError(f"the fit has no parameter '{name}'; it has {', '.join(self.names)}")
            values[self.names.index(name)] = value
        return values

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Log-density (n,), up to a constant, of the logarithms of n sets of values (n, p), or (p,) for one; SI.

        Many sets at once take less time than one after the other. A set without a finite simulation has minus infinity.
        """
        return self._density(np.log(np.atleast_2d(np.asarray(values, float))))

    def simulate(self, values: np.ndarray) -> tuple[RunHistory, ...]:
        """Histories of all driven runs at values (p,): measured as they are, simulated as these values make them.

        The motions of the runs are those of the fit; offset and gain of every sensor suit the values best.
        """
        point, model = self._state.point, self._state.model
        signals = shown_signals(model, point.weights, point.motion, np.log(np.asarray(values, float)))
        simulated = dict[int, RunHistory]()
        for group, (shown, offset, gain) in zip(model.groups, signals, strict=True):
            for r, run in enumerate(group.runs):
                kept = self._histories[run]
                of_run = shown[: kept.time_s.size, r].T
                simulated[run] = replace(kept, simulated=of_run, offset=offset[r], gain=gain[r], band=None)
        return tuple(simulated[run] for run in sorted(simulated))
