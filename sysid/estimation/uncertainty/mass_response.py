"""How masses and departures that were not estimated go with the parameters that were."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.arrays import DrawsByParameters, Parameters, ParametersByMasses, ParametersByParameters


@dataclass(frozen=True)
class MassResponse:
    """How the log factors d (m,) go with the global log parameters x (p,), `centre` x_hat at the optimum.

    By the data alone x = x_hat + K d + e: K d is how far masses that are d off move the optimum.  With d ~ N(0, Sigma)
    and the precision Q of x, whose inverse holds K Sigma K', d given x is normal about `response` (x - x_hat), response
    = Sigma K' Q, with covariance Sigma - Sigma K' Q K Sigma = `factor` `factor`'.  Priors of x play no part given x.
    """

    centre: Parameters
    response: np.ndarray
    factor: np.ndarray

    def draws(self, log_parameters: DrawsByParameters, random: np.random.Generator) -> np.ndarray:
        """One draw (n, m) of the log factors for every set (n, p) of log parameters."""
        noise = random.standard_normal((log_parameters.shape[0], self.factor.shape[1]))
        return np.asarray((log_parameters - self.centre) @ self.response.T + noise @ self.factor.T)


def mass_response(
    centre: Parameters, sensitivity: ParametersByMasses, spread: np.ndarray, precision: ParametersByParameters
) -> MassResponse:
    """Conditional distribution of the log factors given log parameters.

    Parameters
    ----------
    centre : (p,) optimum; sensitivity : (p, m) K.
    spread : (m, q) B with the covariance B B' of the factors.
    precision : (p, p) Q of the log parameters by the data, masses included.
    """
    moved = sensitivity @ spread
    solved = precision @ moved
    values, vectors = np.linalg.eigh(moved.T @ solved)
    # What the parameters do not say about the masses; rounding must not make it negative.
    left = np.sqrt(np.clip(1.0 - values, 0.0, 1.0))
    # The symmetric root is one only, so that rounding does not turn the draws.
    return MassResponse(centre, spread @ solved.T, spread @ (vectors * left) @ vectors.T)
