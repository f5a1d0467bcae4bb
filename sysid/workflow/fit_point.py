"""What a finished fit keeps for the stages that follow: its result, and the point where it ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from sysid.campaign.records import Campaign
from sysid.estimation.bump_model import bump_model
from sysid.estimation.fit_options import FitOptions
from sysid.estimation.law_choice import laws_of_axles
from sysid.estimation.objective import RunMotion, Weights
from sysid.estimation.parameters import ParameterSet, campaign_parameters
from sysid.estimation.problem import FitState
from sysid.estimation.results import FitResult
from sysid.estimation.uncertain_masses import MassResponse
from sysid.road.results import RoadProfile
from sysid.sdof.results import DropSummary
from sysid.vehicle_model.lanes import MapTires


@dataclass(frozen=True)
class FitPoint:
    """A :class:`sysid.estimation.problem.FitState` without its model, which is built again from the campaign.

    `tires` are those that the model's footprint maps are made for, None for other contact laws.
    """

    log_parameters: np.ndarray
    motion: RunMotion
    weights: Weights
    adjustment: np.ndarray
    masses: MassResponse | None
    following: np.ndarray | None
    tires: MapTires | None


@dataclass(frozen=True)
class KeptFit:
    """The result of least squares and where it ended."""

    fit: FitResult
    point: FitPoint


def kept_fit(fit: FitResult, state: FitState) -> KeptFit:
    """What is kept of a fit and the state that it ended in."""
    of_state = {f.name: getattr(state, f.name) for f in fields(FitPoint) if f.name != "tires"}
    return KeptFit(fit, FitPoint(**of_state, tires=state.model.tires))


def fitted_parameters(campaign: Campaign, drops: DropSummary | None, fit: FitResult) -> ParameterSet:
    """The parameters of a fit, with the suspension laws that it chose."""
    return campaign_parameters(campaign, drops, laws_of_axles(campaign.vehicle, fit.laws))


def restored_state(
    campaign: Campaign,
    drops: DropSummary | None,
    profiles: Mapping[str, RoadProfile],
    kept: KeptFit,
    options: FitOptions,
) -> FitState:
    """The state that a fit ended in, its model built again.

    Parameters
    ----------
    campaign, drops, profiles, options : as the fit had them.
    """
    model = bump_model(
        campaign,
        fitted_parameters(campaign, drops, kept.fit),
        profiles,
        target_step_s=options.target_step_s,
        contact=options.contact,
        tires=kept.point.tires,
    )
    of_point = {f.name: getattr(kept.point, f.name) for f in fields(FitPoint) if f.name != "tires"}
    return FitState(model, **of_point)
