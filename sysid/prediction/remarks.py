"""What has to be said about a predicted pass: extrapolation, suspension travel, impulses."""

from __future__ import annotations

import numpy as np

from sysid.campaign.records import Campaign, PredictionRequest
from sysid.prediction.results import FASTER, Quantiles

#: Load ratio above which a truck would have hit its stops.
ARTEFACT_RATIO = 3.0
#: Departure of the mean load of the whole truck over a pass from its weight that is worth a sentence.
_IMPULSE = 0.01


def driven_speeds(campaign: Campaign, load_case: str) -> list[float]:
    """Nominal speeds [m/s] of the runs of a load case."""
    return [r.nominal_speed_m_s for r in campaign.bump_runs if r.load_case == load_case]


def remarks(
    campaign: Campaign,
    request: PredictionRequest,
    peak_ratio: np.ndarray,
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
    found = [*_extrapolation(campaign, request, name), *_travel(campaign, name, peak_ratio, travel)]
    if abs(impulse - 1.0) > _IMPULSE:
        found.append(
            f"{name}: the wheel loads together carry {impulse:.3f} times the weight over the pass; the truck is not at "
            "rest again at the end of the record."
        )
    return tuple(found)


def _extrapolation(campaign: Campaign, request: PredictionRequest, name: str) -> list[str]:
    found = []
    driven = driven_speeds(campaign, request.load_case)
    if not driven:
        found.append(f"{name}: no run was driven in this load case; the prediction is an extrapolation.")
    elif request.speed_m_s > FASTER * max(driven):
        found.append(
            f"{name}: faster than any run of this load case ({3.6 * max(driven):g} km/h); the prediction is an "
            "extrapolation."
        )
    if request.shape is not None:
        found.append(f"{name}: no run crossed this bump; the prediction is an extrapolation.")
    return found


def _travel(campaign: Campaign, name: str, peak_ratio: np.ndarray, travel: tuple[Quantiles, Quantiles]) -> list[str]:
    axles = campaign.vehicle.axles
    found = []
    for word, key, predicted in (
        ("compresses", "jounce_travel_m", travel[0]),
        ("extends", "rebound_travel_m", travel[1]),
    ):
        for i, axle in enumerate(axles):
            limit, most = getattr(axle, key), float((predicted.q50 if predicted.q95 is None else predicted.q95)[i])
            if limit is not None and most > limit:
                found.append(
                    f"{name}: axle {i + 1} {word} by up to {1e3 * most:.0f} mm, more than its {key} of "
                    f"{1e3 * limit:.0f} mm; unless its law has bump_stops the load ratio there is not that of the "
                    "truck."
                )
    declared = [a.jounce_travel_m is not None and a.rebound_travel_m is not None for a in axles]
    if np.any(peak_ratio[~np.array(declared)] > ARTEFACT_RATIO):
        found.append(
            f"{name}: load ratios above {ARTEFACT_RATIO:g} come from a model without bump stops, and no suspension "
            "travel is declared in campaign.toml to judge whether the stops would be reached; do not use them as wheel "
            "loads."
        )
    return found
