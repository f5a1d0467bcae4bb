"""How masses and departures go with the parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.arrays import DrawsByParameters, Parameters, ParametersByParameters


@dataclass(frozen=True)
class MassResponse:
    """Masses and departures y (q,) given the global log parameters x (p,): normal, with a mean that follows these.

    mean = `amounts` + `response` (x - `centre`), covariance `factor` `factor`'; `amounts` and `centre` are the joint
    optimum.  Priors of x play no part given x.  It is the response of a linear model, also where the posterior of x is
    curved.
    """

    centre: Parameters
    response: np.ndarray
    factor: np.ndarray
    amounts: np.ndarray

    def sd(self, covariance: ParametersByParameters) -> np.ndarray:
        """Standard deviations (q,) with parameters of the given covariance (p, p)."""
        carried = np.einsum("qi,ij,qj->q", self.response, covariance, self.response)
        return np.asarray(np.sqrt((self.factor**2).sum(axis=1) + carried))

    def mean(self, log_parameters: DrawsByParameters) -> np.ndarray:
        """The most likely y (n, q) for every set (n, p) of log parameters."""
        return np.asarray(self.amounts + (log_parameters - self.centre) @ self.response.T)

    def draws(self, log_parameters: DrawsByParameters, random: np.random.Generator) -> np.ndarray:
        """One draw (n, q) for every set (n, p) of log parameters."""
        noise = random.standard_normal((log_parameters.shape[0], self.factor.shape[1]))
        return np.asarray(self.mean(log_parameters) + noise @ self.factor.T)
