"""Parameters, priors, residuals and the least-squares fit."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sysid.lazy_names import lazy_names

if TYPE_CHECKING:
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

_HOMES = {
    "BumpModel": "sysid.estimation.residuals.bump_model",
    "FitOptions": "sysid.estimation.fit.options",
    "FitResult": "sysid.estimation.fit.fit_result",
    "FitState": "sysid.estimation.fit.state",
    "Minimum": "sysid.estimation.fit.minimiser",
    "Parameter": "sysid.estimation.parameters.parameter_set",
    "ParameterEstimate": "sysid.estimation.parameters.estimate",
    "ParameterSet": "sysid.estimation.parameters.parameter_set",
    "RunHistory": "sysid.estimation.residuals.run_history",
    "bump_model": "sysid.estimation.residuals.bump_model",
    "campaign_parameters": "sysid.estimation.parameters.campaign_parameters",
    "fit_bump_runs": "sysid.estimation.fit.least_squares",
    "fit_with_laws": "sysid.estimation.fit.law_choice",
    "minimise": "sysid.estimation.fit.minimiser",
}

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

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
