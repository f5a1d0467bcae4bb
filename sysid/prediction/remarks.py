"""What has to be said about a predicted pass: extrapolation, suspension travel, impulses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sysid.campaign.records import Campaign, PredictionRequest
from sysid.campaign.requests import beyond_runs, pass_label
from sysid.prediction.trust import Extrapolation
from sysid.road.contact_laws import CONTACT_LAWS
from sysid.vehicle_model.passes import EffectiveRoads

#: Departure of the mean load of the whole truck over a pass from its weight that is worth a sentence.
_IMPULSE = 0.01
#: Load by which a footprint map departs from the radial springs over a bump, in shares of the load at rest, that is
#: worth a sentence: smooth bumps have 0.01 to 0.07, planks up to 0.25, where loads were 12 to 32 % of their change off.
_EDGES = 0.1
#: Quantities of a pass that are compared with the driven runs: words, factor and unit for people.
_QUANTITIES = {
    "tire_deflection": ("tire deflection", 1e3, "mm"),
    "travel": ("suspension travel", 1e3, "mm"),
    "damper_speed": ("damper speed", 1.0, "m/s"),
}


def remarks(
    campaign: Campaign,
    request: PredictionRequest,
    trust: Sequence[Extrapolation],
    impulse: float,
    acting: Mapping[int, tuple[str, float]] | None = None,
) -> tuple[str, ...]:
    """Sentences about one pass.

    Parameters
    ----------
    trust : what of the pass goes beyond the driven runs. impulse : mean of all axle loads during the pass over the
    weight. acting : undeclared bump stops that act, by axle (index): direction and travel [m].
    """
    name = pass_label(campaign, request)
    sentences = [*beyond_runs(campaign, request), *_beyond(trust, name)]
    if acting:
        stops = ", ".join(f"axle {i + 1} in {way} at about {1e3 * m:.0f} mm" for i, (way, m) in sorted(acting.items()))
        sentences.append(
            f"{name}: bump stops act that are assumed, not declared: {stops}. Declare jounce_travel_m and "
            "rebound_travel_m if the travel is known."
        )
    if abs(impulse - 1.0) > _IMPULSE:
        sentences.append(
            f"{name}: averaged over the pass the axle loads sum to {impulse:.3f} times the weight; the truck is not "
            "at rest again at the end of the record."
        )
    return tuple(sentences)


def edges(campaign: Campaign, request: PredictionRequest, roads: EffectiveRoads) -> tuple[str, ...]:
    """A sentence about a bump whose edges the footprint maps do not follow; none over smooth bumps."""
    if not CONTACT_LAWS[roads.contact].follows_tires:
        return ()
    loads = (m * roads.vehicle.gravity_m_s2 for m in roads.load_cases[request.load_case].axle_loads_kg)
    each = zip(roads.maps(request.load_case, request.bump), roads.tires.stiffness_N_per_m, loads, strict=True)
    misfit = max(one.misfit_m * stiffness / load for one, stiffness, load in each)
    if misfit <= _EDGES:
        return ()
    return (
        f"{pass_label(campaign, request)}: the bump has edges that a tire does not smooth as the model takes it; loads "
        f"over it may be off by {100.0 * misfit:.0f} % of the static load. Predict a pass over its profile as a road "
        "of at most 100 m, where the springs of the tires are followed: predict --road FILE.",
    )


def _beyond(trust: Sequence[Extrapolation], name: str) -> list[str]:
    """One sentence per quantity that goes beyond the driven runs, the speed left out."""
    sentences = []
    for what, (words, factor, unit) in _QUANTITIES.items():
        of_axles = [e for e in trust if e.what == what]
        if of_axles:
            axles = ", ".join(
                f"axle {e.axle + 1} {factor * e.reached:.3g} {unit} (driven {factor * e.driven:.3g} {unit})"
                for e in of_axles
            )
            sentences.append(
                f"{name}: {words} goes beyond the driven runs: {axles}; the loads there are an extrapolation."
            )
    if lifted := [f"axle {e.axle + 1}" for e in trust if e.what == "lift_off"]:
        sentences.append(
            f"{name}: these wheels leave the road, which they never did in the driven runs: {', '.join(lifted)}."
        )
    return sentences
