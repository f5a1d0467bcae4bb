"""The result of a finished fit for later stages: one record, from which all of them start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sysid.arrays import Parameters, ParametersByParameters
from sysid.campaign.clocks.moved import on_moved_clocks
from sysid.campaign.loggers import ClockFinding
from sysid.campaign.records import Campaign
from sysid.estimation.parameters.parameter_set import ParameterSet
from sysid.estimation.parameters.undeclared_parts import NO_PARTS, UndeclaredParts
from sysid.estimation.residuals.bump_model import BumpModel, bump_model
from sysid.estimation.residuals.problem import Problem
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.side_signals import with_sides
from sysid.estimation.uncertainty.allowances import Allowances, campaign_allowances
from sysid.estimation.uncertainty.integrated_unknowns import IntegratedUnknowns
from sysid.estimation.uncertainty.mass_response import MassResponse
from sysid.road.contact_laws import ContactLaw
from sysid.road.road_profile import RoadProfile
from sysid.vehicle_model.passes import MapTires


@dataclass(frozen=True)
class FitPoint:
    """The end of a fit and its settings: what is stored for later stages, in addition to the results for users.

    - `parameters` with their priors and laws;
    - `contact`, `tires` of the footprint maps (None for the declared ones) and `target_step_s` of the integration
      describe the simulation;
    - `log_parameters` (p,) and `motion`: the optimum;
    - `weights`: of the residuals at the optimum;
    - `mode` (p,) and `covariance` (p, p): the normal approximation of the posterior of the log parameters, with
      everything else integrated out; `integrated` says what that is, None for nothing;
    - `amounts` (q,): masses and departures at the optimum, and `mass_response`: how they depend on the parameters; both
      None for the vehicle as declared;
    - `parts` were added to the declared vehicle;
    - `clocks`: those of further loggers after the fit; none if the fit has not moved any.
    """

    parameters: ParameterSet
    contact: ContactLaw
    tires: MapTires | None
    target_step_s: float
    log_parameters: Parameters
    motion: RunMotion
    weights: Weights
    mode: Parameters
    covariance: ParametersByParameters
    integrated: IntegratedUnknowns | None = None
    amounts: np.ndarray | None = None
    mass_response: MassResponse | None = None
    parts: UndeclaredParts = NO_PARTS
    clocks: tuple[ClockFinding, ...] = ()

    def in_campaign(self, campaign: Campaign) -> Campaign:
        """A campaign, as its file declares it, with what the fit has added and moved."""
        return on_moved_clocks(self.parts.in_campaign(campaign), self.clocks)


@dataclass(frozen=True)
class FitState:
    """A finished fit: the screened `campaign` with the parts that the fit added and the clocks that it found, the
    stored `point`, and the `model` of its runs.
    """

    campaign: Campaign
    point: FitPoint
    model: BumpModel

    @property
    def parameters(self) -> ParameterSet:
        """Parameters with their priors and laws."""
        return self.point.parameters

    @property
    def profiles(self) -> Mapping[str, RoadProfile]:
        """Road profile of each bump."""
        return self.model.felt.profiles

    @cached_property
    def allowances(self) -> Allowances:
        """Masses and departures beside the parameters."""
        return campaign_allowances(self.campaign, self.point.parameters, self.model.felt)

    def problem(self) -> Problem:
        """The residuals of the fit as a function of one vector, at its weights and about its motions."""
        return Problem(self.model, self.campaign, self.point.motion, self.point.weights)


def fit_point(
    model: BumpModel,
    log_parameters: Parameters,
    motion: RunMotion,
    weights: Weights,
    covariance: ParametersByParameters,
) -> FitPoint:
    """What is stored of a fit of `model`, with exact masses."""
    return FitPoint(
        parameters=model.parameters,
        contact=model.felt.contact,
        tires=model.tires,
        target_step_s=model.target_step_s,
        log_parameters=log_parameters,
        motion=motion,
        weights=weights,
        mode=log_parameters,
        covariance=covariance,
    )


def restored(campaign: Campaign, profiles: Mapping[str, RoadProfile], point: FitPoint) -> FitState:
    """The fit of a campaign, as its file declares it, from what was stored of it.

    Parameters
    ----------
    campaign : screened, the one that was fitted.
    profiles : road profile of each bump, those of the fit.
    """
    campaign = point.in_campaign(campaign)
    return FitState(campaign, point, model_of(campaign, profiles, point))


def model_of(
    campaign: Campaign, profiles: Mapping[str, RoadProfile], point: FitPoint, fitted: Campaign | None = None
) -> BumpModel:
    """The model of the bump runs of `campaign` as a fit simulates them: same contact, tires, step, parameters, masses.

    Parameters
    ----------
    fitted : the campaign of the fit, where `campaign` has other runs.
    """
    model = bump_model(
        campaign,
        point.parameters,
        profiles,
        target_step_s=point.target_step_s,
        contact=point.contact,
        tires=point.tires,
    )
    if point.amounts is not None:
        model = campaign_allowances(fitted or campaign, point.parameters, model.felt).moved(model, point.amounts)
    # Motions of other runs are not known yet.
    return with_sides(model, point.log_parameters, point.motion) if fitted is None else model
