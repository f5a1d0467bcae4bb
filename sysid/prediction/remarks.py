"""What has to be said about a predicted pass: extrapolation, suspension travel, impulses."""

from __future__ import annotations

import numpy as np

from sysid.arrays import Axles
from sysid.campaign.records import Axle, Campaign, PredictionRequest
from sysid.estimation.parameters.suspension_elements import law_elements
from sysid.prediction.predicted_passes import FASTER, Quantiles

#: Load ratio from which on a truck would have hit its stops.
ARTEFACT_RATIO = 3.0
#: The element of a suspension law that stops the motion at the declared travel.
BUMP_STOPS = "bump_stops"
#: Departure of the mean load of the whole truck over a pass from its weight that is worth a sentence.
_IMPULSE = 0.01


def knows_travel(axle: Axle) -> bool:
    """Whether the campaign file declares how far an axle moves to its stops, both ways."""
    return axle.jounce_travel_m is not None and axle.rebound_travel_m is not None


def has_bump_stops(axle: Axle) -> bool:
    """Whether the model stops an axle at its declared travel: no law is given stops but in the campaign file."""
    return BUMP_STOPS in law_elements(axle.suspension_law)


def driven_speeds(campaign: Campaign, load_case: str) -> list[float]:
    """Nominal speeds [m/s] of the runs of a load case."""
    return [r.nominal_speed_m_s for r in campaign.bump_runs if r.load_case == load_case]


def remarks(
    campaign: Campaign,
    request: PredictionRequest,
    peak_ratio: Axles,
    travel: tuple[Quantiles, Quantiles],
    impulse: float,
) -> tuple[str, ...]:
    """Sentences about one pass.

    Parameters
    ----------
    peak_ratio : (axles,) median peak ratio of every axle.
    travel : jounce and rebound travel (axles,) [m], both positive.
    impulse : mean of all wheel loads over the pass over the weight.
    """
    name = f"{request.load_case}, {3.6 * request.speed_m_s:g} km/h"
    if request.shape is not None:
        name += f", {request.shape.label}"
    sentences = [*_extrapolation(campaign, request, name), *_travel(campaign, name, peak_ratio, travel)]
    if abs(impulse - 1.0) > _IMPULSE:
        sentences.append(
            f"{name}: the wheel loads together carry {impulse:.3f} times the weight over the pass; the truck is not at "
            "rest again at the end of the record."
        )
    return tuple(sentences)


def _extrapolation(campaign: Campaign, request: PredictionRequest, name: str) -> list[str]:
    sentences = []
    driven = driven_speeds(campaign, request.load_case)
    if not driven:
        sentences.append(f"{name}: no run was driven in this load case; the prediction is an extrapolation.")
    elif request.speed_m_s > FASTER * max(driven):
        sentences.append(
            f"{name}: faster than any run of this load case ({3.6 * max(driven):g} km/h); the prediction is an "
            "extrapolation."
        )
    if request.shape is not None:
        sentences.append(f"{name}: no run crossed this bump; the prediction is an extrapolation.")
    return sentences


def _travel(campaign: Campaign, name: str, peak_ratio: Axles, travel: tuple[Quantiles, Quantiles]) -> list[str]:
    axles = campaign.vehicle.axles
    sentences = []
    for word, key, predicted in (
        ("compresses", "jounce_travel_m", travel[0]),
        ("extends", "rebound_travel_m", travel[1]),
    ):
        for i, axle in enumerate(axles):
            limit, most = getattr(axle, key), float((predicted.q50 if predicted.q95 is None else predicted.q95)[i])
            if limit is not None and most > limit and not has_bump_stops(axle):
                sentences.append(
                    f"{name}: axle {i + 1} {word} by up to {1e3 * most:.0f} mm, more than its {key} of "
                    f"{1e3 * limit:.0f} mm, and its suspension_law has no {BUMP_STOPS}: the load ratio there is not "
                    "that of the truck."
                )
    unknown = np.array([not knows_travel(axle) for axle in axles])
    if np.any(peak_ratio[unknown] >= ARTEFACT_RATIO):
        sentences.append(
            f"{name}: load ratios of {ARTEFACT_RATIO:g} and more come from a model without bump stops, and no "
            "suspension travel is declared in campaign.toml to judge whether the stops would be reached; do not use "
            "them as wheel loads."
        )
    return sentences
