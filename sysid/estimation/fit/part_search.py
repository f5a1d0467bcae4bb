"""Undeclared parts that the residuals require: rockers between springs, frames that bend, another drive."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from sysid.campaign.records import Campaign
from sysid.estimation.fit.drive_search import drive_candidates
from sysid.estimation.fit.frame_search import frame_candidates, modal_mass_candidates
from sysid.estimation.fit.least_squares import optimise
from sysid.estimation.fit.minimiser import promised_fall
from sysid.estimation.fit.optimum import Optimum, effective_residuals, worth_a_search
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.fit.part_score import PartCandidate, part_scores
from sysid.estimation.fit.rocker_search import rocker_candidates
from sysid.estimation.fit.search_plan import trial
from sysid.estimation.fit.thresholds import DECISIVE
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.parameters.law_families import Laws
from sysid.estimation.parameters.undeclared_parts import UndeclaredParts
from sysid.progress import Progress
from sysid.road.road_profile import RoadProfile
from sysid.sdof.drop_results import DropSummary

#: Largest number of parts that are added.
_MOST = 4


def undeclared_parts(
    campaign: Campaign,
    laws: Laws,
    optimum: Optimum,
    drops: DropSummary | None,
    profiles: Mapping[str, RoadProfile],
    options: FitOptions,
    report: Progress,
    *,
    law_gain: Callable[[Campaign, Optimum], float],
) -> tuple[UndeclaredParts, Optimum]:
    """Parts that the residuals of a fit require, and an optimum with them under the same weights and maps.

    A part is fitted if its expected gain by a score test is decisive, and larger than that of any richer suspension
    law. The gain of this fit decides, over the cost at which a search without the part would end. If the residuals are
    near the noise, the part must be expected to explain a good share of them
    (:func:`sysid.estimation.fit.optimum.worth_a_search`).

    Parameters
    ----------
    laws : of every axle, those of `optimum`. drops, profiles, options, report : as
    :func:`sysid.estimation.fit.law_choice.fit_with_laws`. law_gain : largest expected gain of richer suspension laws at
    an optimum.
    """
    parts = UndeclaredParts()
    for _ in range(_MOST):
        decides = DECISIVE + float(np.log(effective_residuals(optimum)))
        scores = part_scores(campaign, optimum, candidates_of(campaign))
        promising = [s for s in scores if s.amplitude > s.candidate.least and s.gain > decides]
        if not promising or not worth_a_search(optimum, promising[0].gain):
            break
        if promising[0].gain < law_gain(campaign, optimum):
            break
        best = promising[0].candidate
        report(best.words, 0.5)
        added = best.unknown.in_campaign(campaign)
        fitted = _fitted(added, laws, optimum, drops, profiles, options, report)
        stays = 2.0 * (_cost_at_end(optimum) - fitted.minimum.cost) >= decides and best.plausible(fitted)
        fitted.problem.forget()
        if not stays:
            break
        parts, campaign, optimum = parts + best.unknown, added, fitted
    return parts, optimum


def _fitted(
    campaign: Campaign,
    laws: Laws,
    near: Optimum,
    drops: DropSummary | None,
    profiles: Mapping[str, RoadProfile],
    options: FitOptions,
    report: Progress,
) -> Optimum:
    """The optimum with a part, under the weights and maps of the one without, so that costs can be compared."""
    parameters = campaign_parameters(campaign, drops, laws)
    return optimise(campaign, parameters, profiles, options, report, plan=trial, near=near)


def _cost_at_end(optimum: Optimum) -> float:
    """What the cost of a search that may have ended early would fall to, by the linearised model."""
    here = optimum.problem.compressed(optimum.vector)
    optimum.problem.forget()
    return optimum.minimum.cost - promised_fall(here.residual, here.jacobian)


def candidates_of(campaign: Campaign) -> tuple[PartCandidate, ...]:
    """All parts that are searched for."""
    vehicle = campaign.vehicle
    return (
        *rocker_candidates(vehicle),
        *frame_candidates(vehicle),
        *modal_mass_candidates(campaign),
        *drive_candidates(campaign),
    )
