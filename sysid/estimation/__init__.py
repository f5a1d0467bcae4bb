"""Parameters, priors, residuals and the least-squares fit."""

from sysid.estimation.fit.fit_result import FitResult
from sysid.estimation.fit.law_choice import fit_with_laws
from sysid.estimation.fit.least_squares import fit_bump_runs
from sysid.estimation.fit.minimiser import Minimum, minimise
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.fit.state import FitState
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.parameters.estimate import ParameterEstimate
from sysid.estimation.parameters.parameter_set import Parameter, ParameterSet
from sysid.estimation.residuals.bump_model import BumpModel, bump_model
from sysid.estimation.residuals.run_history import RunHistory

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
