"""Parameters, priors, residuals and the least-squares fit."""

from sysid.estimation.bump_model import BumpModel, bump_model
from sysid.estimation.least_squares import FitOptions, FitState, fit_bump_runs
from sysid.estimation.levenberg_marquardt import Minimum, minimise
from sysid.estimation.parameters import Parameter, ParameterSet, campaign_parameters
from sysid.estimation.results import FitResult, ParameterEstimate, RunHistory

__all__ = [
    "BumpModel",
    "FitOptions",
    "FitResult",
    "FitState",
    "Minimum",
    "Parameter",
    "ParameterEstimate",
    "ParameterSet",
    "RunHistory",
    "bump_model",
    "campaign_parameters",
    "fit_bump_runs",
    "minimise",
]
