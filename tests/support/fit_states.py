"""Finished fits without a fit: from a point that is given."""

from __future__ import annotations

import numpy as np

from sysid.arrays import Parameters
from sysid.campaign.records import Campaign
from sysid.estimation.fit.state import FitState, fit_point
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion


def state_at(
    campaign: Campaign, model: BumpModel, log_parameters: Parameters, motion: RunMotion, weights: Weights
) -> FitState:
    """A fit that ended at log parameters (p,) and run motions with exact masses and independent noise."""
    return FitState(campaign, fit_point(model, log_parameters, motion, weights, np.eye(log_parameters.size)), model)
