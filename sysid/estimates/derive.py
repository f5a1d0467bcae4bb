"""Derives the estimates of a campaign from the results of the stages before."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from sysid.estimates.calibrated import calibrated_vehicles
from sysid.estimates.calibrated_truck_modes import calibrated_modes
from sysid.estimates.loops import SuspensionLoops, suspension_loops
from sysid.estimates.records import Estimates
from sysid.estimates.suspension_values import suspension_estimates
from sysid.estimation.parameters.suspension_elements import LINEAR
from sysid.road.effective import AxleRoad, effective_profiles

if TYPE_CHECKING:
    from sysid.campaign.records import Campaign
    from sysid.estimation.fit.fit_result import FitResult
    from sysid.posterior.sampled_posterior import Posterior
    from sysid.road.road_profile import ScanAnalysis
    from sysid.sdof.drop_results import DropSummary


def derive_estimates(
    campaign: Campaign,
    drops: DropSummary | None,
    scans: Mapping[str, ScanAnalysis],
    fit: FitResult | None,
    posterior: Posterior | None,
) -> Estimates:
    """Everything that follows from the stages that have run; None (no scans: an empty mapping) for the others."""
    return Estimates(
        stiffness=suspension_estimates("stiffness", drops, fit, posterior),
        damping=suspension_estimates("damping", drops, fit, posterior),
        vehicles=() if fit is None else calibrated_vehicles(campaign, drops, fit, posterior),
        modes=() if fit is None else calibrated_modes(campaign, fit, posterior),
        loops=() if fit is None else _loops(campaign, drops, fit),
        roads=_felt_roads(campaign, scans),
    )


def _felt_roads(campaign: Campaign, scans: Mapping[str, ScanAnalysis]) -> dict[str, tuple[AxleRoad, ...]]:
    # Tires are declared at the axle loads of the first load case.
    case = next(iter(campaign.load_cases.values()))
    return {
        name: effective_profiles(campaign.vehicle, case, case, analysis.profile)
        for name, analysis in scans.items()
        if np.any(analysis.profile.height_m > 0.0)
    }


def _loops(campaign: Campaign, drops: DropSummary | None, fit: FitResult) -> tuple[SuspensionLoops, ...]:
    if set(fit.laws) == {LINEAR}:
        return ()
    cases = dict.fromkeys(history.load_case for history in fit.histories)
    return tuple(suspension_loops(campaign, drops, fit, case) for case in cases)
