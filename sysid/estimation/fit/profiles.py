"""Profile of the deviance of one parameter: all others optimised anew at fixed values of it.

S(x) is the cost (half the sum of squares, priors included). The profile of parameter x_k is D(v) = 2 (min over x with
x_k = v of S - S(x_hat)). For a quadratic cost it is ((v - x_hat_k) / sd)^2, with the standard deviation sd from the
curvature. The covariance of the fit is wider: it allows for model error and wrong masses. The deviance is therefore
divided by the ratio of the two variances, so that both agree near the optimum (A. Rotnitzky and N. P. Jewell,
Hypothesis testing of regression parameters in semiparametric generalized linear models for cluster correlated data,
Biometrika 77 (1990), doi:10.1093/biomet/77.3.485); its departure from a parabola shows where the covariance is
misleading.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import PchipInterpolator

from sysid.arrays import UnknownsOfFit
from sysid.display import Z90
from sysid.errors import DataRejectedError
from sysid.estimation.fit.fit_result import FitResult
from sysid.estimation.fit.minimiser import Evaluation, minimise
from sysid.estimation.fit.state import FitState
from sysid.progress import Progress, unwatched
from sysid.tabular import Tabular

if TYPE_CHECKING:
    import pandas as pd

#: Values at which the others are optimised, in standard deviations of the fit.
STEPS = (-3.0, -2.25, -1.5, -0.75, 0.75, 1.5, 2.25, 3.0)
#: 90 % quantile of chi-square with one degree of freedom.
LIMIT = Z90**2
_MOST_ITERATIONS = 30


@dataclass(frozen=True)
class ProfileLikelihood(Tabular):
    """Deviance of one parameter over its value, the others optimised anew.

    - `value` (n,) in `unit`: rising values, one of them the optimum;
    - `deviance` (n,): for independent noise;
    - `adjusted` (n,): the deviance divided by `inflation`, the ratio of the fit's variance to that of the curvature;
    - `converged` (n,).

    `interval` is the 90 % interval of the adjusted deviance, with NaN for an end beyond the values tried.
    `covariance_interval` is that of the fit's covariance, and `message` the result in words.
    """

    name: str
    unit: str
    best: float
    value: np.ndarray
    deviance: np.ndarray
    adjusted: np.ndarray
    inflation: float
    converged: np.ndarray
    interval: tuple[float, float]
    covariance_interval: tuple[float, float]
    message: str

    _in_row_unit = ("value",)

    def _row_units(self, table: pd.DataFrame) -> list[str]:
        return [self.unit] * len(table)

    def summary(self) -> pd.DataFrame:
        """One row per value."""
        import pandas as pd

        columns = {"value": self.value, "deviance": self.deviance, "adjusted": self.adjusted}
        return pd.DataFrame(columns | {"converged": self.converged})


def profile_deviance(
    evaluate: Evaluation,
    optimum: UnknownsOfFit,
    index: int,
    values: np.ndarray,
    *,
    relative_tolerance: float = 1e-7,
    on_value: Callable[[int], None] = lambda done: None,
) -> tuple[np.ndarray, np.ndarray]:
    """Deviance (n,) at `values` (n,) of unknown `index`, with all others optimised, and whether each search converged.

    From the optimum outwards, every search starts where the one before ended, moved as the Jacobian there says. Where
    it starts without a finite simulation, the deviance there and of values further out is NaN.

    Parameters
    ----------
    evaluate : returns residuals (m,) and Jacobian (m, p) at a vector (p,).
    optimum : (p,) minimum of the cost over all unknowns.
    """
    residual, _ = evaluate(optimum)
    lowest = float(residual @ residual)
    free = np.arange(optimum.size) != index
    deviance, converged = np.full(values.size, np.nan), np.zeros(values.size, bool)
    done = 0
    for side in (values < optimum[index], values >= optimum[index]):
        order = np.flatnonzero(side)
        at = optimum.copy()
        for k in order[np.argsort(np.abs(values[order] - optimum[index]))]:
            start = _moved(evaluate, at, index, float(values[k]))

            def fixed(others: np.ndarray, held: float = float(values[k])) -> tuple[np.ndarray, np.ndarray]:
                whole = np.empty(optimum.size)
                whole[free], whole[index] = others, held
                residual, jacobian = evaluate(whole)
                return residual, jacobian[:, free]

            try:
                minimum = minimise(
                    fixed, start[free], relative_tolerance=relative_tolerance, max_iterations=_MOST_ITERATIONS
                )
            except DataRejectedError:
                # No finite simulation there; what has been found nearer to the optimum is kept.
                break
            at = start.copy()
            at[free] = minimum.point
            deviance[k], converged[k] = 2.0 * minimum.cost - lowest, minimum.converged
            done += 1
            on_value(done)
    return deviance, converged


def _moved(evaluate: Evaluation, at: np.ndarray, index: int, value: float) -> np.ndarray:
    """The vector with one unknown at `value` and the others moved along the valley of the linear problem at `at`."""
    residual, jacobian = evaluate(at)
    free = np.arange(at.size) != index
    moved = at.copy()
    moved[index] = value
    shifted = residual + jacobian[:, index] * (value - at[index])
    scale = np.linalg.norm(jacobian[:, free], axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    moved[free] -= np.linalg.lstsq(jacobian[:, free] / scale, shifted, rcond=None)[0] / scale
    return moved


def interval_of(values: np.ndarray, deviance: np.ndarray, best: float, limit: float = LIMIT) -> tuple[float, float]:
    """Where the deviance reaches `limit` on both sides of `best`, NaN where it does not within the values.

    The signed root of the deviance, nearly straight, is interpolated.
    """
    root = np.sign(values - best) * np.sqrt(np.maximum(deviance, 0.0))
    ends = []
    for sign in (-1.0, 1.0):
        side = (values - best) * sign >= 0.0
        order = np.argsort(np.abs(values[side] - best))
        x, y = values[side][order], np.maximum.accumulate(np.abs(root[side][order]))
        if x.size < 2 or y[-1] < limit**0.5:
            ends.append(float("nan"))
            continue
        fine = np.linspace(0.0, 1.0, 2001)
        steps = np.abs(x - best)
        curve = PchipInterpolator(steps, y)(fine * steps[-1])
        ends.append(best + sign * float(np.interp(limit**0.5, curve, fine * steps[-1])))
    return ends[0], ends[1]


def profile_parameter(
    state: FitState,
    fit: FitResult,
    name: str,
    steps: tuple[float, ...] = STEPS,
    progress: Progress = unwatched,
) -> ProfileLikelihood:
    """Profile of one global parameter of a fit.

    Parameters
    ----------
    state : where the fit ended; fit : its results.
    name : of the parameter; steps : values to try, in standard deviations of the fit.
    """
    index = fit.names.index(name)
    problem = state.problem()
    vector = problem.vector(state.point.log_parameters)
    best, sd = float(vector[index]), float(np.sqrt(fit.covariance[index, index]))
    jacobian = problem.compressed(vector).jacobian
    curvature = float(np.linalg.inv(jacobian.T @ jacobian)[index, index])
    inflation = max(sd**2 / curvature, 1.0)
    values = best + sd * np.array(steps)

    def report(done: int) -> None:
        progress(f"profile of {name}", done / len(steps))

    deviance, converged = profile_deviance(problem.evaluate, vector, index, values, on_value=report)
    complete, tried = bool(converged.all()), np.isfinite(deviance)
    values, deviance, converged = values[tried], deviance[tried], converged[tried]
    at = int(np.searchsorted(values, best))
    values, deviance = np.insert(values, at, best), np.insert(deviance, at, 0.0)
    low, high = interval_of(values, deviance / inflation, best)
    return ProfileLikelihood(
        name,
        fit.parameters[index].unit,
        float(np.exp(best)),
        np.exp(values),
        deviance,
        deviance / inflation,
        inflation,
        np.insert(converged, at, True),
        (float(np.exp(low)), float(np.exp(high))),
        (float(np.exp(best - Z90 * sd)), float(np.exp(best + Z90 * sd))),
        _words(name, np.array([low, high]) - best, Z90 * sd, float(deviance.min()), complete),
    )


def _words(name: str, ends: np.ndarray, half: float, lowest: float, converged: bool) -> str:
    """What the profile says about the covariance's interval; `ends` and `half` about the optimum, in logarithms."""
    if lowest < -0.5:
        return f"The profile of {name} finds a better optimum than the fit; repeat the fit before using it."
    if not converged:
        return f"Not every search along {name} converged or could begin; its profile is rough or incomplete."
    if not np.isfinite(ends).any():
        return f"{name} is bounded on no side within three standard deviations: there is no interval."
    if not np.isfinite(ends).all():
        side = "below" if np.isnan(ends[0]) else "above"
        return f"{name} is not bounded {side} within three standard deviations: its interval is one-sided."
    off = float(np.abs(np.abs(ends) / half - 1.0).max())
    if off < 0.1:
        return f"The profile of {name} is a parabola: the interval of the covariance holds."
    return f"The profile of {name} bends: its interval differs from that of the covariance by up to {100 * off:.0f} %."
