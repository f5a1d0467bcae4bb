"""Parameters, priors, residuals and the least-squares fit."""

from sysid.estimation.bump_model import BumpModel, bump_model
from sysid.estimation.fit_options import FitOptions
from sysid.estimation.law_choice import fit_with_laws
from sysid.estimation.least_squares import fit_bump_runs
from sysid.estimation.levenberg_marquardt import Minimum, minimise
from sysid.estimation.parameters import Parameter, ParameterSet, campaign_parameters
from sysid.estimation.problem import FitState
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
    "fit_with_laws",
    "minimise",
]
