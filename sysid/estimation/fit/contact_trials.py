"""The fit repeated with the other contact laws of the tires."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import get_args

import numpy as np

from sysid.campaign.records import Campaign
from sysid.estimation.fit.fit_result import ContactTrial
from sysid.estimation.fit.least_squares import optimise
from sysid.estimation.fit.optimum import Optimum
from sysid.estimation.fit.options import FitOptions
from sysid.progress import Progress, unwatched
from sysid.road.contact_laws import ContactLaw
from sysid.road.road_profile import RoadProfile


def contact_trials(
    campaign: Campaign,
    optimum: Optimum,
    profiles: Mapping[str, RoadProfile],
    options: FitOptions,
    progress: Progress | None = None,
) -> tuple[ContactTrial, ...]:
    """The fit repeated with every contact law: how much the result depends on the model of the contact.

    All are fits of the vehicle as declared, without departures towards the other laws.

    Parameters
    ----------
    optimum : of the contact law in `options`, whose suspension laws and parameters are kept; it comes first. profiles,
    options, progress : as :func:`sysid.estimation.fit.law_choice.fit_with_laws`.
    """
    report = progress or unwatched
    parameters = optimum.problem.model.parameters

    def trial(contact: str, optimum: Optimum) -> ContactTrial:
        values = np.exp(optimum.vector[: optimum.problem.count])
        return ContactTrial(contact, optimum.misfit, tuple(float(v) for v in values))

    def repeating(message: str, fraction: float) -> None:
        report(f"other contact laws, {message}", fraction)

    trials = [trial(options.contact, optimum)]
    for contact in get_args(ContactLaw):
        if contact != options.contact:
            how = replace(options, contact=contact)
            trials.append(trial(contact, optimise(campaign, parameters, profiles, how, repeating, near=optimum)))
    return tuple(trials)
